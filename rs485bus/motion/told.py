"""What a stream was told last. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.motion.terms import Speeds


@dataclass(slots=True)
class Told:
    """What was told last."""

    speeds: Speeds
    at: float
    """When."""
    same_way_since: list[float]
    """Since when each axis is told to turn the way in which it is to turn now, or to stand."""
    sure: bool = True
    """The drive has acknowledged it, by an answer that can be to nothing else."""
    delay: float = 0.0
    """How old the newest set-point was when the frame was sent that carries it, in seconds."""
    count: int = 0
    """Set-points that were told, or steps towards them."""
