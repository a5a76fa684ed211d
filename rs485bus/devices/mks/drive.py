"""An MKS drive carrying out moves: what the shared axis leaves to the family. Source: MKS RTU V1.0.9."""

from __future__ import annotations

import math
from typing import Any, TypeVar

from rs485bus.bus.bus import Bus
from rs485bus.bus.job import Urgency
from rs485bus.devices.axis import Axis
from rs485bus.devices.conduct import Look, Pace
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.attached import FAMILY, MksAttached
from rs485bus.devices.mks.frames import read, write, write_block
from rs485bus.devices.mks.values import Model, MotionDirection, Status, WorkMode
from rs485bus.errors import LimitExceeded, MotionError, MotorStalled, MoveFailed, ReferenceLost
from rs485bus.wire.frames import Request, payload
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")

_CALIBRATED = (16, 32, 64)
"""The microsteps at which a speed value is rpm (7.1)."""
_RAMP_UNIT = 20_000.0
"""rpm/s times (256 - code): one rpm every (256 - code) * 50 µs (7.1)."""
_TICK = 0.01
_NO_SPEED_FOR = 0.01
_SAME = 2


class MksDrive(Axis):
    """One drive, as `MksServo` without its settings and homing."""

    counts_per_turn = r.COUNTS_PER_TURN

    def __init__(
        self,
        bus: Bus,
        address: int,
        *,
        model: Model,
        mode: WorkMode,
        microsteps: int,
        units_per_turn: float,
        reverse: bool,
        positive: MotionDirection,
        limits: tuple[float, float] | None,
        rpm: float,
        acceleration: float,
        tolerance: int,
    ) -> None:
        self.address = address
        self.model = model
        self.mode = mode
        self.microsteps = r.MICROSTEPS.raw(microsteps)
        self.positive = positive
        self._drive = MksAttached(address, self._heard, self._was_interrupted)
        self._stuck: Look | None = None
        super().__init__(
            bus,
            self._drive,
            self._drive.motion,
            f"{FAMILY} {address}",
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

    async def _read_position(self) -> int:
        return await self._read(r.POSITION)

    async def _read_velocity(self) -> float:
        speed = await self._read(r.SPEED)
        return float(speed if self.positive is MotionDirection.CCW else -speed)

    async def _why(self, look: Look, target: int) -> MotionError:
        place = f"{self.name} stands {abs(target - look.position)} counts short of where it was sent"
        if await self._read(r.STALLED):
            return MotorStalled(
                f"{place}: the drive reports a stall. Free the shaft, or give it more current or less acceleration; "
                "then release_stall() and enable()."
            )
        if not await self._read(r.ENABLED):
            self._enabled = False
            self._lost = "its motor is not enabled any more in the middle of a move: the drive may have restarted."
            return ReferenceLost(f"{place}, and is not enabled any more: the drive may have restarted. home() it.")
        self._lost = "it stood still before it had reached its target."
        inputs = await self._read(r.INPUTS)
        return MoveFailed(
            f"{place}, with inputs {inputs!r}. A limit switch may have stopped it, or the drive may have restarted. "
            "home() it or set_zero()."
        )

    # Commands

    async def _send(self, block: Block, *values: Any) -> None:
        await self.bus.ask(
            write_block(self.address, block, *values), repeat=block.repeat, moves=True, motion=self.motion
        )

    async def _send_move(self, target: int, pace: Pace) -> None:
        self._plan_stop(r.MOVE_TO_COUNTS, (pace.ramp_code, 0, 0), pace)
        await self._send(r.MOVE_TO_COUNTS, pace.ramp_code, pace.speed_code, target)

    async def _send_run(self, rpm: float, pace: Pace, ticks: int | None) -> None:
        forward = (rpm >= 0) == (self.positive is MotionDirection.CCW)
        direction = MotionDirection.CCW if forward else MotionDirection.CW
        speed = pace.speed_code if rpm else 0
        self._plan_stop(r.RUN, (MotionDirection.CCW, pace.ramp_code, 0), pace)
        if ticks is None:
            await self._send(r.RUN, direction, pace.ramp_code, speed)
        else:
            await self._send(r.RUN_FOR, direction, pace.ramp_code, speed, ticks)

    async def _send_enable(self, on: bool) -> None:
        await self.bus.ask(write(self.address, r.ENABLE, on))

    async def _send_zero(self) -> None:
        # Setting the zero of a standing motor twice is setting it once.
        await self.bus.ask(write(self.address, r.SET_ZERO, 1))

    def _plan_stop(self, block: Block, stop: tuple[Any, ...], pace: Pace) -> None:
        """The stop that belongs to a move (8.2, 9.4.2): each kind of move has its own."""
        self._drive.ramp_stop = write_block(self.address, block, *stop)
        self._drive.ramp_takes = 0.0 if math.isinf(pace.acceleration) else pace.rpm / pace.acceleration

    # What the drive can do

    def _pace(self, rpm: float | None, acceleration: float | None) -> Pace:
        wanted = self.rpm if rpm is None else rpm
        # A speed value turns the shaft at value * 16 / microsteps where it is not calibrated.
        factor = 1.0 if self.microsteps in _CALIBRATED else self.microsteps / 16
        highest = min(self.mode.max_rpm, int(r.MAX_SPEED / factor))
        if not 0 < wanted <= highest:
            raise LimitExceeded(
                f"{self.name}: {wanted:g} rpm is outside 0..{highest} rpm of mode {self.mode.name} at "
                f"{self.microsteps} microsteps"
            )
        speed = max(1, round(wanted * factor))
        ramp, real = self._ramp(self.acceleration if acceleration is None else acceleration)
        return Pace(speed / factor, real, speed, ramp)

    def _ramp(self, acceleration: float) -> tuple[int, float]:
        """The code that comes nearest to an acceleration, and what it makes (7.1)."""
        if math.isinf(acceleration):
            return 0, math.inf
        lowest = _RAMP_UNIT / 255
        if not lowest - 0.5 <= acceleration <= _RAMP_UNIT:
            raise LimitExceeded(
                f"{self.name}: acceleration {acceleration:g} rpm/s is outside {lowest:.1f}..{_RAMP_UNIT:g} rpm/s; "
                "infinity is a jump"
            )
        code = min(255, max(1, 256 - round(_RAMP_UNIT / acceleration)))
        return code, _RAMP_UNIT / (256 - code)

    def _ticks(self, duration: float) -> int:
        ticks = round(duration / _TICK)
        if not 1 <= ticks <= r.MAX_RUN_TIME:
            raise LimitExceeded(f"{self.name}: duration {duration:g} s is outside 0.01..{r.MAX_RUN_TIME * _TICK:.0f} s")
        return ticks

    # What the bus says

    def _heard(self, request: Request, reply: bytes) -> None:
        """The answer to a feed: the motor stands, perhaps earlier than it should."""
        if request.register == r.STATUS.address and payload(reply)[-1] == Status.STOPPED:
            self.told_standing()
