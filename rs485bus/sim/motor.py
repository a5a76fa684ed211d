"""A shaft that moves with ramps. Pure: its position at any time follows from what it was last told.

Positions are turns, speeds rpm, ramps rpm/s; a ramp of infinity is a jump.
"""

from __future__ import annotations

import math
from typing import NamedTuple

_MINUTE = 60.0
_NEVER = float("-inf")


class _Leg(NamedTuple):
    """From a time on: where it is, how fast, and how the speed changes (turns, turns/s, turns/s²)."""

    at: float
    position: float
    speed: float
    rate: float


class Motor:
    """One shaft."""

    __slots__ = ("_legs", "target")

    def __init__(self, position: float = 0.0) -> None:
        self._legs = [_Leg(_NEVER, position, 0.0, 0.0)]
        self.target: float | None = None
        """Where it is going, in turns; None while it runs at a speed."""

    def position(self, now: float) -> float:
        leg, elapsed = self._leg(now)
        return leg.position + leg.speed * elapsed + leg.rate * elapsed * elapsed / 2

    def rpm(self, now: float) -> float:
        leg, elapsed = self._leg(now)
        return _MINUTE * (leg.speed + leg.rate * elapsed)

    def getting_faster(self, now: float) -> bool | None:
        """Whether it gets faster (True) or slower (False); None while its speed does not change."""
        leg, elapsed = self._leg(now)
        if leg.rate == 0:
            return None
        return leg.rate * (leg.speed + leg.rate * elapsed) >= 0

    def moving(self, now: float) -> bool:
        leg, _ = self._leg(now)
        return leg.speed != 0 or leg.rate != 0

    def rests(self, now: float) -> bool:
        """Whether it stands until it is told something."""
        last = self._legs[-1]
        return last.at <= now and last.speed == 0

    @property
    def wanted_rpm(self) -> float:
        """The speed at the end of what it was told."""
        return _MINUTE * self._legs[-1].speed

    @property
    def arrives_at(self) -> float:
        """When the last change of what it was told ends."""
        return self._legs[-1].at

    def next_change(self, after: float) -> float:
        """When its ramp or its direction changes next; infinity if they do not. Until then it goes one way."""
        return next((leg.at for leg in self._legs if leg.at > after), math.inf)

    def place(self, position: float, now: float) -> None:
        """Put it there, standing."""
        self.target = position
        self._legs = [_Leg(now, position, 0.0, 0.0)]

    def halt(self, now: float) -> None:
        """Stand at once."""
        self.place(self.position(now), now)

    def go_to(
        self, target: float, rpm: float, ramp: float, now: float, *, down: float | None = None, start: float = 0.0
    ) -> None:
        """Go to a position and stand there.

        Args:
            target: where.
            rpm: how fast.
            ramp: how fast it gets faster.
            now: when.
            down: how fast it gets slower; None for the same.
            start: the speed, in rpm, that it has at once when it begins from a stand.
        """
        self.target = target
        self._begin(now)
        slower = (ramp if down is None else down) / _MINUTE
        if start and not self._legs[-1].speed:
            way = target - self._legs[-1].position
            speed = min(start / _MINUTE, rpm / _MINUTE, math.sqrt(2 * slower * abs(way)) if way else 0.0)
            self._legs[-1] = self._legs[-1]._replace(speed=math.copysign(speed, way))
        self._append_move(target, rpm / _MINUTE, ramp / _MINUTE, slower)

    def run(self, rpm: float, ramp: float, now: float) -> None:
        """Change to a speed and keep it; 0 to stand."""
        self.target = None
        self._begin(now)
        self._append_speed(rpm / _MINUTE, ramp / _MINUTE)

    def reaches(self, position: float, after: float, until: float) -> float | None:
        """When it first comes to a position, or through it, after a time and until another; None if it does not."""
        turns = [leg.at - leg.speed / leg.rate for leg in self._legs if leg.rate]
        times = sorted(time for time in (*turns, *(leg.at for leg in self._legs)) if after < time < until)
        early, there = after, self.position(after)
        for late in (*times, until):
            here, there = there, self.position(late)
            if here < position <= there or here > position >= there:
                up = here < position
                for _ in range(60):
                    middle = (early + late) / 2
                    passed = self.position(middle) >= position if up else self.position(middle) <= position
                    early, late = (early, middle) if passed else (middle, late)
                return late
            early = late
        return None

    def _leg(self, now: float) -> tuple[_Leg, float]:
        for leg in reversed(self._legs):
            if leg.at <= now:
                break
        return leg, now - leg.at if leg.at > _NEVER else 0.0

    def _begin(self, now: float) -> None:
        leg, elapsed = self._leg(now)
        self._legs = [_Leg(now, self.position(now), leg.speed + leg.rate * elapsed, 0.0)]

    def _append_speed(self, speed: float, ramp: float) -> None:
        """Change the speed at the end of what is planned."""
        last = self._legs.pop()
        took = abs(speed - last.speed) / ramp
        if took:
            self._legs.append(last._replace(rate=math.copysign(ramp, speed - last.speed)))
        end = last.position + (last.speed + speed) / 2 * took
        self._legs.append(_Leg(last.at + took, end, speed, 0.0))

    def _append_move(self, target: float, speed: float, up: float, down: float) -> None:
        last = self._legs[-1]
        way = target - last.position
        braking = last.speed * last.speed / (2 * down)
        if last.speed and (way * last.speed < 0 or braking > abs(way)):
            self._append_speed(0.0, down)  # it cannot stop in time, or goes the wrong way: turn round
            last = self._legs[-1]
            way = target - last.position
        if way:
            ramps = 1 / up + 1 / down
            fastest = math.sqrt((2 * abs(way) + last.speed * last.speed / up) / ramps) if ramps else speed
            peak = math.copysign(min(speed, fastest), way)
            self._append_speed(peak, up if abs(peak) >= abs(last.speed) else down)
            last = self._legs.pop()
            cruise = (target - last.position) / peak - abs(peak) / (2 * down)
            self._legs.append(last)
            if cruise > 0:
                self._legs.append(_Leg(last.at + cruise, last.position + peak * cruise, peak, 0.0))
            self._append_speed(0.0, down)
        last = self._legs.pop()
        self._legs.append(_Leg(last.at, target, 0.0, 0.0))
