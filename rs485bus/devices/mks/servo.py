"""MKS SERVO28D/35D/42D/57D as an axis. Source: MKS RTU V1.0.9, the section named at each method."""

from __future__ import annotations

import warnings
from typing import Any, TypeVar

from rs485bus.arguments import choice
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.mks import own_moves, service
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive, MksWatchdog
from rs485bus.devices.mks.frames import read, write, write_block
from rs485bus.devices.mks.homing import Homing, homing_frames
from rs485bus.devices.mks.own_moves import OwnMove
from rs485bus.devices.mks.search import find_origin, return_to_zero
from rs485bus.devices.mks.settings import check_outputs
from rs485bus.devices.mks.setup import MksSetup
from rs485bus.devices.mks.status import Encoder, Homings, MksStatus
from rs485bus.devices.mks.values import Inputs, Model, MotionDirection, OutputMask, Status, WorkMode
from rs485bus.errors import LimitExceeded, MotionError
from rs485bus.motion.move import Move
from rs485bus.motion.plan import Ask, Plan
from rs485bus.motion.supervisor import Supervisor
from rs485bus.wire.frames import Request, payload, unit_address
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")


class MksServo(MksSetup):
    """An MKS SERVO drive and its motor.

    A drive that restarts counts from zero where it then stands, and says nothing of it. It is noticed by a jump of the
    position, by the enabling, and by the homing status where an origin was found. One that was set to zero only, left
    several requests unanswered and is found at zero is not trusted (`ReferenceLost`). `home()` where that does not do.

    Args:
        bus: the bus it is on.
        address: 1..247.
        model: which drive; it limits the current, and only a 57D has outputs.
        mode: the work mode it is set to. It cannot be read; `set_mode` sets it. The bus moves it in the SR modes only.
        microsteps: what it is set to, 1..255. At others than 16, 32 and 64 the drive takes speeds for something else
            (7.1); that is compensated for.
        units_per_turn: positions are in units of this many to a turn of the motor; 1 for turns.
        reverse: whether positive is the other way round. Which way the shaft then turns is not promised.
        positive: the direction of 0xF6 and 0xFD in which the position of 0x31 grows. The manual's text and its
            examples disagree (3.1.1, 3.1.2); where `run` goes the other way than `move_to`, it is
            `MotionDirection.CW`.
        limits: lowest and highest position that may be gone to, in units.
        rpm: the speed of moves that name none.
        acceleration: the acceleration of moves that name none: 78.4..20000 rpm/s.
        tolerance: counts (1/16384 turn) by which an axis that has arrived may differ from its target; None for 1°.

    Raises:
        AddressInUse: there is a facade for this address already.
        LimitExceeded, ValueError: an argument is out of its range.
        TypeError: one is of a wrong type.
    """

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
        tolerance: int | None = None,
    ) -> None:
        self.address = unit_address(address)
        self._mks = MksDrive(
            self.address,
            model=choice("model", model, Model),
            mode=choice("mode", mode, WorkMode),
            microsteps=r.MICROSTEPS.raw(microsteps),
            positive=choice("positive", positive, MotionDirection),
        )
        self._silent = False
        super().__init__(
            bus,
            self._mks,
            0,
            self._mks.name,
            Supervisor(bus, self._mks),
            units_per_turn=units_per_turn,
            reverse=reverse,
            limits=limits,
            rpm=rpm,
            acceleration=acceleration,
            tolerance=tolerance,
        )
        self._mks.on_interrupted = self._was_interrupted
        bus.attach(self)

    @property
    def model(self) -> Model:
        """Which drive it is."""
        return self._mks.model

    @model.setter
    def model(self, model: Model) -> None:
        self._mks.model = choice("model", model, Model)

    @property
    def mode(self) -> WorkMode:
        """The work mode, as far as is known: it cannot be read."""
        return self._mks.mode

    @property
    def microsteps(self) -> int:
        """The microsteps, as far as is known: they cannot be read."""
        return self._mks.microsteps

    # Verbs

    def home(self, homing: Homing | None = None, *, timeout: float = 60.0) -> Move:
        """Find the origin, and make it zero (5.1).

        Args:
            homing: `SwitchHoming`, `StopHoming` or `SingleTurnHoming`; None for what the drive is set up for.
            timeout: seconds after which the axis is stopped and `HomingFailed` raised.

        Raises:
            LimitExceeded: a value is out of its range; nothing is queued.
            TypeError: one is of a wrong type; nothing is queued.
        """
        seconds = self._time("timeout", timeout)
        if homing is not None:
            homing_frames(self.address, self.model, homing)
        return self._seek("home", lambda: find_origin(self._mks, homing, seconds))

    def return_to_zero(self, *, timeout: float = 60.0) -> Move:
        """Go straight to the coordinate zero, at the drive's own speed (5.2). The motor must be enabled.

        Args:
            timeout: seconds after which the axis is stopped and `HomingFailed` raised.
        """
        seconds = self._time("timeout", timeout)
        return self._seek("return to zero", lambda: return_to_zero(self._mks, seconds), by_reference=True)

    def retarget(self, position: float, *, rpm: float | None = None, acceleration: float | None = None) -> Handle[None]:
        """Change target, speed and acceleration of the `move_to` or `move_by` under way, without a stop.

        The move keeps its handle, and is done where it goes now. The handle returned is done once the drive took the
        change. Arguments as for `move_to`.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is sent.
            MotionError: no such move is under way (`move.state` is not `MoveState.MOVING`).
        """
        return self._commands.retarget(position, self._pace(rpm, acceleration))

    def move_by_pulses(self, pulses: int, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go so many pulses, by a relative command (9.1). `move_by` is safer: it can be said twice.

        Pulses are 200 times the microsteps a turn, counts 0x4000 a turn; both have the sign of positions. Whether the
        drive counts both in the same direction only hardware tells: where it does not, such a move fails.

        Where its answer is lost, it is said again only if status and position show that it was not taken. A move too
        short to tell raises `OutcomeUnknown` then, and the axis moves only after `enable()`.

        Args:
            pulses: -4294967295..4294967295, not 0.
            rpm: the speed, above 0.
            acceleration: in rpm/s; infinity for a jump.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is queued.
        """
        return self._go_as(own_moves.by_pulses(self._mks, self._sign, self._whole("pulses", pulses)), rpm, acceleration)

    def move_by_counts(self, counts: int, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go so many counts, by a relative command (9.3). As `move_by_pulses`, for -2147483648..2147483647 counts.

        It also goes where `move_to` and `move_by` cannot: beyond the 32 bits of an absolute target.
        """
        return self._go_as(own_moves.by_counts(self._mks, self._sign, self._whole("counts", counts)), rpm, acceleration)

    def move_to_pulses(self, pulses: int, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go to a position counted in pulses from zero (9.2): -2147483648..2147483647. Else as `move_to`."""
        return self._go_as(own_moves.to_pulses(self._mks, self._sign, self._whole("pulses", pulses)), rpm, acceleration)

    # Outside of its work. What takes a drive away for a while is refused while any watchdog on the bus is armed.

    def set_outputs(
        self, *, out_1: bool | OutputMask = OutputMask.LEAVE, out_2: bool | OutputMask = OutputMask.LEAVE
    ) -> Handle[None]:
        """Set the outputs of a 57D (4.2). They fall back at power-off.

        Args:
            out_1: its level, or what else is done with it. The manual has two ways not to write one, `LEAVE` (the
                default there, too) and `HOLD`; whether they differ only hardware tells.
            out_2: the same.

        Raises:
            NotSupported: another drive than a 57D; nothing is queued.
        """
        check_outputs(self.model)
        return self._ask_setting("outputs", write_block(self.address, r.OUTPUTS, *_output(out_2), *_output(out_1)))

    def clear_fault(self) -> Handle[None]:
        """End the state of a stall (3.4.4), the one fault that the drive reports. Raises `MotorStalled` if it lasts.

        The motor then holds again where the drive says `enabled`.
        """
        return self._order_plan("release of a stall", lambda: service.release_stall(self._mks))

    def release_stall(self) -> Handle[None]:
        """The same as `clear_fault`."""
        return self.clear_fault()

    def set_power_on_run(self, on: bool, *, while_running: bool = False) -> Handle[None]:
        """Whether the drive runs by itself when it is switched on, as its last speed command said (8.3).

        **It will then turn without anybody telling it to.** The motor must stand: `run`, `stop`, then this. Whether a
        drive still knows its last speed command then only hardware tells; try it with a free shaft.

        Args:
            on: whether it does.
            while_running: send it while the motor turns, as 8.5 logs it; the motor then slows down and stops.
        """
        return self._order_plan("power-on run", service.set_power_on_run(self._mks, on, while_running))

    def set_heartbeat(self, seconds: float) -> Handle[None]:
        """The time after which the drive stops its motor where it hears nothing: 0 (off) to 4294967.295 s (3.2.14).

        `watchdog` sets it and keeps it fed; where it is set like this, nobody feeds it.

        Raises:
            LimitExceeded: out of range; nothing is queued. Awaited, `MotionError`: a watchdog block sets it.
        """
        wanted = self._number("heartbeat time", seconds) * 1000
        if not wanted == 0 and not 1 <= wanted <= MksWatchdog.highest:  # less than one would turn it off
            raise LimitExceeded(
                f"{self.name}: heartbeat time {seconds:g} s is outside 0.001..{MksWatchdog.highest / 1000} s; 0 is off"
            )

        def plan() -> Plan[None]:
            if self.bus.owner.feeding.get(self.address) is not None:
                raise MotionError(f"{self.name} is guarded by a watchdog block, which sets its heartbeat time.")
            yield Ask(write(self.address, r.WATCHDOG, round(wanted)))

        return self._order_plan("heartbeat time", plan)

    def calibrate(self, *, timeout: float = 60.0) -> Handle[None]:
        """Calibrate the encoder (3.2.1). The shaft must be free: it turns by itself, and the drive restarts.

        Whether it succeeded cannot be read; the screen tells (`alarms.AFTER_CALIBRATION`). Then `enable` and home.

        Args:
            timeout: seconds after which a drive that has not come back makes the handle raise `MotionError`.
        """
        return self._order_restart("calibration", service.calibrate, timeout)

    def restart(self, *, timeout: float = 10.0) -> Handle[None]:
        """Start the drive anew (3.5.2). It counts from zero then: `enable`, and `home` or `set_zero`. As `calibrate`
        otherwise."""
        return self._order_restart("restart", service.restart, timeout)

    def factory_reset(self, *, timeout: float = 10.0) -> Handle[None]:
        """Make all settings those of the factory, and restart (3.5.1). As `restart` otherwise.

        Do it with no other drive on the pair: whether address and baud rate are reset, too, only hardware tells, and
        then it answers at address 1 and 38400 bit/s. Work mode and microsteps are written again before it moves.
        """
        return self._order_restart("factory reset", service.factory_reset, timeout)

    def silence(self) -> Handle[None]:
        """Have the drive answer nothing, so that another one's firmware can be loaded, until `wake` (3.6).

        The motor must stand. The drive cannot be stopped over the bus meanwhile.
        """

        def plan() -> Plan[None]:
            yield from service.silence(self._mks)
            self._silent = True

        return self._order_plan("silence", plan)

    def wake(self) -> Handle[None]:
        """Have a silent drive answer again (3.6), also one that some other program silenced."""

        def plan() -> Plan[None]:
            yield from service.wake(self._mks)
            self._silent = False

        handle: Handle[None] = Handle(f"wake of {self.name}", self._commands.unseen)
        self._stops.queue.add(handle, lambda: self._executor.carry(plan))
        return handle

    def enter_boot(self) -> Handle[None]:
        """Restart the drive into its boot mode, where it waits for firmware (3.6). It answers no Modbus from then on.

        The motor must stand; `silence` all other drives first. Switched off and on, it works as before.
        """

        def plan() -> Plan[None]:
            yield from service.enter_boot(self._mks)
            self._stops.blocked = "it was sent to boot mode"

        return self._order_plan("boot mode", plan)

    # Questions. Each raises `NoReply`, or `NotSent` and what is derived from it.

    async def status(self) -> MksStatus:
        """All that tells how the drive is."""
        status = await self.motor_status()
        enabled = await self.enabled()
        homed = await self.homed()
        return MksStatus(status, enabled, homed.origin, homed.single_turn, await self.stalled(), await self.inputs())

    async def motor_status(self) -> Status:
        """What the motor does (7.2.1). Some drives have been seen stuck at "slowing down" while they stand."""
        return await self._read(r.STATUS)

    async def running(self) -> Status:
        """The former name of `motor_status`: it is true for a standing motor, too."""
        warnings.warn("MksServo.running() is motor_status() now", DeprecationWarning, stacklevel=2)
        return await self.motor_status()

    async def enabled(self) -> bool:
        """Whether the motor is energised (3.1.6)."""
        return await self._read(r.ENABLED)

    async def homed(self) -> Homings:
        """How the homings stand (3.1.7)."""
        return Homings(*r.HOMED.decode(await self._payload(r.HOMED)))

    async def stalled(self) -> bool:
        """Whether the drive has noticed a stall (3.4.3)."""
        return await self._read(r.STALLED)

    async def inputs(self) -> Inputs:
        """The levels of the ports (4.1). With remapped limits IN_1 is En and IN_2 is Dir."""
        return await self._read(r.INPUTS)

    async def counts(self) -> int:
        """The coordinate: 48 bits, 0x4000 counts a turn (3.1.2). `position` is this in the axis' units."""
        return await self._read(r.POSITION)

    async def encoder(self) -> Encoder:
        """The encoder as carry and value (3.1.1)."""
        return Encoder(*r.ENCODER.decode(await self._payload(r.ENCODER)))

    async def pulses(self) -> int:
        """The pulses received, 200 times the microsteps a turn, as 32 bits without a sign (3.1.4)."""
        return await self._read(r.PULSES)

    async def angle_error(self) -> float:
        """By how much the shaft differs from where it should be, in degrees (3.1.5)."""
        return await self._read(r.ANGLE_ERROR)

    async def version(self) -> int:
        """The version of the firmware, 32 bits of which the manual gives no layout (3.1.8)."""
        return await self._read(r.VERSION)

    # Inside

    def check_ready(self) -> None:
        super().check_ready()
        if self._silent:
            raise MotionError(f"{self.name} was silenced and answers nothing: wake() it first.")

    async def _read(self, register: Register[T]) -> T:
        return register.decode(await self._payload(register))

    async def _payload(self, what: Register[Any] | Block) -> bytes:
        return payload(await self.bus.ask(read(self.address, what), urgency=Urgency.POLL))

    def _ask_setting(self, what: str, request: Request) -> Handle[None]:
        def plan() -> Plan[None]:
            yield Ask(request)

        return self._order_plan(what, plan)

    def _go_as(self, own: OwnMove, rpm: float | None, acceleration: float | None) -> Move:
        """Queue a move that is told in the drive's own units."""
        return self._commands.go_by_plan(own.what, self._pace(rpm, acceleration), own.target_from, own.plan)

    def _whole(self, what: str, value: float) -> int:
        """A whole number, which may be given as a float."""
        number = self._number(what, value)
        if not number.is_integer():
            raise LimitExceeded(f"{self.name}: {what} {value!r} is not a whole number")
        return int(number)


def _output(wanted: bool | OutputMask) -> tuple[OutputMask, bool]:
    return (wanted, False) if isinstance(wanted, OutputMask) else (OutputMask.WRITE, wanted)
