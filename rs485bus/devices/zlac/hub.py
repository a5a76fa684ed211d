"""A hub motor of a ZLAC8015D: what it reports, what it can do, and how it is stopped.

Source: ZLAC8015D RS485 V1.06. What it shares with the other motor is in `modes`; commands are carried out in `wheel`.
"""

from __future__ import annotations

import asyncio
import math
from typing import Any, TypeVar

import anyio

from rs485bus.bus.handle import Handle
from rs485bus.bus.schedule.job import Urgency
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.axis import FormerAxis
from rs485bus.devices.travel import Look
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.modes import ZlacModes
from rs485bus.devices.zlac.setup import SetUp
from rs485bus.devices.zlac.telemetry import Snapshot, Stillness
from rs485bus.devices.zlac.together import Together
from rs485bus.devices.zlac.values import ControlMode, ShaftState, Side
from rs485bus.errors import (
    DriveFault,
    LimitExceeded,
    MotionError,
    MoveCancelled,
    MoveFailed,
    ReferenceLost,
    StopUnconfirmed,
)
from rs485bus.motion.parameters import MotionParameters

P = TypeVar("P")

_CONTRADICTED = 0.1
"""Seconds for which a position must stay for a wheel to stand of which it is said that it runs."""


class HubMotor(FormerAxis):
    """One motor, as `ZlacWheel` without its commands.

    Args:
        modes: what it shares with the other motor.
        set_up: sets the drive up.
        side: which one it is.
    """

    other: HubMotor
    tells_restarts = True

    def __init__(
        self,
        modes: ZlacModes,
        set_up: SetUp,
        side: Side,
        *,
        units_per_turn: float,
        reverse: bool,
        limits: tuple[float, float] | None,
        rpm: float,
        acceleration: float,
        tolerance: int,
    ) -> None:
        self.modes = modes
        self.driver = modes.driver
        self.side = side
        self.zeroings = 0
        """Changes whenever its counter begins anew."""
        self.counts_per_turn = self.driver.counts_per_turn[side.index]
        self._set_up_drive = set_up
        self._still = Stillness(0.0, _CONTRADICTED)
        self._pairs: dict[Handle[Any], Together] = {}
        """What it is to carry out together with the other motor."""
        self._together: Together | None = None
        """With whom it carries that out."""
        self._mode = ControlMode.VELOCITY
        """In which mode."""
        self._from = 0
        self._told: tuple[r.Twin[int], int] = (r.TARGET_VELOCITY, 0)
        self._ends_after: int | None = None
        self._now: Handle[Any] | None = None
        """What it carries out now."""
        self._skips = False
        """Another run has overtaken the one that it carries out now."""
        super().__init__(
            self.driver.bus,
            self.driver.attached,
            self.driver.attached.sides[side],
            f"{self.driver.name} {side.name.lower()}",
            units_per_turn=units_per_turn,
            reverse=reverse,
            limits=limits,
            rpm=rpm,
            acceleration=acceleration,
            tolerance=tolerance,
        )

    @property
    def target_range(self) -> tuple[int, int]:
        return -r.MAX_ABSOLUTE, r.MAX_ABSOLUTE

    @property
    def _reach(self) -> tuple[int, int]:
        return -r.MAX_COUNTS, r.MAX_COUNTS

    @property
    def _running(self) -> bool:
        return self.modes.keeps(self.side) is not None

    @_running.setter
    def _running(self, runs: bool) -> None:
        self.modes.keep(self.side, self._mode if runs else None)

    # Questions

    async def _set_up(self) -> None:
        self.counts_per_turn = (await self._set_up_drive()).counts_per_turn[self.side.index]

    async def _glance(self, *, quick: bool) -> tuple[Snapshot, bool]:
        """Both wheels, and whether this one moves. What cannot be told at a quick glance counts as moving."""
        seen = await self.driver.sample(Urgency.POLL)
        stands = self._still.see(seen.at, seen.motion[self.side.index], seen.status.running)
        if stands is None and not quick:
            await anyio.sleep(_CONTRADICTED)
            seen = await self.driver.sample(Urgency.POLL)
            stands = self._still.see(seen.at, seen.motion[self.side.index], seen.status.running)
        return seen, stands is not True

    async def _look(self, *, quick: bool = False) -> Look:
        seen, moving = await self._glance(quick=quick)
        self.check_faults(seen)
        if seen.status.either(ShaftState.EMERGENCY_STOP):
            # That is why it is not enabled: not because it restarted.
            self._enabled = self.other._enabled = self.modes.ready = False
        return Look(seen.at, seen.motion[self.side.index].position, moving, seen.status.enabled)

    async def velocity(self) -> float:
        """How fast the wheel turns, in rpm, in steps of 0.1. Some firmware reports it in velocity mode only."""
        return self._sign * (await self.driver.sample(Urgency.POLL)).motion[self.side.index].rpm

    async def idle(self) -> bool:
        """Whether nothing is queued and the wheel stands."""
        return self._orders.idle and not (await self._glance(quick=False))[1]

    async def drain(self) -> None:
        """Wait until nothing is queued or on its way to a target, of either wheel: what guards one guards both."""
        for wheel in (self, self.other):
            await wheel._orders.drain()

    async def _read_position(self) -> int:
        return (await self.driver.sample(Urgency.POLL)).motion[self.side.index].position

    async def _read_velocity(self) -> float:
        if self._now in self.modes.hurried:
            return self._told[1] / self.driver.speed_resolution
        seen = await self.driver.sample(Urgency.POLL)
        self.check_faults(seen)
        if not seen.status.enabled:
            raise self._let_go(seen, self.name)
        return seen.motion[self.side.index].rpm

    def check_faults(self, seen: Snapshot) -> None:
        """Stop both wheels for an error of either. Raises `DriveFault`."""
        try:
            self.modes.check_faults(seen)
        except DriveFault as fault:
            self.modes.ready = False
            for wheel in (self, self.other):
                wheel._enabled = False
                if seen.faults[wheel.side.index].spoils_position:
                    wheel._lost = "its encoder or its Hall sensor failed."
            if self.attached.motion.may_move:
                self.other._orders.interrupt(fault)
                self._halt(emergency=True)
            raise

    async def _why(self, look: Look, target: int) -> MotionError:
        seen = await self.driver.sample()
        place = f"{self.name} stands {abs(target - look.position)} counts short of where it was sent"
        if not seen.status.enabled:
            return self._let_go(seen, place)
        return MoveFailed(f"{place}, enabled and without an error. Something may hold it, or `tolerance` is too small.")

    def _let_go(self, seen: Snapshot, what: str) -> MotionError:
        """Why it is enabled no more, though nobody here disabled it."""
        self._enabled = self.modes.ready = self.driver.known = False
        if seen.status.either(ShaftState.EMERGENCY_STOP):
            return MoveFailed(
                f"{what}: the drive is in emergency stop, by its input, its watchdog or a stop that concerned both "
                "wheels. enable() it."
            )
        self._lost = "its motor is not enabled any more, and nobody disabled it: the drive may have restarted."
        return ReferenceLost(f"{what}: {self._lost} set_zero() first.")

    @property
    def enabled(self) -> bool:
        """Whether it is enabled, as far as is known."""
        return bool(self._enabled)

    def released(self) -> None:
        """The drive let go of both wheels."""
        self._enabled = False
        self._forget()

    def hold(self, until: Handle[None]) -> None:
        """Begin nothing before a stop of both wheels has ended."""
        self._orders.hold(until)

    def unconfirmed(self) -> StopUnconfirmed:
        """It was not seen standing after a stop of both wheels."""
        return self._unconfirmed()

    def restarted(self) -> None:
        """The drive was seen to have restarted."""
        self._lost = "its drive has restarted, and counts from zero where it stood then."
        self.bus.owner.stops.restarted(self.bus.owner.units[self.attached.address])
        self._enabled = False
        self._forget()

    # Stopping

    def _halt(self, *, emergency: bool, motion: Motion | None = None) -> asyncio.Future[Halted]:
        self.driver.changed()
        if motion is None and self.modes.doubt(emergency):
            motion = self.attached.motion
            if self._together is not None and self.other._together is self._together:
                self.other.stopped()  # both stand still before what they do together
            else:
                self.other.taken_along(f"{self.name} was stopped, which stops both wheels")
        return super()._halt(emergency=emergency, motion=motion)

    def taken_along(self, why: str) -> None:
        """The other wheel is stopped, and this one with it."""
        self._orders.interrupt(MoveCancelled(f"{self.name}: {why}."))
        self.stopped()

    def stopped(self) -> None:
        """The drive is stopped."""
        self._running = False
        self._forget()

    def disabled(self) -> None:
        """The drive was stopped so that it is enabled no more."""
        self.stopped()
        self._enabled = False

    def drop(self, handle: Handle[Any]) -> None:
        """The other wheel's part of a command failed: end this one's."""
        ended = MoveCancelled(f"Cancelled: {self.other.name} did not carry out its part of it.")
        self._pairs.pop(handle, None)
        if self._orders.current is not handle:
            self._orders.remove(handle, ended)
            return
        self._orders.interrupt(ended)
        # Where both are being stopped already, let that go first.
        asyncio.get_running_loop().call_soon(self.stop_if_moving)

    # What the drive can do

    @property
    def attached_mode(self) -> ControlMode | None:
        """The mode the drive is in, if that is known."""
        return self.driver.attached.mode

    def _pace(self, rpm: float | None, acceleration: float | None) -> MotionParameters:
        # The drive may be set to less (0x2008) than the facade was made for.
        return super()._pace(min(self.rpm, self.driver.speed_limit) if rpm is None else rpm, acceleration)

    @property
    def _fastest(self) -> tuple[float, str]:
        return self.driver.speed_limit, f"the least of max_rpm, 0x2008 and {r.MAX_RPM}"

    def _paced(self, rpm: float, acceleration: float) -> MotionParameters:
        resolution = self.driver.speed_resolution
        real = max(1, round(rpm * resolution)) / resolution
        change = self.driver.options.ramp_rpm or real
        lowest = self.lowest_acceleration(real)
        if not acceleration >= lowest:
            raise LimitExceeded(
                f"{self.name}: acceleration {acceleration:g} rpm/s is below {lowest:.3g} rpm/s: a ramp lasts at most "
                f"{r.MAX_RAMP / 1000} s. Infinity is a jump"
            )
        ramp = round(1000 * change / acceleration)
        return MotionParameters(real, 1000 * change / ramp if ramp else math.inf, round(real), ramp)

    @property
    def highest_rpm(self) -> float:
        return min(self.driver.speed_limit, r.MAX_POSITION_RPM)

    def lowest_acceleration(self, rpm: float) -> float:
        return 1000 * (self.driver.options.ramp_rpm or rpm) / r.MAX_RAMP

    def position_pace(self, rpm: float, acceleration: float) -> MotionParameters:
        if rpm > r.MAX_POSITION_RPM:
            raise LimitExceeded(f"{self.name}: {rpm:g} rpm is more than {r.MAX_POSITION_RPM} rpm for a position")
        return self._pace(float(max(1, round(rpm))), acceleration)

    def _ticks(self, duration: float) -> int:
        if not 0 < duration < math.inf:
            raise LimitExceeded(f"{self.name}: duration {duration:g} s is not above 0 s, with an end; None has none")
        return round(duration * 1000)
