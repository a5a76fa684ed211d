"""What a stream of set-points keeps to. Pure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

Speeds = tuple[float, ...]
"""One of each axis, in rpm, in the drive's direction."""


@dataclass(frozen=True, slots=True)
class Terms:
    """What a stream keeps to. Speeds are in the drive's direction, positions its counts."""

    acceleration: float
    """rpm/s, up and down."""
    timeout: float
    """Seconds after which a set-point is too old."""
    highest: float
    """The highest speed."""
    limits: tuple[tuple[int, int] | None, ...] = ()
    """The lowest and highest position of each axis; None, or nothing at all, for no limit."""
    needs: Callable[[Speeds], float] | None = None
    """Seconds that a change of the speeds takes at least; None for as long as the acceleration needs for the greatest
    of them."""

    def takes(self, change: Speeds) -> float:
        """Seconds that a change of the speeds takes at least."""
        if self.needs is not None:
            return self.needs(change)
        return max(map(abs, change)) / self.acceleration

    def towards(self, target: Speeds, since: Speeds, time: float) -> Speeds:
        """The speeds to which those from `since` on can be changed in a time."""
        change = tuple(wanted - is_ for is_, wanted in zip(since, target, strict=True))
        takes = self.takes(change)
        if takes <= time:
            return target
        return tuple(is_ + each * time / takes for is_, each in zip(since, change, strict=True))


def scaled(speeds: Speeds, by: float) -> Speeds:
    """All of them in proportion."""
    return speeds if by == 1.0 else tuple(speed * by for speed in speeds)
