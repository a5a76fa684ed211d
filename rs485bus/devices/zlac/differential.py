"""A vehicle with two driven wheels on one ZLAC8015D: speeds ahead and about itself, and where that took it."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator
from types import TracebackType
from typing import Literal

import anyio

from rs485bus.arguments import finite, instance, positive, rate
from rs485bus.bus.async_block import AsyncBlock
from rs485bus.bus.handle import Handle
from rs485bus.devices.zlac.odometry import Odometry, OdometrySample, Pose
from rs485bus.devices.zlac.streams import PairSetpoint, PairStream
from rs485bus.devices.zlac.together import Both
from rs485bus.devices.zlac.zlac import Zlac8015d
from rs485bus.errors import DeviceOffline, LimitExceeded, NoReply, ReferenceLost
from rs485bus.motion.pace import Pace
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.terms import Speeds

_LARGEST_WHEEL, _WIDEST = 5.0, 50.0
"""Metres."""
_MARGIN = 1.5
_SLACK = 0.25
"""Turns that a wheel may have turned in no time at all."""
_PATIENCE = 1.0
"""Seconds for which poses go on though the drive does not answer."""


class VehicleSetpoint:
    """What a stream of a vehicle is told: `setpoint(v, omega)`, in m/s and rad/s."""

    def __init__(
        self, vehicle: DifferentialDrive, setpoint: PairSetpoint, v: float | None, omega: float | None
    ) -> None:
        self._vehicle = vehicle
        self._setpoint = setpoint
        self._limits = (v, omega)

    def __call__(self, v: float, omega: float) -> None:
        """Go ahead at `v` and turn at `omega` from now on. It replaces what was told before, and never waits.

        Raises:
            LimitExceeded, TypeError: one is no speed.
            MotionError, RequestFailed: what has ended the stream.
        """
        wanted = finite("v (m/s)", v), finite("omega (rad/s)", omega)
        share = min(
            (limit / abs(speed) for speed, limit in zip(wanted, self._limits, strict=True) if limit and speed),
            default=1.0,
        )
        share = min(1.0, share)
        self._setpoint(*self._vehicle.wheels_for(share * wanted[0], share * wanted[1]))

    async def reached(self) -> None:
        """Wait until the speeds that are wanted were told, to the end of their ramp. Raises what has ended it."""
        await self._setpoint.reached()

    @property
    def sent(self) -> tuple[float, float]:
        """What was told last: on a ramp, a step of it."""
        return self._vehicle.speeds_of(*self._setpoint.sent)

    @property
    def measured(self) -> tuple[float, float]:
        """How fast it was last seen to go and to turn."""
        return self._vehicle.speeds_of(*self._setpoint.measured)

    @property
    def delay(self) -> float:
        """How old the newest set-point was when its frame was sent, in seconds."""
        return self._setpoint.delay


class VehicleStream(AsyncBlock):
    """A stream of set-points of a vehicle. Made by `DifferentialDrive.stream`."""

    def __init__(self, vehicle: DifferentialDrive, stream: PairStream, v: float | None, omega: float | None) -> None:
        self._vehicle = vehicle
        self._stream = stream
        self._limits = (v, omega)

    async def __aenter__(self) -> VehicleSetpoint:
        return VehicleSetpoint(self._vehicle, await self._stream.__aenter__(), *self._limits)

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        return await self._stream.__aexit__(kind, error, trace)


def _metres(name: str, value: float, most: float) -> float:
    """A length, which is not given in millimetres."""
    metres = positive(name, value)
    if metres > most:
        raise LimitExceeded(
            f"{name} is in metres, up to {most:g}, not {metres:g}: {metres:g} mm are {metres / 1000:g} m."
        )
    return metres


class DifferentialDrive:
    """Drives a vehicle and knows where it is.

    x is ahead and y to the left of where it began, in metres; headings are radians, counter-clockwise. Positive speeds
    of both wheels must take it ahead: `Zlac8015d(reverse=(False, True))` where the right one is mounted mirrored.

    Every answer of the drive counts, whoever asked: no way of the wheels is lost that was seen.

    Args:
        zlac: the drive and its wheels.
        wheel_radius: metres, up to 5.
        track: metres between the wheels where they touch the ground, up to 50.
        acceleration: m/s² of a wheel, infinity for jumps; None for the wheels' own.
        variance: of the way of a wheel, in m² for each metre that it goes: what slip and worn tyres make of it.

    Raises:
        LimitExceeded, TypeError: one of them is out of its range, or of a wrong type.
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
        self.zlac = instance("zlac", zlac, Zlac8015d, "Zlac8015d(bus, 1), the drive of both wheels")
        self.wheel_radius = _metres("wheel_radius", wheel_radius, _LARGEST_WHEEL)
        self.track = _metres("track", track, _WIDEST)
        self._variance = finite("variance", variance)
        if self._variance < 0:
            raise LimitExceeded(f"variance must be 0 or more, not {self._variance:g}")
        self._acceleration = None if acceleration is None else self._rpm(rate("acceleration (m/s²)", acceleration))
        self._begin = Pose()
        self._odometry: Odometry | None = None
        self._counts = (0, 0)
        self._at = NEVER
        """When its wheels were asked last."""
        self._speeds = (0.0, 0.0)
        self._seen = (0, 0, 0)
        """How often the counters had begun anew by then, and the drive had restarted."""
        self._lost = ""
        self._wheels = zlac._counters
        self._wheels.listen(self._look)

    def __repr__(self) -> str:
        return f"<vehicle on {self.zlac.name}>"

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
        v, omega = finite("v (m/s)", v), finite("omega (rad/s)", omega)
        left, right = (self._rpm(v + side * omega * self.track / 2) for side in (-1, 1))
        return self.zlac.run(self._step(left), self._step(right), acceleration=self._acceleration, replace=True)

    def stream(
        self,
        *,
        timeout: float = 0.25,
        v: float | None = None,
        omega: float | None = None,
        acceleration: float | None = None,
        angular_acceleration: float | None = None,
    ) -> VehicleStream:
        """Go as it is told: `async with vehicle.stream() as setpoint: setpoint(0.3, 0.5)`, in m/s and rad/s.

        The newest set-point counts and goes out, for both wheels in one frame, as soon as the wire allows. What is
        faster than allowed, or than a wheel can turn, is made slower so that the curve stays the same. One that is too
        old stops the vehicle by its ramp; that is no error, and the next one goes on. Leaving the block stops it, too.

        Args:
            timeout: seconds after which a set-point is too old.
            v: the highest speed ahead and back, in m/s; None for what the wheels can.
            omega: the highest speed about itself, in rad/s; None for what the wheels can.
            acceleration: m/s² ahead, up and down; None for that of the wheels.
            angular_acceleration: rad/s² about itself; None for what the wheels' acceleration makes of it.

        Raises:
            ValueError, LimitExceeded, TypeError: one of them is out of its range, or no number.
        """
        limits = [None if limit is None else positive(name, limit) for name, limit in (("v", v), ("omega", omega))]
        ahead = None if acceleration is None else positive("acceleration", acceleration)
        about = None if angular_acceleration is None else positive("angular_acceleration", angular_acceleration)
        own = self._acceleration or self.zlac.left.acceleration
        # Where the vehicle's are said, the wheels may do what both make of them together.
        both = (ahead or self._speed(own)) + (about or 0.0) * self.track / 2
        wheels = own if ahead is None and about is None else self._rpm(both)

        def needs(change: Speeds) -> float:
            left, right = (self._speed(sign * rpm) for sign, rpm in zip(self._wheels.signs, change, strict=True))
            times = [max(map(abs, change)) / wheels]
            if ahead is not None:
                times.append(abs(left + right) / 2 / ahead)
            if about is not None:
                times.append(abs(right - left) / self.track / about)
            return max(times)

        stream = self.zlac._stream_as(timeout, wheels, needs)
        return VehicleStream(self, stream, limits[0], limits[1])

    def enable(self) -> Both[None]:
        """Enable both wheels. As `Zlac8015d.enable`."""
        return self.zlac.enable()

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
        """Where it is, every so many seconds. What is not answered is asked again, for a second.

        Raises:
            NoReply, DeviceOffline: the drive has not answered for longer.
        """
        pace = Pace(positive("every (s)", every), self._wheels.now())
        while True:
            try:
                yield await self.update()
            except (NoReply, DeviceOffline):
                if self._wheels.now() > self._at + _PATIENCE:
                    raise
            await anyio.sleep(pace.left(self._wheels.now()))

    async def reset(self, pose: Pose | None = None) -> None:
        """Say where it is; None for the origin. Counting goes on from the present counts."""
        begin = Pose() if pose is None else instance("pose", pose, Pose, "Pose(x=1.0, y=0.5, heading=0.0)")
        for name in ("x", "y", "heading"):
            finite(name, getattr(begin, name))
        self._lost, self._odometry, self._begin = "", None, begin
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

    def wheels_for(self, v: float, omega: float) -> tuple[float, float]:
        """How fast the left and the right wheel turn, in rpm, for speeds ahead (m/s) and about itself (rad/s)."""
        return self._rpm(v - omega * self.track / 2), self._rpm(v + omega * self.track / 2)

    def speeds_of(self, left: float, right: float) -> tuple[float, float]:
        """The speeds ahead (m/s) and about itself (rad/s) for those of the wheels, in rpm."""
        ahead = self._speed(left), self._speed(right)
        return (ahead[0] + ahead[1]) / 2, (ahead[1] - ahead[0]) / self.track

    def _speed(self, rpm: float) -> float:
        """How fast a wheel goes that turns at a speed, in m/s."""
        return math.tau * self.wheel_radius * rpm / 60

    def _rpm(self, speed: float) -> float:
        """How fast a wheel turns that goes at a speed, in m/s."""
        return 60 * speed / (math.tau * self.wheel_radius)

    def _step(self, rpm: float) -> float:
        """The nearest speed towards zero that the drive can be told: what is slower than a step is none."""
        steps = self.zlac.speed_resolution
        return math.trunc(rpm * steps + math.copysign(1e-9, rpm)) / steps
