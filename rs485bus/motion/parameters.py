"""How fast a move goes: which of the speeds and ramps that a drive can be told come nearest to a wanted time. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from rs485bus.motion.profile import Profile, ramp_for, rpm_for

_CLOSE = 0.0005
"""The part of its time by which a move may take longer or shorter without a further search."""
_CANDIDATES = 100
"""Speeds that are tried."""


@dataclass(frozen=True, slots=True)
class MotionParameters:
    """How fast a move goes: what the drive makes of what was asked for, and how that is said to it."""

    rpm: float
    acceleration: float
    """rpm/s; infinity for a jump."""
    speed_code: int
    ramp_code: int
    deceleration: float | None = None
    """rpm/s, where the ramp down is another one; infinity for a jump."""
    down_code: int | None = None
    """How that is said."""

    @property
    def slowing_down(self) -> float:
        """The rate of the ramp down, in rpm/s."""
        return self.acceleration if self.deceleration is None else self.deceleration

    @property
    def slowing_code(self) -> int:
        """How that is said to the drive."""
        return self.ramp_code if self.down_code is None else self.down_code

    def profile(self, turns: float) -> Profile:
        """A move over so many turns."""
        return Profile(turns, self.rpm, self.acceleration, self.deceleration)

    def seconds(self, turns: float) -> float:
        """How long that takes."""
        return self.profile(turns).duration


class Paced(Protocol):
    """What has a speed and a ramp of its own."""

    @property
    def rpm(self) -> float:
        """The speed of moves that name none."""

    @property
    def acceleration(self) -> float:
        """The ramp of moves that name none, in rpm/s."""


class Tellable(Paced, Protocol):
    """What can be told speeds and ramps, none of these steeper than its own."""

    @property
    def highest_rpm(self) -> float:
        """The highest speed of moves to a position."""

    @property
    def rpm_step(self) -> float:
        """The step, in rpm, in which speeds of moves to a position can be told."""

    def lowest_acceleration(self, rpm: float) -> float:
        """The slowest ramp to a speed, in rpm/s: the same for all speeds, or in proportion to them."""

    def position_pace(self, rpm: float, acceleration: float) -> MotionParameters:
        """What the drive makes of a speed and an acceleration on its way to a position. Raises `LimitExceeded`."""


def quickest(axis: Tellable, highest: float) -> MotionParameters:
    """The quickest pace at up to so many rpm."""
    lowest = axis.lowest_acceleration(highest)
    if lowest > axis.acceleration:
        highest = highest * axis.acceleration / lowest
    steps = max(1, math.floor(highest / axis.rpm_step + _CLOSE))
    return axis.position_pace(steps * axis.rpm_step, axis.acceleration)


def slowest(axis: Tellable) -> MotionParameters:
    """The slowest pace."""
    return axis.position_pace(axis.rpm_step, axis.lowest_acceleration(axis.rpm_step))


def fitting(axis: Tellable, turns: float, seconds: float, highest: float) -> MotionParameters:
    """The pace at which a move comes nearest to taking so long.

    The axis' own acceleration is taken where a speed fits with it; where steps of the speed are too coarse, a higher
    speed with a slower ramp.

    Args:
        axis: what moves.
        turns: how far, above 0.
        seconds: how long, above 0.
        highest: the highest speed, in rpm.
    """
    ideal = rpm_for(turns, seconds, axis.acceleration) or highest
    first = max(1, math.floor(min(ideal, highest) / axis.rpm_step))
    best, least = slowest(axis), math.inf
    for number in range(first, first + _CANDIDATES):
        rpm = number * axis.rpm_step
        lowest = axis.lowest_acceleration(rpm)
        if number > first and (rpm > highest or lowest > axis.acceleration):
            break
        wanted = ramp_for(turns, seconds, rpm) or axis.acceleration
        pace = axis.position_pace(rpm, max(lowest, min(wanted, axis.acceleration)))
        error = abs(pace.seconds(turns) - seconds)
        if error < least:
            best, least = pace, error
        if error <= _CLOSE * seconds:
            break
    return best
