"""A vehicle with two driven wheels on one ZLAC8015D: speeds ahead and about itself, and where that took it."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator

import anyio

from rs485bus.arguments import positive, real
from rs485bus.bus.handle import Handle
from rs485bus.devices.zlac.odometry import Odometry, OdometrySample, Pose
from rs485bus.devices.zlac.together import Both
from rs485bus.devices.zlac.zlac import Zlac8015d
from rs485bus.errors import DeviceOffline, NoReply, ReferenceLost
from rs485bus.motion.standstill import NEVER

_MARGIN = 1.5
_SLACK = 0.25
"""Turns that a wheel may have turned in no time at all."""
_PATIENCE = 1.0
"""Seconds for which poses go on though the drive does not answer."""


class DifferentialDrive:
    """Drives a vehicle and knows where it is.

    x is ahead and y to the left of where it began, in metres; headings are radians, counter-clockwise. Positive speeds
    of both wheels must take it ahead: `Zlac8015d(reverse=(False, True))` where the right one is mounted mirrored.

    Every answer of the drive counts, whoever asked: no way of the wheels is lost that was seen.

    Args:
        zlac: the drive and its wheels.
        wheel_radius: metres.
        track: metres between the wheels where they touch the ground.
        acceleration: m/s² of a wheel; None for the wheels' own.
        variance: of the way of a wheel, in m² for each metre that it goes: what slip and worn tyres make of it.
    """

    def __init__(
        self,
        zlac: Zlac8015d,
        wheel_radius: float,
        track: float,
        *,
        acceleration: float | None = None,
        variance: float = 1e-4,
    ) -> None:
        self.zlac = zlac
        self.wheel_radius = positive("wheel_radius", wheel_radius)
        self.track = positive("track", track)
        self._variance = real("variance", variance)
        self._acceleration = None if acceleration is None else self._rpm(real("acceleration", acceleration))
        self._begin = Pose()
        self._odometry: Odometry | None = None
        self._counts = (0, 0)
        self._at = NEVER
        """When its wheels were asked last."""
        self._speeds = (0.0, 0.0)
        self._seen = (0, 0, 0)
        """How often the counters had begun anew by then, and the drive had restarted."""
        self._lost = ""
        self._wheels = zlac.counters
        self._wheels.listen(self._look)

    @property
    def pose(self) -> Pose:
        """Where it was when the drive was last heard."""
        return self._begin if self._odometry is None else self._odometry.pose

    @property
    def sample(self) -> OdometrySample | None:
        """Where it was and how fast when the drive was last heard, and how certain that is; None before `update`."""
        if self._odometry is None:
            return None
        left, right = (math.tau * self.wheel_radius * rpm / 60 for rpm in self._speeds)
        return OdometrySample(
            self._at, self.pose, (left + right) / 2, (right - left) / self.track, self._odometry.covariance
        )

    def drive(self, v: float, omega: float) -> Both[float]:
        """Go ahead at `v` m/s and turn at `omega` rad/s, from now on. It replaces the speeds that were told before.

        The handle is done once both wheels have their speed. The drive takes speeds in steps (`speed_resolution`); the
        next ones towards zero are told.

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

        Between two readings it is taken to go an arc: update often while it turns, ten times a second, say. Where the
        drive was not heard for a while it is asked first whether it has restarted.

        Raises:
            ReferenceLost: the drive has restarted, or a counter jumped further than its wheel can have turned. `reset`
                says where the vehicle is.
        """
        self._check()
        await self.zlac.set_up()
        if self._odometry is None:
            self._start()
        await self._wheels.ask()
        self._look()
        self._check()
        return self.pose

    async def poses(self, every: float = 0.05) -> AsyncIterator[Pose]:
        """Where it is, about every so many seconds. What is not answered is asked again, for a second.

        Raises:
            NoReply, DeviceOffline: the drive has not answered for longer.
        """
        while True:
            try:
                yield await self.update()
            except (NoReply, DeviceOffline):
                if self._wheels.now() > self._at + _PATIENCE:
                    raise
            await anyio.sleep(every)

    async def reset(self, pose: Pose | None = None) -> None:
        """Say where it is; None for the origin. Counting goes on from the present counts."""
        self._lost, self._odometry = "", None
        self._begin = pose or Pose()
        await self.update()

    def _start(self) -> None:
        """Count from what is read next on."""
        left, right = (math.tau * self.wheel_radius / counts for counts in self._wheels.counts_per_turn)
        self._odometry = Odometry(self.track, left, right, self._begin, variance=self._variance)
        self._at = NEVER

    def _check(self) -> None:
        if self._lost:
            raise ReferenceLost(f"{self.zlac.name}: {self._lost} reset() says where the vehicle is.")

    def _look(self) -> None:
        """The drive was heard: go on, where that tells where its wheels are, and that it has not restarted."""
        odometry, wheels = self._odometry, self._wheels
        seen = wheels.seen()
        if odometry is None or self._lost or seen is None or seen.at <= self._at:
            return
        begun = (*wheels.zeroings, wheels.restarts)
        if self._at == NEVER:
            odometry.begin(seen.counts)
        elif begun[2] != self._seen[2] or wheels.may_have_restarted(self._at, self._counts, seen):
            self._lost = "the drive has restarted, and counts from zero since."
            return
        elif begun != self._seen:
            odometry.begin(seen.counts)  # its wheels stood, or what they turned meanwhile nobody can know
        else:
            furthest = _MARGIN * (seen.at - self._at) * wheels.fastest / 60 + _SLACK
            if max(map(abs, odometry.ways(seen.counts))) > furthest * math.tau * self.wheel_radius:
                self._lost = "a counter jumped further than its wheel can have turned; the drive may have restarted."
                return
        odometry.update(seen.counts)
        self._at, self._counts, self._speeds, self._seen = seen.at, seen.counts, seen.rpm, begun

    def _rpm(self, speed: float) -> float:
        """How fast a wheel turns that goes at a speed, in m/s."""
        return 60 * speed / (math.tau * self.wheel_radius)

    def _step(self, rpm: float) -> float:
        """The nearest speed towards zero that the drive can be told: what is slower than a step is none."""
        steps = self.zlac.speed_resolution
        return math.trunc(rpm * steps + math.copysign(1e-9, rpm)) / steps
