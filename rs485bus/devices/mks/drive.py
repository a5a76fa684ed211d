"""An MKS drive carrying out moves: what the shared axis leaves to the family. Source: MKS RTU V1.0.9."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import anyio

from rs485bus.arguments import choice
from rs485bus.bus.bus import Bus
from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.axis import Axis
from rs485bus.devices.mks import alarms
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.adapter import FAMILY, MksAttached
from rs485bus.devices.mks.alarms import hints
from rs485bus.devices.mks.frames import read, write, write_block
from rs485bus.devices.mks.values import Homed, Model, MotionDirection, Status, WorkMode
from rs485bus.devices.move import Move
from rs485bus.devices.pace import Pace
from rs485bus.devices.travel import Look
from rs485bus.errors import (
    DeviceRefused,
    LimitExceeded,
    MotionError,
    MotorStalled,
    MoveFailed,
    NotEnabled,
    NotStanding,
    NotSupported,
    OutcomeUnknown,
    ReferenceLost,
)
from rs485bus.wire.frames import Request, payload, unit_address
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")

_CALIBRATED = (16, 32, 64)
"""The microsteps at which a speed value is rpm (7.1)."""
_RAMP_UNIT = 20_000.0
"""rpm/s times (256 - code): one rpm every (256 - code) * 50 µs (7.1)."""
_TICK = 0.01
_SLOWEST_SETTING = 2.5
"""Seconds that 0x9A may take to answer; 5.6 logs 1.6."""
_NO_SPEED_FOR = 0.01
_SAME = 2
_SHOWN_RPM = 2.0
"""From here on a speed is not reported as 0."""
_SAME_RPM, _SAME_SPEED = 2.0, 0.03
"""By how much a speed may differ from one that is to be the same: in rpm, or as a part of it."""


class MksDrive(Axis):
    """One drive, as `MksServo` without what it can be asked, set to and told but to move."""

    counts_per_turn = r.COUNTS_PER_TURN

    def __init__(
        self,
        bus: Bus,
        address: int,
        *,
        model: Model = Model.SERVO42D,
        mode: WorkMode = WorkMode.SR_VFOC,
        microsteps: int = 16,
        units_per_turn: float = 1.0,
        reverse: bool = False,
        positive: MotionDirection = MotionDirection.CCW,
        limits: tuple[float, float] | None = None,
        rpm: float = 300.0,
        acceleration: float = 1000.0,
        tolerance: int = 8,
    ) -> None:
        self.address = unit_address(address)
        self.model = choice("model", model, Model)
        self.mode = choice("mode", mode, WorkMode)
        self.microsteps = r.MICROSTEPS.raw(microsteps)
        self.positive = choice("positive", positive, MotionDirection)
        self._drive = MksAttached(self.address, self._heard, self._was_interrupted)
        self._stuck: Look | None = None
        self._asks_speed = False
        self._homed: tuple[Homed, Homed] | None = None
        """The homing status with which its zero was found, if it was."""
        self._told_rpm: float | None = None
        """The speed of the last run that was not for a time, in the drive's direction."""
        super().__init__(
            bus,
            self._drive,
            self._drive.motion,
            f"{FAMILY} {self.address}",
            units_per_turn=units_per_turn,
            reverse=reverse,
            limits=limits,
            rpm=rpm,
            acceleration=acceleration,
            tolerance=tolerance,
        )
        bus.attach(self)

    @property
    def target_range(self) -> tuple[int, int]:
        target = r.MOVE_TO_COUNTS.fields[2].number
        return target.low, target.high

    # Questions

    async def _read(self, register: Register[T], urgency: Urgency = Urgency.COMMAND) -> T:
        return register.decode(payload(await self.bus.ask(read(self.address, register), urgency=urgency)))

    async def _read_block(self, block: Block, urgency: Urgency = Urgency.COMMAND) -> tuple[Any, ...]:
        return block.decode(payload(await self.bus.ask(read(self.address, block), urgency=urgency)))

    async def _read_homed(self) -> tuple[Homed, Homed]:
        in_turn, origin = await self._read_block(r.HOMED)
        return in_turn, origin

    async def _look(self, *, quick: bool = False) -> Look:
        at = self.bus.now()
        status = await self._read(r.STATUS, Urgency.POLL)
        position = await self._read(r.POSITION, Urgency.POLL)
        moving = status is not Status.STOPPED
        if moving and status not in (Status.HOMING, Status.CALIBRATING):
            moving = not await self._stands_after_all(at, position)
        enabled = self._enabled is not False if quick else await self._read(r.ENABLED, Urgency.POLL)
        return Look(at, position, moving, enabled)

    async def _stands_after_all(self, at: float, position: int) -> bool:
        """Whether the status is stuck, as some drives' is at "speed down": no speed and one position, twice."""
        last, self._stuck = self._stuck, None
        if await self._read(r.SPEED, Urgency.POLL) != 0:
            return False
        if last is not None and at - last.at >= _NO_SPEED_FOR and abs(position - last.position) <= _SAME:
            self._stuck = last
            return True
        self._stuck = Look(at, position, moving=True, enabled=True)
        return False

    async def _seems_to_move(self, rpm: float) -> bool:
        # One read, of status and speed in turns: one that pushes against a stop reports full speed, and none.
        self._asks_speed = not self._asks_speed and rpm >= _SHOWN_RPM
        if self._asks_speed:
            return await self._read(r.SPEED, Urgency.POLL) != 0
        return await self._read(r.STATUS, Urgency.POLL) is not Status.STOPPED

    async def _read_position(self) -> int:
        return await self._read(r.POSITION, Urgency.POLL)

    async def _read_velocity(self) -> float:
        speed = await self._read(r.SPEED, Urgency.POLL)
        return float(speed if self.positive is MotionDirection.CCW else -speed)

    async def _why(self, look: Look, target: int) -> MotionError:
        place = f"{self.name} stands {abs(target - look.position)} counts short of where it was sent"
        if await self._read(r.STALLED):
            # One that is not protected goes on pushing, and would jump as soon as the shaft is free.
            if not (await self._halted(self._halt(emergency=True))).standing:
                return self._unconfirmed()
            self._enabled = await self._read(r.ENABLED)
            return MotorStalled(f"{place}: the drive reports a stall. {hints([alarms.STALLED])}")
        start = self._way[0]
        between = min(start, target) - self.tolerance <= look.position <= max(start, target) + self.tolerance
        enabled = await self._read(r.ENABLED)
        if not enabled or not between:
            found = "is not enabled any more" if not enabled else "not even on the way there"
            self._enabled = enabled
            self._lost = f"it {found} in the middle of a move: the drive may have restarted."
            return ReferenceLost(f"{place}, and {found}: the drive may have restarted. home() it or set_zero().")
        inputs = await self._read(r.INPUTS)
        if self._near(look.position, 0):
            self._lost = "it stood still at zero before it had reached its target."
            return MoveFailed(
                f"{place}, at zero, with inputs {inputs!r}. The drive may have restarted. home() it or set_zero()."
            )
        return MoveFailed(f"{place}, with inputs {inputs!r}. A limit switch or another master may have stopped it.")

    async def _ask_setting(self, request: Request) -> None:
        """Write a setting, as often as it takes. 0x9A may take its time."""
        slow = request.register == r.SINGLE_TURN.address
        await self.bus.ask(request, reply_timeout=_SLOWEST_SETTING if slow else None)

    async def _check_zero(self, look: Look) -> None:
        """Where it stands at zero, notice that this is but the zero of a drive that has restarted."""
        if await self._has_forgotten_zero(look):
            raise ReferenceLost(f"{self.name}: {self._lost} home() it.")

    async def _has_forgotten_zero(self, look: Look) -> bool:
        # Anywhere else its position shows a restart.
        if self._homed is None or not self._near(look.position, 0) or await self._read_homed() == self._homed:
            return False
        self._lost = "its drive has forgotten that it was homed: it has restarted."
        self.bus.owner.stops.restarted(self.bus.owner.units[self.attached.address])
        self._forget()
        return True

    async def _check_came_to_zero(self, look: Look) -> None:
        """The same for a move that has ended there: a drive that restarts on its way counts from zero, too."""
        if self._near(look.position, 0) and not await self._read(r.ENABLED):
            self._enabled = False
            self._lost = "it is not enabled any more at the end of a move to zero: the drive may have restarted."
            self._forget()
            raise ReferenceLost(f"{self.name}: {self._lost} home() it or set_zero() first.")
        await self._check_zero(look)

    async def _must_stand(self, what: str) -> None:
        """Raise `NotStanding` where the motor turns. A status that is stuck needs a second look."""
        for _ in range(2):
            if not (await self._look(quick=True)).moving:
                return
            await anyio.sleep(2 * _NO_SPEED_FOR)
        raise NotStanding(f"{self.name} turns, and must stand for this: {what}. stop() it first. Nothing was sent.")

    # Commands

    def _check_mode(self) -> None:
        if not self.mode.is_serial:
            raise NotSupported(
                f"{self.name} is in mode {self.mode.name}, in which only pulses move it: set_mode(WorkMode.SR_VFOC)."
            )

    async def _prepare(self, *, standing: bool = True) -> Look:
        self._check_mode()
        seen = self._seen
        look = await super()._prepare(standing=standing)
        if standing and look is not seen:
            await self._check_zero(look)
        return look

    async def _begin(
        self,
        move: Move,
        before: Look,
        target: int | None,
        send: Callable[[], Awaitable[None]],
        *,
        once: bool = False,
    ) -> None:
        try:
            await super()._begin(move, before, target, send, once=once)
        except OutcomeUnknown as unknown:
            if before.moving and not self._blocked:
                await self._block(f"nobody knows which speed it has ({unknown})")
            raise

    async def _took(self, move: Move, before: Look, target: int | None, once: bool) -> bool:
        told = self._told_rpm
        if (
            target is None
            and before.moving
            and told is not None
            and ((await self._look_after(move)).moving or not told)
        ):
            # It turned before. One that has turned all the time has not restarted, and a speed may be said twice.
            return abs(await self._read_velocity() - told) <= max(_SAME_RPM, _SAME_SPEED * abs(told))
        took = await super()._took(move, before, target, once)
        if not took and target is not None:
            await self._check_zero(before)
        return took

    async def _carry_out_enable(self) -> None:
        self._check_mode()
        try:
            await super()._carry_out_enable()
        except (NotEnabled, DeviceRefused) as error:
            if isinstance(error, DeviceRefused) and error.code is not None:
                raise  # MKS drives refuse in their replies (2.4): this one has nothing to show on its screen
            raise NotEnabled(f"{error} {hints(alarms.KEEP_IT_OFF)}") from error
        if self._seen is not None:
            await self._has_forgotten_zero(self._seen)

    async def _send(self, block: Block, *values: Any) -> None:
        await self._ask_to_move(write_block(self.address, block, *values), block)

    async def _ask_to_move(self, request: Request, block: Block, slot: BurstSlot | None = None) -> None:
        await self.bus.ask(request, repeat=block.repeat, moves=True, motion=self.motion, slot=slot)

    async def _send_start(self, target: int, pace: Pace, slot: BurstSlot | None) -> None:
        # One frame says it all.
        self._plan_stop(r.MOVE_TO_COUNTS, (pace.ramp_code, 0, 0), pace)
        await self._ask_to_move(self.start_frame(target, pace), r.MOVE_TO_COUNTS, slot)

    def start_frame(self, target: int, pace: Pace) -> Request:
        return write_block(self.address, r.MOVE_TO_COUNTS, pace.ramp_code, self._speed_code(pace), target)

    async def _send_run(self, rpm: float, pace: Pace, ticks: int | None) -> None:
        self._told_rpm = rpm if ticks is None else None
        start = (self._direction(rpm), pace.ramp_code, self._speed_code(pace))
        stop = (MotionDirection.CCW, pace.ramp_code, 0)
        self._plan_stop(r.RUN, stop, pace)
        if not rpm:
            with contextlib.suppress(DeviceRefused):  # it was not turning, says 9.1.3; whoever waits for this looks
                await self._send(r.RUN, *stop)
        elif ticks is None:
            await self._send(r.RUN, *start)
        else:
            await self._send(r.RUN_FOR, *start, ticks)

    async def _send_enable(self, on: bool) -> None:
        await self.bus.ask(write(self.address, r.ENABLE, on))

    async def _send_zero(self) -> None:
        # Setting the zero of a standing motor twice is setting it once.
        await self.bus.ask(write(self.address, r.SET_ZERO, 1))
        homed = await self._read_homed()
        self._homed = homed if Homed.DONE in homed else None

    def _plan_stop(self, block: Block, stop: tuple[Any, ...], pace: Pace) -> None:
        """The stop that belongs to a move (8.2, 9.4.2): each kind of move has its own."""
        self._drive.ramp_stop = write_block(self.address, block, *stop)
        self._drive.ramp_takes = pace.rpm / pace.acceleration

    # What the drive can do

    def _paced(self, rpm: float, acceleration: float) -> Pace:
        factor = self._speed_factor
        speed = max(1, round(rpm * factor))
        ramp, real = self._ramp(acceleration)
        return Pace(speed / factor, real, speed, ramp)

    @property
    def rpm_step(self) -> float:
        return 1 / self._speed_factor

    def lowest_acceleration(self, rpm: float) -> float:
        return _RAMP_UNIT / 255

    @property
    def _speed_factor(self) -> float:
        """What a speed value is of an rpm: it turns the shaft at value * 16 / microsteps where not calibrated (7.1)."""
        return 1.0 if self.microsteps in _CALIBRATED else self.microsteps / 16

    @property
    def _fastest(self) -> tuple[float, str]:
        highest = min(self.mode.max_rpm, int(r.MAX_SPEED / self._speed_factor))
        return highest, f"mode {self.mode.name} at {self.microsteps} microsteps"

    def _speed_code(self, pace: Pace) -> int:
        """How its speed is said now. The microsteps may have been changed since the pace was made."""
        self._check_speed(pace.rpm)
        return max(1, round(pace.rpm * self._speed_factor))

    def _direction(self, forward: float) -> MotionDirection:
        """The direction of 0xF6 and 0xFD in which the drive's position grows, or that of a negative number."""
        return self.positive if forward >= 0 else MotionDirection(1 - self.positive)

    def _ramp(self, acceleration: float) -> tuple[int, float]:
        """The code that comes nearest to an acceleration, and what it makes (7.1)."""
        if acceleration == math.inf:
            return 0, math.inf
        lowest = self.lowest_acceleration(1)
        if not lowest - 0.5 <= acceleration <= _RAMP_UNIT:
            raise LimitExceeded(
                f"{self.name}: acceleration {acceleration:g} rpm/s is outside {lowest:.1f}..{_RAMP_UNIT:g} rpm/s; "
                "infinity is a jump"
            )
        code = min(255, max(1, 256 - round(_RAMP_UNIT / acceleration)))
        return code, _RAMP_UNIT / (256 - code)

    def _ticks(self, duration: float) -> int:
        if not _TICK / 2 < duration <= r.MAX_RUN_TIME * _TICK:
            raise LimitExceeded(f"{self.name}: duration {duration:g} s is outside 0.01..{r.MAX_RUN_TIME * _TICK:.0f} s")
        return round(duration / _TICK)

    # What the bus says

    def _heard(self, request: Request, reply: bytes) -> None:
        """The answer to a feed: the motor stands, perhaps earlier than it should."""
        if request.register == r.STATUS.address and payload(reply)[-1] == Status.STOPPED:
            self.told_standing()
