"""TL-R integrated steppers as an axis. Source: TL-R manual, the section named at each method."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rs485bus.arguments import flag, instance, positive, whole
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.alarms import Alarm, alarm_of
from rs485bus.devices.tlr.drive import TlrDrive
from rs485bus.devices.tlr.frames import read
from rs485bus.devices.tlr.homing import Homing, find_origin
from rs485bus.devices.tlr.parameters import TlrParameters
from rs485bus.devices.tlr.ports import Inputs, Outputs
from rs485bus.devices.tlr.setup import TlrSetup
from rs485bus.devices.tlr.tables import Paths, SpeedPaths
from rs485bus.devices.tlr.values import Auxiliary, Ports, StatusWord
from rs485bus.errors import DriveFault
from rs485bus.motion.move import Move
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Know, Plan
from rs485bus.motion.sample import AxisStatus
from rs485bus.motion.state import Fact
from rs485bus.motion.supervisor import Supervisor
from rs485bus.wire.frames import payload, unit_address


@dataclass(frozen=True, slots=True)
class TlrStatus(AxisStatus):
    """What a drive reports of itself, of one moment (3.5.1)."""

    word: StatusWord
    alarm: Alarm | None
    inputs: Ports
    outputs: Ports
    position: float
    """In units of the axis. Of an open loop that of the command, of a closed one that of the encoder."""
    rpm: float
    enabled: bool
    """Whether the motor was told to hold, as far as is known; by bit 4 where the axis was made with
    `enabled_bit=True`."""

    @property
    def in_position(self) -> bool:
        """Whether the drive says that it has arrived."""
        return StatusWord.IN_POSITION in self.word

    @property
    def homed(self) -> bool:
        """Soft limits count only if it is."""
        return StatusWord.HOMED in self.word

    @property
    def running(self) -> bool:
        """Whether the drive says that the motor turns."""
        return StatusWord.RUNNING in self.word

    @property
    def moving(self) -> bool:
        return self.running

    @property
    def fault(self) -> bool:
        """Whether the drive says that it has a fault; `alarm` says which."""
        return StatusWord.FAULT in self.word

    @property
    def faulty(self) -> bool:
        return self.fault or self.alarm is not None

    @property
    def says_enabled(self) -> bool:
        """Bit 4. It is reported here and relied on nowhere, unless the axis was made with `enabled_bit=True`."""
        return StatusWord.ENABLED in self.word


@dataclass(frozen=True, slots=True)
class Version:
    """What the drive runs, and what it is made of."""

    software: int
    hardware: int


class TlrStepper(TlrSetup):
    """A TL-R integrated stepper: TLC (closed loop) and TLO (open loop) 42, 57, 60 and 86.

    It has no watchdog, and does not notice when the host is gone: `watchdog()` raises `NotSupported`. Have a safety
    relay cut its power that something else watches. So that it ends by itself, a `run` for a time is a positioning.

    Whether its motor is held cannot be read reliably: it moves after `enable()` only, and after a restart only when
    that was done again. A restart shows in that 0x33 to 0x38 do not hold any more what was written to them.

    Args:
        bus: the bus it is on, as shipped at 115200, no parity.
        address: 1..247.
        pulses_per_turn: None for its subdivision (0x23), which it is asked for.
        units_per_turn: positions are in units of this many to a turn of the motor; 1 for turns.
        reverse: whether positive is the other way round. Which way the shaft then turns is not promised.
        limits: lowest and highest position that may be gone to, in units.
        rpm: the speed of moves that name none: 1..3000.
        acceleration: the acceleration of moves that name none, in rpm/s: at least half the speed in rpm, for ramps
            take 2 s at most; infinity for a jump.
        deceleration: the same for slowing down; None for as fast as it gets faster.
        start_rpm: the speed at which moves begin: 0..3000.
        tolerance: pulses by which an axis that has arrived may differ from its target; None for 1°.
        clear_trigger: write 0 to the control word before what starts something. False saves a frame where the drive
            starts at each write (the manual says of some bits that they need no reset, of others that they must rise).
        block_writes: write what belongs together in one request. Some firmware keeps only a part of five registers or
            more; that is noticed, and they are written singly from then on. False to do so from the beginning.
        keeps_target: 0x33 to 0x38 hold what was written until the drive is switched off. False where a move uses them
            up: then only a jump of its position shows that a drive has restarted.
        enabled_bit: rely on status bit 4.
        live_jog: a jog under way takes another speed. False to stop it before.
        ramp_rpm: the speed that the times of ramps refer to; None for the speed of the move. The manual does not say.

    Raises:
        AddressInUse: there is a facade for this address already.
        LimitExceeded, ValueError: an argument is out of its range.
        TypeError: one is of a wrong type.
    """

    def __init__(
        self,
        bus: Bus,
        address: int,
        *,
        pulses_per_turn: int | None = None,
        units_per_turn: float = 1.0,
        reverse: bool = False,
        limits: tuple[float, float] | None = None,
        rpm: float = 300.0,
        acceleration: float = 2000.0,
        deceleration: float | None = None,
        start_rpm: int = 0,
        tolerance: int | None = None,
        clear_trigger: bool = True,
        block_writes: bool = True,
        keeps_target: bool = True,
        enabled_bit: bool = False,
        live_jog: bool = False,
        ramp_rpm: float | None = None,
    ) -> None:
        self.address = unit_address(address)
        self._tlr = TlrDrive(
            self.address,
            pulses_per_turn=None if pulses_per_turn is None else whole("pulses_per_turn", pulses_per_turn, 1),
            start_rpm=r.START_SPEED.raw(start_rpm),
            clear_trigger=flag("clear_trigger", clear_trigger),
            block_writes=flag("block_writes", block_writes),
            keeps_target=flag("keeps_target", keeps_target),
            enabled_bit=flag("enabled_bit", enabled_bit),
            live_jog=flag("live_jog", live_jog),
            ramp_rpm=None if ramp_rpm is None else positive("ramp_rpm", ramp_rpm),
        )
        super().__init__(
            bus,
            self._tlr,
            0,
            self._tlr.name,
            Supervisor(bus, self._tlr),
            units_per_turn=units_per_turn,
            reverse=reverse,
            limits=limits,
            rpm=rpm,
            acceleration=acceleration,
            tolerance=tolerance,
        )
        self.deceleration = deceleration
        self._last_run: MotionParameters | None = None
        self._with_ramp_down(self._pace(None, None), None)
        self._parameters = TlrParameters(bus, self._tlr, self._order_plan, self._executor.carry)
        self.paths = Paths(self._parameters, self._to_counts, self._to_units)
        """Where inputs can send it: `paths[3] = Path(12.5, rpm=600)`, `await paths[3]`."""
        self.speed_paths = SpeedPaths(self._parameters, self._sign)
        """How fast inputs can turn it."""
        self.inputs = Inputs(self._parameters)
        """What the inputs do: `inputs[3] = DiFunction.STOP`."""
        self.outputs = Outputs(self._parameters)
        """What the outputs tell."""
        self._tlr.on_interrupted = self._was_interrupted
        bus.attach(self)

    # Verbs

    def move_to(
        self,
        position: float,
        *,
        rpm: float | None = None,
        acceleration: float | None = None,
        deceleration: float | None = None,
    ) -> Move:
        """Go to a position. As `Axis.move_to`, with a ramp down of its own (3.1.1).

        Args:
            position: in the axis' units.
            rpm: the speed, above 0.
            acceleration: in rpm/s; infinity for a jump.
            deceleration: the same for slowing down; None for the axis' own, or as fast as it gets faster.
        """
        return self._go(self._ramps(rpm, acceleration, deceleration), self._commands.goal_to(position))

    def move_by(
        self,
        distance: float,
        *,
        rpm: float | None = None,
        acceleration: float | None = None,
        deceleration: float | None = None,
    ) -> Move:
        """Go a distance. As `Axis.move_by`, with a ramp down of its own, as `move_to`."""
        return self._go(self._ramps(rpm, acceleration, deceleration), self._commands.goal_by(distance))

    def run(
        self,
        rpm: float,
        *,
        acceleration: float | None = None,
        deceleration: float | None = None,
        duration: float | None = None,
        replace: bool = False,
    ) -> Move:
        """Turn at a speed. As `Axis.run`, with a ramp down of its own, as `move_to`.

        The drive knows no time, and does not notice when nobody is there to stop it: for a `duration` it is sent to
        where it should be then, within the axis' `limits`.
        """
        speed = self._number("rpm", rpm)
        parameters = self._ramps(abs(speed) or None, acceleration, deceleration)
        if not speed:
            parameters = self._last_run or parameters  # a jog slows down as it was told when it began
        if duration is None or not speed:
            self._last_run = parameters
            return self._run_at(speed, parameters, None, None, replace=replace)
        seconds = self._number("duration", duration)
        self._ability.ticks(seconds)
        turns = math.copysign(_turns_in(parameters, seconds), self._sign * speed)
        return self._commands.go_by_plan(
            f"run at {rpm:g} rpm",
            parameters,
            lambda start: start + round(turns * self.counts_per_turn),
            lambda target, told: self._tlr.move(0, target, told),
        )

    def release(self) -> Handle[None]:
        """Let go of the shaft, once what is queued before it is done and the motor stands. The same as `disable`."""
        return self.disable()

    def home(self, homing: Homing | None = None, *, timeout: float = 60.0) -> Move:
        """Find the origin. Positions can be trusted then, and soft limits count.

        The handle gives the position reached: 0, unless there is an offset.

        Args:
            homing: how; None for what the drive is set to.
            timeout: seconds after which the axis is stopped and `HomingFailed` raised.

        Raises:
            LimitExceeded: a value is out of its range; nothing is queued.
            TypeError: one is of a wrong type; nothing is queued.
        """
        seconds = self._time("timeout", timeout)
        if homing is not None:
            instance("homing", homing, Homing, "Homing(mode=HomingMode.NEGATIVE_LIMIT)").check(self.name)

        def plan() -> Plan[None]:
            offset = 0 if homing is None else self._to_counts(homing.offset)
            return find_origin(self._tlr, homing, offset, seconds)

        return self._seek("home", plan, at_zero=homing is not None and homing.offset == 0)

    def retarget(self, position: float, *, rpm: float | None = None, acceleration: float | None = None) -> Handle[None]:
        """Change target, speed and acceleration of the `move_to` or `move_by` under way, without a stop.

        The move keeps its handle, and is done where it goes now. The handle returned is done once the drive took the
        change. Arguments as for `move_to`.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is sent.
            MotionError: no such move is under way (`move.state` is not `MoveState.MOVING`).
        """
        return self._commands.retarget(position, self._pace(rpm, acceleration))

    def clear_fault(self) -> Handle[None]:
        """End an alarm whose cause is gone (3.6). The motor is held again after `enable()`.

        Raises:
            DriveFault: it is still there. It says what to do, and whether the drive must be switched off and on.
        """

        def plan() -> Plan[None]:
            yield from self._tlr.writer.auxiliary(Auxiliary.CLEAR_ALARM)
            yield Know((Fact.FAULT,), afresh=True)
            fault = self._tlr.axis.value(Fact.FAULT)
            if fault:
                raise DriveFault(f"{self.name} still reports {fault}.")

        return self._parameters.order("clear_fault", plan)

    def clear_alarm(self) -> Handle[None]:
        """The same as `clear_fault`."""
        return self.clear_fault()

    # Questions

    async def status(self) -> TlrStatus:
        """What the drive reports."""
        await self.set_up()
        reply = await self.bus.ask(read(self.address, r.TELEMETRY), urgency=Urgency.POLL)
        word, alarm, inputs, outputs, position, rpm = r.TELEMETRY.decode(payload(reply))
        enabled = StatusWord.ENABLED in word if self._tlr.enabled_bit else bool(self._state.holds)
        speed = float(self._sign * rpm)
        return TlrStatus(word, alarm_of(alarm), inputs, outputs, self._to_units(position), speed, enabled)

    async def version(self) -> Version:
        """What the drive runs. The two columns are swapped in 3.5.1; the names are taken."""
        return Version(await self.read(r.SOFTWARE_VERSION), await self.read(r.HARDWARE_VERSION))

    async def set_up(self) -> None:
        """Ask for what must be known before anything else, if that is not known. Every verb and question does so."""
        await self._parameters.set_up()

    # Inside

    def _ramps(self, rpm: float | None, acceleration: float | None, deceleration: float | None) -> MotionParameters:
        """What the drive can be told of a speed and two ramps. Raises as verbs do."""
        return self._with_ramp_down(self._pace(rpm, acceleration), deceleration)

    def _with_ramp_down(self, parameters: MotionParameters, deceleration: float | None) -> MotionParameters:
        wanted = self.deceleration if deceleration is None else deceleration
        if wanted is None:
            return parameters
        rate = self._number("deceleration", wanted)
        parameters = self._tlr.ability(0).braking(parameters, rate)
        self._scale.check_as_asked("deceleration", rate, parameters.slowing_down, "rpm/s")
        return parameters


def _turns_in(parameters: MotionParameters, seconds: float) -> float:
    """How far a run goes that slows down after so many seconds."""
    peak = min(parameters.rpm, parameters.acceleration * seconds)
    up = peak / parameters.acceleration
    return (peak * (seconds - up / 2) + peak * peak / parameters.slowing_down / 2) / 60
