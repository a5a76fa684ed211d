"""What an axis was last seen to do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AxisSample:
    """What is known of an axis, from whatever its drive was asked last. None stands for what is not known."""

    at: float
    """When the position was asked for, on the event loop's clock."""
    age: float
    """Seconds since then."""
    position: float | None
    """In the axis' units."""
    rpm: float | None
    moving: bool | None
    enabled: bool | None
    fault: str
    """What the drive reports, in words; empty if nothing is known of a fault."""
    stalled: bool
    limit: str
    """The limit that is reached, in words."""
    lost: str
    """Why positions are not to be trusted; empty if they are."""


class AxisStatus(ABC):
    """What a drive says of one axis. Each family's `status()` gives more."""

    enabled: bool
    """Whether its motor is energised."""

    @property
    @abstractmethod
    def moving(self) -> bool:
        """Whether the drive says that the axis moves."""

    @property
    @abstractmethod
    def faulty(self) -> bool:
        """Whether the drive reports a fault."""
