"""What an axis was last seen to do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from rs485bus.motion.scale import AxisScale
from rs485bus.motion.state import AxisState, Fact


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

    @classmethod
    def of(cls, state: AxisState, now: float, scale: AxisScale, *, knows_counts: bool) -> AxisSample:
        """What is known now.

        Args:
            state: what is known of the axis.
            now: the time, on the event loop's clock.
            scale: its units.
            knows_counts: it is known how the drive counts.
        """
        position, stands = state.last(Fact.POSITION), state.stands
        speed = 0.0 if stands else state.value(Fact.SPEED)  # not one from before it was told otherwise
        return cls(
            at=position.at,
            age=now - position.at,
            position=scale.to_units(position.value) if knows_counts and position.value is not None else None,
            rpm=None if speed is None else scale.sign * speed,
            moving=None if stands is None else not stands,
            enabled=state.value(Fact.ENABLED),
            fault=state.value(Fact.FAULT) or "",
            stalled=bool(state.value(Fact.STALLED)),
            limit=state.value(Fact.LIMIT) or "",
            lost=state.lost,
        )


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
