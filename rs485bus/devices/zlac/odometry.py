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
Covariance = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
"""How uncertain a pose is: of x, y and heading, in m², m rad and rad²."""
_CERTAIN: Covariance = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class OdometrySample:
    """Where a vehicle was, and how fast, at one moment."""

    at: float
    """When its wheels were asked, on the event loop's clock."""
    pose: Pose
    v: float
    """m/s ahead, as measured."""
    omega: float
    """rad/s counter-clockwise, as measured."""
    covariance: Covariance
    """Grows with the way that the wheels go."""


class Odometry:
    """Adds up what the wheels turn. Between two updates the vehicle is taken to go an arc.

    Args:
        track: metres between the wheels.
        left: metres that the vehicle goes for a count of the left wheel; negative where it counts down going ahead.
        right: the same of the right wheel.
        pose: where it begins.
        variance: of the way of a wheel, in m² for each metre that it goes.
    """

    def __init__(self, track: float, left: float, right: float, pose: Pose = _ORIGIN, *, variance: float = 0.0) -> None:
        self.pose = pose
        self.covariance: Covariance = _CERTAIN
        self._variance = variance
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
        self._spread(left, right)
        self.pose = self.pose.moved((left + right) / 2, (right - left) / self._track)
        return self.pose

    def _spread(self, left: float, right: float) -> None:
        """Become less certain by the ways that the wheels go: each as a small step in a direction."""
        way, turn = (left + right) / 2, (right - left) / self._track
        heading = self.pose.heading + turn / 2
        cos, sin = math.cos(heading), math.sin(heading)
        lean = way / (2 * self._track)
        # What a metre more of the left and of the right wheel would change.
        by_left = (cos / 2 + lean * sin, sin / 2 - lean * cos, -1 / self._track)
        by_right = (cos / 2 - lean * sin, sin / 2 + lean * cos, 1 / self._track)
        of_left, of_right = self._variance * abs(left), self._variance * abs(right)
        carried = ((1.0, 0.0, -way * sin), (0.0, 1.0, way * cos), (0.0, 0.0, 1.0))
        old = self.covariance
        rows = []
        for i in range(3):
            row = []
            for j in range(3):
                kept = sum(carried[i][k] * old[k][m] * carried[j][m] for k in range(3) for m in range(3))
                row.append(kept + of_left * by_left[i] * by_left[j] + of_right * by_right[i] * by_right[j])
            rows.append((row[0], row[1], row[2]))
        self.covariance = (rows[0], rows[1], rows[2])
