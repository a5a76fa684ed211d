"""A vehicle with two driven wheels on one ZLAC8015D: speeds ahead and about itself, and where that took it."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator

import anyio

from rs485bus.arguments import positive, real
from rs485bus.bus.handle import Handle
from rs485bus.devices.zlac.odometry import Odometry, Pose
from rs485bus.devices.zlac.together import Both
from rs485bus.devices.zlac.zlac import Zlac8015d
from rs485bus.errors import ReferenceLost

_MARGIN = 1.5
_SLACK = 0.25
"""Turns that a wheel may have turned in no time at all."""


class DifferentialDrive:
    """Drives a vehicle and knows where it is.

    x is ahead and y to the left of where it began, in metres; headings are radians, counter-clockwise. Positive speeds
    of both wheels must take it ahead: `Zlac8015d(reverse=(False, True))` where the right one is mounted mirrored.

    Args:
        zlac: the drive and its wheels.
        wheel_radius: metres.
        track: metres between the wheels where they touch the ground.
        acceleration: m/s² of a wheel; None for the wheels' own.
    """

    def __init__(
        self, zlac: Zlac8015d, wheel_radius: float, track: float, *, acceleration: float | None = None
    ) -> None:
        self.zlac = zlac
        self.wheel_radius = positive("wheel_radius", wheel_radius)
        self.track = positive("track", track)
        self._acceleration = None if acceleration is None else self._rpm(real("acceleration", acceleration))
        self._begin = Pose()
        self._odometry: Odometry | None = None
        self._looked_at = 0.0
        self._zeroings: tuple[int, ...] = (0, 0)
        self._lost = ""

    @property
    def pose(self) -> Pose:
        """Where it was at the last `update`."""
        return self._begin if self._odometry is None else self._odometry.pose

    def drive(self, v: float, omega: float) -> Both[float]:
        """Go ahead at `v` m/s and turn at `omega` rad/s, from now on. It replaces the speeds that were told before.

        The handle is done once both wheels have their speed. The drive takes speeds in steps (`speed_resolution`); the
        nearest ones are told.

        Raises:
            LimitExceeded: a wheel would have to turn too fast.
            TypeError: a speed is no number.
        """
        v, omega = real("v", v), real("omega", omega)
        left, right = (self._rpm(v + side * omega * self.track / 2) for side in (-1, 1))
        return self.zlac.run(self._step(left), self._step(right), acceleration=self._acceleration, replace=True)

    def stop(self) -> Handle[None]:
        """Stop with the ramp, and see both wheels stand."""
        return self.zlac.stop()

    async def update(self) -> Pose:
        """Read both counters and say where that puts it.

        Between two updates it is taken to go an arc: update often while it turns, ten times a second, say.

        Raises:
            ReferenceLost: a counter jumped further than its wheel can have turned: the drive may have restarted.
                `reset` says where the vehicle is.
        """
        if self._lost:
            raise ReferenceLost(self._lost)
        setup = await self.zlac.set_up()
        seen = await self.zlac.snapshot()
        wheels = (self.zlac.left, self.zlac.right)
        left, right = (
            math.tau * self.wheel_radius / counts * (-1 if wheel.reverse else 1)
            for wheel, counts in zip(wheels, setup.counts_per_turn, strict=True)
        )
        odometry = self._odometry = self._odometry or Odometry(self.track, left, right, self._begin)
        counts = (seen.motion[0].position, seen.motion[1].position)
        zeroings = tuple(self.zlac._drive.zeroings)
        if zeroings != self._zeroings:
            odometry.begin(counts)
        furthest = _MARGIN * (seen.at - self._looked_at) * setup.speed_limit / 60 + _SLACK
        if max(map(abs, odometry.ways(counts))) > furthest * math.tau * self.wheel_radius:
            self._lost = (
                f"{self.zlac.name}: a counter jumped further than its wheel can have turned; the drive may have "
                "restarted. reset() says where the vehicle is."
            )
            raise ReferenceLost(self._lost)
        self._looked_at, self._zeroings = seen.at, zeroings
        return odometry.update(counts)

    async def poses(self, every: float = 0.05) -> AsyncIterator[Pose]:
        """Where it is, about every so many seconds."""
        while True:
            yield await self.update()
            await anyio.sleep(every)

    async def reset(self, pose: Pose | None = None) -> None:
        """Say where it is; None for the origin. Counting goes on from the present counts."""
        self._lost, self._odometry = "", None
        self._begin = pose or Pose()
        await self.update()

    def _rpm(self, speed: float) -> float:
        """How fast a wheel turns that goes at a speed, in m/s."""
        return 60 * speed / (math.tau * self.wheel_radius)

    def _step(self, rpm: float) -> float:
        """The nearest speed that the drive can be told: what is slower than half a step is none."""
        steps = self.zlac.speed_resolution
        return round(rpm * steps) / steps
