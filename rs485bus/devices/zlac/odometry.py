"""Where a vehicle with two driven wheels is, from the counters of its wheels. Pure.

x is ahead and y to the left of where it began, in metres; the heading is in radians, counter-clockwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rs485bus.devices.zlac.telemetry import turned


@dataclass(frozen=True, slots=True)
class Pose:
    """A place and a heading. The heading goes on beyond a full turn."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0

    def moved(self, way: float, turn: float) -> Pose:
        """After an arc of a length, in metres, through an angle, in radians."""
        # The chord of the arc: way * sin(turn / 2) / (turn / 2), in the middle direction.
        half = turn / 2
        chord = way if half == 0 else way * math.sin(half) / half
        middle = self.heading + half
        return Pose(self.x + chord * math.cos(middle), self.y + chord * math.sin(middle), self.heading + turn)


_ORIGIN = Pose()


class Odometry:
    """Adds up what the wheels turn. Between two updates the vehicle is taken to go an arc.

    Args:
        track: metres between the wheels.
        left: metres that the vehicle goes for a count of the left wheel; negative where it counts down going ahead.
        right: the same of the right wheel.
        pose: where it begins.
    """

    def __init__(self, track: float, left: float, right: float, pose: Pose = _ORIGIN) -> None:
        self.pose = pose
        self._track = track
        self._metres = (left, right)
        self._counts: tuple[int, int] | None = None

    def begin(self, counts: tuple[int, int]) -> None:
        """Count from here: the counters began anew, or nobody looked."""
        self._counts = counts

    def ways(self, counts: tuple[int, int]) -> tuple[float, float]:
        """How far each wheel went since the last update, in metres. The counters have 32 bits and wrap."""
        if self._counts is None:
            return 0.0, 0.0
        left, right = (
            turned(before, now) * metres for before, now, metres in zip(self._counts, counts, self._metres, strict=True)
        )
        return left, right

    def update(self, counts: tuple[int, int]) -> Pose:
        """Where it is, now that the counters, left and right, read this."""
        left, right = self.ways(counts)
        self._counts = counts
        self.pose = self.pose.moved((left + right) / 2, (right - left) / self._track)
        return self.pose
