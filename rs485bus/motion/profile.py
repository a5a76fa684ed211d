"""How long a move takes with a family's ramps, and which speed a wanted time needs. Pure.

A move accelerates at a constant rate, runs at its speed, and slows down at a constant rate; a short one never reaches
its speed. Distances are turns, speeds rpm, rates rpm/s; a rate of infinity is a jump.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

_MINUTE = 60.0


_CLOSE_RPM, _CLOSE = 2.0, 0.03
"""By how much a speed may differ from the one that was told: in rpm, or as a part of it."""


def is_speed(measured: float, rpm: float) -> bool:
    """Whether a speed is the one that was told."""
    return abs(measured - rpm) <= max(_CLOSE_RPM, _CLOSE * abs(rpm))


@dataclass(frozen=True, slots=True)
class Profile:
    """One move.

    Args:
        turns: how far, 0 or more.
        rpm: its speed, above 0.
        up: the rate at which it gets faster, above 0.
        down: the rate at which it gets slower, above 0; None for the same.
    """

    turns: float
    rpm: float
    up: float = math.inf
    down: float | None = None
    peak: float = field(init=False, repr=False, compare=False)
    """The highest speed it reaches, in rpm."""
    duration: float = field(init=False, repr=False, compare=False)
    """Seconds from start to standing."""

    def __post_init__(self) -> None:
        ramps = self._ramp_turns(self.rpm)
        peak = self.rpm if ramps <= self.turns else self.rpm * math.sqrt(self.turns / ramps)
        object.__setattr__(self, "peak", peak)
        cruise = max(0.0, self.turns - self._ramp_turns(peak))
        # There may be nowhere to go, as far as numbers tell.
        took = peak / self.up + peak / self._down + _MINUTE * cruise / peak if peak else 0.0
        object.__setattr__(self, "duration", took)

    def turns_after(self, seconds: float) -> float:
        """How far it has come so many seconds after its start."""
        peak, left = self.peak, self.duration - seconds
        if seconds <= 0 or left <= 0:
            return 0.0 if seconds <= 0 else self.turns
        if seconds * self.up < peak:
            return self.up * seconds * seconds / (2 * _MINUTE)
        if left * self._down < peak:
            return self.turns - self._down * left * left / (2 * _MINUTE)
        return peak * (seconds - peak / self.up / 2) / _MINUTE

    @property
    def _down(self) -> float:
        return self.up if self.down is None else self.down

    def _ramp_turns(self, rpm: float) -> float:
        return rpm * rpm * (1 / self.up + 1 / self._down) / (2 * _MINUTE)


def rpm_for(turns: float, seconds: float, up: float, down: float | None = None) -> float | None:
    """The speed at which a move takes just so long; None if the ramps are too slow for that.

    Args:
        turns: how far, above 0.
        seconds: how long, above 0.
        up: the rate at which it gets faster, in rpm/s.
        down: the rate at which it gets slower; None for the same.
    """
    # turns = rpm / 60 * (seconds - rpm * ramps / 2): of the two speeds that solve it the slower one has a cruise.
    ramps = 1 / up + 1 / (up if down is None else down)
    needed = _MINUTE * turns
    if ramps == 0:
        return needed / seconds
    root = seconds * seconds - 2 * ramps * needed
    return None if root < 0 else (seconds - math.sqrt(root)) / ramps


def ramp_for(turns: float, seconds: float, rpm: float) -> float | None:
    """The rate, up and down alike, at which a move takes just so long; None if it takes longer even with jumps.

    Args:
        turns: how far, above 0.
        seconds: how long, above 0.
        rpm: its speed, above 0; it may be one that is never reached.
    """
    needed = _MINUTE * turns
    spare = seconds - needed / rpm
    if spare <= 0:
        return None
    return rpm / spare if rpm * seconds <= 2 * needed else 4 * needed / (seconds * seconds)


def seconds_to(turns: float, rpm: float, ramp: float, speed: float) -> float:
    """How long a move takes that is begun while the motor turns.

    Args:
        turns: how far the target is; negative behind.
        rpm: the speed of the move, above 0.
        ramp: the rate at which it gets faster and slower, above 0, in rpm/s.
        speed: how fast it turns now, in rpm; positive is the same way as in `turns`.
    """
    way, fast = abs(turns), abs(speed)
    braking = fast * fast / (2 * ramp * _MINUTE)
    if turns * speed < 0 or braking > way:
        return fast / ramp + Profile(abs(turns - math.copysign(braking, speed)), rpm, ramp).duration
    if fast <= rpm:
        # The rest of a move that began earlier, from a stand.
        return Profile(way + braking, rpm, ramp).duration - fast / ramp
    return fast / ramp + _MINUTE * (way - braking) / rpm


@dataclass(frozen=True, slots=True)
class RunProfile:
    """A run at a speed, perhaps for a time. Positive and negative speeds are the two directions.

    Args:
        rpm: its speed.
        rate: the rate at which speeds change, above 0.
        before: the speed at which it begins, in rpm.
        duration: seconds after which it slows down; None if it goes on.
    """

    rpm: float
    rate: float
    before: float = 0.0
    duration: float | None = None

    @property
    def ramp(self) -> float:
        """Seconds until its speed is reached."""
        return abs(self.rpm - self.before) / self.rate

    @property
    def ends_after(self) -> float:
        """Seconds from its start to standing; infinity if it goes on."""
        if self.rpm == 0:
            return self.ramp
        if self.duration is None:
            return math.inf
        return self.duration + abs(self.last_speed) / self.rate

    @property
    def last_speed(self) -> float:
        """The speed from which it slows down, which it never exceeds: its own, unless its time is over before that."""
        return self.rpm if self.duration is None else self._speed_after(self.duration)

    def turns_after(self, seconds: float) -> float:
        """How far it has come so many seconds after its start."""
        if seconds <= 0:
            return 0.0
        until = seconds if self.duration is None else min(seconds, self.duration)
        turns = self._turns_up(until)
        if self.duration is not None and seconds > self.duration:
            speed = self.last_speed
            down = min(seconds - self.duration, abs(speed) / self.rate)
            turns += math.copysign(abs(speed) * down - self._fallen(down), speed) / _MINUTE
        return turns

    def seconds_to(self, turns: float) -> float:
        """How long it takes to come so far from a stand, either way."""
        way, rpm = abs(turns) * _MINUTE, abs(self.rpm)
        if way <= rpm * self.ramp / 2:
            return math.sqrt(2 * way / self.rate)
        return way / rpm + self.ramp / 2

    def _speed_after(self, seconds: float) -> float:
        if seconds >= self.ramp:
            return self.rpm
        return self.before + math.copysign(self.rate * seconds, self.rpm - self.before)

    def _turns_up(self, seconds: float) -> float:
        changing = min(seconds, self.ramp)
        mean = (self.before + self._speed_after(changing)) / 2
        return (mean * changing + self.rpm * (seconds - changing)) / _MINUTE

    def _fallen(self, seconds: float) -> float:
        return self.rate * seconds * seconds / 2 if seconds else 0.0
