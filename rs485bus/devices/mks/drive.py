"""An MKS drive, as it is told from others. Source: MKS RTU V1.0.9."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

from rs485bus.bus.units.adapter import WatchdogRegister
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.mks import alarms
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.ability import MksAbility
from rs485bus.devices.mks.frames import is_native, read, understand, write, write_block
from rs485bus.devices.mks.homing import EndLimits, Homing, SingleTurnHoming, homing_frames
from rs485bus.devices.mks.judge import MksStopJudge
from rs485bus.devices.mks.settings import SETTINGS, MksProfile
from rs485bus.devices.mks.values import Homed, Inputs, Level, Model, MotionDirection, Status, WorkMode
from rs485bus.errors import DeviceRefused, NotEnabled, NotStanding, NotSupported
from rs485bus.motion.drive import NO_EFFECT, STOPS, Drive, Effect, Reading
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Ask, Know, Plan, Start
from rs485bus.motion.settings import written
from rs485bus.motion.standstill import StandstillRule
from rs485bus.motion.state import MOTION, AxisState, Fact, Facts
from rs485bus.wire.frames import BROADCAST, READ_INPUT, WRITE_MULTIPLE, WRITE_SINGLE, Request

FAMILY = "MKS"
LATE_REPLY_WINDOW = 0.7
"""Seconds; replies have been seen that late while the motor moves."""
_SAME = 2
_STUCK = 0.1
"""Seconds for which the position stays of a motor that stands though its status says that it slows down."""
_URGENT_STOP_TAKES = 0.1
_SLOWEST_SETTING = 2.5
"""Seconds that 0x9A may take to answer; 5.6 logs 1.6."""
_FOREVER = float("inf")
_JUMP = r.COUNTS_PER_TURN * 5 // 360
_WRITTEN = {register.address for register in (*r.SINGLE_WRITES, *r.BLOCK_WRITES)}
_MODBUS_IS_OFF = (
    "Modbus is switched off in it. `enable_modbus` of rs485bus.devices.mks switches it on, and so does MB_RTU in the "
    "menu of the drive."
)
_DISRUPTING = {
    register.address
    for register in (
        *(r.CALIBRATE, r.FACTORY_RESET, r.RESTART, r.BOOT),
        *(r.SINGLE_TURN, r.ADDRESS, r.BAUD_RATE, r.MODBUS),
    )
}
"""They restart or silence the drive, take it elsewhere, or (0x9A) keep the pair for 1.6 s."""
_RESTARTING = {register.address for register in (r.CALIBRATE, r.FACTORY_RESET, r.RESTART)}
_SPEED_AT = {r.RUN.address: 2, r.MOVE_PULSES.address: 2}
"""Which value of a block is its speed; the second one in others."""
_MOVING_BLOCKS = {block.address for block in (r.RUN, r.MOVE_PULSES, r.MOVE_TO_PULSES, r.MOVE_COUNTS, r.MOVE_TO_COUNTS)}


class MksWatchdog(WatchdogRegister):
    """Register 0x98 (3.2.14). It cannot be read."""

    register = r.WATCHDOG.address
    count = r.WATCHDOG.count
    highest = 0xFFFF_FFFF

    def __init__(self, address: int) -> None:
        self._address = address

    def write(self, milliseconds: int) -> Request:
        return write(self._address, r.WATCHDOG, milliseconds)


class MksDrive(Drive):
    """One MKS drive.

    Args:
        address: 1..247.
        model: which drive.
        mode: the work mode it is set to.
        microsteps: what it is set to.
        positive: the direction of 0xF6 and 0xFD in which the position grows.
    """

    family = FAMILY
    longest = max(17 + 2 * block.count for block in r.BLOCK_WRITES)  # 9 bytes and the data, and 8 that answer
    late_reply_window = LATE_REPLY_WINDOW
    when_silent = f"Or {_MODBUS_IS_OFF}"
    read_function = READ_INPUT  # and no other
    combines_reads = False  # addresses are command codes (4)
    rotation = (Fact.RUNNING, Fact.STALLED, Fact.ENABLED)
    causes = (Fact.STALLED, Fact.ENABLED, Fact.LIMIT)
    stall_remedy = alarms.hints([alarms.STALLED])
    judge = MksStopJudge

    def __init__(
        self,
        address: int,
        *,
        model: Model = Model.SERVO42D,
        mode: WorkMode = WorkMode.SR_VFOC,
        microsteps: int = 16,
        positive: MotionDirection = MotionDirection.CCW,
    ) -> None:
        name = f"{FAMILY} {address}"
        self.model = model
        self.positive = positive
        self.acknowledged = MksProfile()
        """The settings that it has acknowledged. They cannot be read back."""
        self.unsure: frozenset[str] = frozenset()
        """Settings by which moves go, and of which nobody knows whether the drive took the new value."""
        self.end_limits = EndLimits()
        self._homing_frames: dict[int, bytes] = {}
        """What was acknowledged of how it homes, by register."""
        self._ability = MksAbility(name, mode, microsteps)
        self.homed: tuple[Homed, Homed] | None = None
        """The homing status with which its zero was found, if it was: a restart changes that."""
        self.watchdog = MksWatchdog(address)
        self._readings = (
            Reading(read(address, r.POSITION), frozenset({Fact.POSITION}), _position),
            Reading(read(address, r.STATUS), frozenset({Fact.RUNNING, Fact.PUSHES}), _status),
            Reading(read(address, r.SPEED), frozenset({Fact.SPEED}), self._speed),
            Reading(read(address, r.ENABLED), frozenset({Fact.ENABLED}), _enabled),
            Reading(read(address, r.STALLED), frozenset({Fact.STALLED}), _stalled),
            Reading(read(address, r.HOMED), frozenset({Fact.MARK}), _homed),
            Reading(read(address, r.INPUTS), frozenset({Fact.LIMIT}), self._limit),
        )
        self._reads = (read(address, r.STATUS), read(address, r.POSITION), read(address, r.PULSES))
        super().__init__(name, address, (AxisState(Motion(), self._rule(), _JUMP),))

    @property
    def axis(self) -> AxisState:
        """What is known of its motor."""
        return self.state.axes[0]

    # Telemetry

    @property
    def readings(self) -> Sequence[Reading]:
        return self._readings

    def marks(self, axis: int) -> tuple[Fact, ...]:
        return (Fact.POSITION, Fact.ENABLED) if self.homed is None else (Fact.POSITION, Fact.ENABLED, Fact.MARK)

    def restarted(self, axis: int) -> str:
        state = self.state.axes[0]
        if self.homed is not None and state.value(Fact.MARK) not in (None, self.homed):
            return "its drive has forgotten that it was homed: it has restarted."
        if not (state.holds and state.may_count_anew):
            return ""
        enabled, stalled = state.known(Fact.ENABLED), state.known(Fact.STALLED)
        if enabled.value is not False or stalled.value is True or stalled.at < enabled.at:
            return ""  # it was let go of by a protection, or nobody knows yet
        return "its motor is not enabled any more, and nobody disabled it: the drive may have restarted."

    def what_else(self, axis: int) -> str:
        return "A limit switch or another master may have stopped it."

    def effects(self, request: Request) -> Sequence[Effect]:
        try:
            what, values = understand(request.adu[1:-2])
        except ValueError:
            return (Effect(MOTION | {Fact.ENABLED, Fact.STALLED, Fact.MARK}, _FOREVER, shifts=True),)
        if what.address in _MOVING_BLOCKS:
            code = values[_SPEED_AT.get(what.address, 1)]
            aim = values[2] if what is r.MOVE_TO_COUNTS else None
            return (Effect(MOTION, self._ability.rpm_of(code), keeps=what is r.RUN, aim=aim) if code else STOPS,)
        if what.address in _RESTARTING:
            return (Effect(frozenset(Fact), _FOREVER, restarts="it was restarted."),)
        return (_EFFECTS.get(what.address, NO_EFFECT) if what is not r.ENABLE else _enabling(values[0]),)

    # What it can be told

    @property
    def mode(self) -> WorkMode:
        """The work mode it is set to, as far as is known."""
        return self._ability.mode

    @property
    def microsteps(self) -> int:
        """What it is set to, as far as is known."""
        return self._ability.microsteps

    def ability(self, axis: int) -> MksAbility:
        return self._ability

    def check_mode(self) -> None:
        """Raise `NotSupported` where the bus cannot move it (7.2.2)."""
        if not self.mode.is_serial:
            raise NotSupported(
                f"{self.name} is in mode {self.mode.name}, in which only pulses move it: set_mode(WorkMode.SR_VFOC)."
            )

    def _rule(self) -> StandstillRule:
        """It stands where its position stays for as long as the slowest speed would need to show."""
        slowest = self._ability.rpm_step * r.COUNTS_PER_TURN / 60
        shows = (_SAME + 1) / slowest
        return StandstillRule(same=_SAME, apart=shows, contradicted=max(_STUCK, shows))

    # Plans

    def set_up(self) -> Plan[None]:
        for name in sorted(self.unsure):
            yield from self.write(name, getattr(self, name))

    def write(self, name: str, value: Any) -> Plan[None]:
        """Write one of `SETTINGS`."""
        setting = SETTINGS[name]
        if name == "homing":
            yield from written(setting.title, setting.cost, (), None)
            yield from self.prepare_homing(value)
        else:
            matters = {name} & {"mode", "microsteps"}
            before, self.unsure = self.unsure, self.unsure | matters
            try:
                yield from written(setting.title, setting.cost, setting.frames(self.address, self.model, value))
            except (DeviceRefused, NotStanding):
                self.unsure = before - matters
                raise
            self.unsure -= matters
            if matters:
                setattr(self._ability, name, value)
                self.axis.set_rule(self._rule())
        self.acknowledged = replace(self.acknowledged, **{name: value})

    def forget_settings(self) -> None:
        """It is set as it was shipped; what moves go by is written again before the next one."""
        self.acknowledged, self.end_limits = MksProfile(), EndLimits()
        self._homing_frames.clear()
        self.unsure = frozenset({"mode", "microsteps"})

    def prepare_homing(self, homing: Homing) -> Plan[None]:
        """Set it up for a way of homing: only what it has not acknowledged already, for its flash wears out."""
        for request in homing_frames(self.address, self.model, homing, self.end_limits):
            if self._homing_frames.get(request.register) != request.adu:
                self._homing_frames.pop(request.register, None)
                slow = request.register == r.SINGLE_TURN.address
                yield Ask(request, reply_timeout=_SLOWEST_SETTING if slow else None)
                if not (isinstance(homing, SingleTurnHoming) and homing.set_zero_here):
                    self._homing_frames[request.register] = request.adu
        self.end_limits = homing.limits(self.end_limits)

    def enable(self, axis: int) -> Plan[None]:
        self.check_mode()
        try:
            yield Ask(write(self.address, r.ENABLE, True))
        except DeviceRefused as refused:
            if refused.code is not None:
                raise  # MKS drives refuse in their replies (2.4): this one has nothing to show on its screen
            raise NotEnabled(f"{refused} {_WHY_NOT}") from refused
        yield Know((Fact.ENABLED,))
        if not self.axis.value(Fact.ENABLED):
            raise NotEnabled(f"{self.name} was told to enable its motor, and says that it is not enabled. {_WHY_NOT}")

    def disable(self, axis: int) -> Plan[None]:
        yield Ask(write(self.address, r.ENABLE, False))

    def zero(self, axis: int) -> Plan[None]:
        # Setting the zero of a standing motor twice is setting it once.
        yield Ask(write(self.address, r.SET_ZERO, 1))
        yield Know((Fact.MARK,), afresh=True)
        self.remember_home()

    def remember_home(self) -> None:
        """Its zero was found, or set, with the homing status that it reports."""
        homed = self.axis.value(Fact.MARK)
        self.homed = homed if Homed.DONE in homed else None
        # To the zero of the turn it homes by itself when it is switched on (5.6): that is no proof.
        self.tells_restarts = homed[1] is Homed.DONE

    def move(self, axis: int, target: int, parameters: MotionParameters) -> Plan[None]:
        # One frame says it all.
        self.check_mode()
        stop = write_block(self.address, r.MOVE_TO_COUNTS, parameters.ramp_code, 0, 0)
        yield self.start(self.start_frame(axis, target, parameters), stop, parameters)

    def retarget(self, axis: int, target: int, parameters: MotionParameters, speed: float) -> Plan[None]:
        """By 0xF5 once more (9.4, note 2)."""
        stop = write_block(self.address, r.MOVE_TO_COUNTS, parameters.ramp_code, 0, 0)
        # It may be faster than it is to be.
        fastest = max(abs(speed), parameters.rpm)
        yield Start(self.start_frame(axis, target, parameters), stop, fastest / parameters.acceleration)

    def start_frame(self, axis: int, target: int, parameters: MotionParameters) -> Request:
        code = self._ability.speed_code(parameters.rpm)
        return write_block(self.address, r.MOVE_TO_COUNTS, parameters.ramp_code, code, target)

    def run(self, axis: int, rpm: float, parameters: MotionParameters, ticks: int | None) -> Plan[None]:
        self.check_mode()
        ramp = parameters.ramp_code
        stop = write_block(self.address, r.RUN, MotionDirection.CCW, ramp, 0)
        values = (self.direction(rpm), ramp, self._ability.speed_code(parameters.rpm))
        if not rpm:
            with contextlib.suppress(DeviceRefused):  # it was not turning, says 9.1.3; whoever waits for this looks
                yield self.start(stop, stop, parameters)
        elif ticks is None:
            yield self.start(write_block(self.address, r.RUN, *values), stop, parameters)
        else:
            yield self.start(write_block(self.address, r.RUN_FOR, *values, ticks), stop, parameters)

    def setpoint(self, axis: int, rpm: float, acceleration: float, *, afresh: bool) -> Sequence[Request]:
        speed, ramp = self._ability.slower(rpm), self._ability.gentler(acceleration)
        return (write_block(self.address, r.RUN, self.direction(rpm if speed else 0), ramp, speed),)

    def start(
        self, request: Request, stop: Request | None, parameters: MotionParameters, *, once: bool = False
    ) -> Start:
        """A start, with the stop that belongs to it: each kind of move has its own (8.2, 9.4.2)."""
        return Start(request, stop, parameters.rpm / parameters.acceleration, once=once)

    def direction(self, forward: float) -> MotionDirection:
        """The direction of 0xF6 and 0xFD in which the drive's position grows, or that of a negative number."""
        return self.positive if forward >= 0 else MotionDirection(1 - self.positive)

    # As the owner of the wire sees it

    def reads(self) -> Sequence[Request]:
        return self._reads

    def stops(self, motion: Motion, emergency: bool) -> Sequence[Request]:
        ramp = None if emergency else self.axis.ramp_stop
        return (write(self.address, r.EMERGENCY_STOP, 1) if ramp is None else ramp,)

    def slows_down_for(self, emergency: bool) -> float:
        ramp = 0.0 if emergency or self.axis.ramp_stop is None else self.axis.ramp_takes
        return ramp + _URGENT_STOP_TAKES

    def explain(self, heard: bytes) -> str:
        if is_native(self.address, heard):
            return f"It answers in its own protocol ({heard.hex(' ').upper()}): {_MODBUS_IS_OFF}"
        return ""

    def hears(self, request: Request) -> bool:
        return request.function in (WRITE_SINGLE, WRITE_MULTIPLE) and request.register in _WRITTEN

    def disrupts(self, request: Request) -> bool:
        return request.function in (WRITE_SINGLE, WRITE_MULTIPLE) and request.register in _DISRUPTING

    def broadcast_stop(self) -> Request | None:
        return write(BROADCAST, r.EMERGENCY_STOP, 1)

    # Decoding

    def _speed(self, data: bytes) -> Sequence[Facts]:
        speed = r.SPEED.decode(data)
        return ({Fact.SPEED: float(speed if self.positive is MotionDirection.CCW else -speed)},)

    def _limit(self, data: bytes) -> Sequence[Facts]:
        inputs = r.INPUTS.decode(data)
        high = self.end_limits.trigger is Level.HIGH
        two = self.model.has_outputs or self.acknowledged.limit_remap  # 1.2
        closed = (Inputs.IN_1 in inputs) == high or (two and (Inputs.IN_2 in inputs) == high)
        reached = closed and self.end_limits.on
        return ({Fact.LIMIT: f"with inputs {inputs!r}: a limit switch is closed" if reached else ""},)


_WHY_NOT = (
    "The bus enables and moves it in the SR modes only (7.2.2), and as shipped it is in CR_vFOC: set_mode("
    f"WorkMode.SR_VFOC), or set it at its keys. {alarms.hints(alarms.KEEP_IT_OFF)}"
)
_EFFECTS: dict[int, Effect] = {
    r.EMERGENCY_STOP.address: STOPS,
    r.SET_ZERO.address: Effect(frozenset({Fact.POSITION}), shifts=True),
    r.GO_HOME.address: Effect(MOTION | {Fact.MARK}, _FOREVER, shifts=True),
    r.RELEASE_STALL.address: Effect(frozenset({Fact.STALLED, Fact.ENABLED})),
    r.POWER_ON_RUN.address: STOPS,
    r.WORK_MODE.address: Effect(MOTION | {Fact.ENABLED}, shifts=True),
    r.MICROSTEPS.address: Effect(MOTION, shifts=True),
    r.HOMING.address: Effect(frozenset({Fact.LIMIT})),
    r.LIMIT_REMAP.address: Effect(frozenset({Fact.LIMIT})),
    r.PID_VFOC.address: Effect(shifts=True),
    r.PID_CLOSE.address: Effect(shifts=True),
}


def _enabling(on: bool) -> Effect:
    return Effect(frozenset({Fact.ENABLED, Fact.STALLED}), holds=on)


def _position(data: bytes) -> Sequence[Facts]:
    return ({Fact.POSITION: r.POSITION.decode(data)},)


@lru_cache(maxsize=8)  # each feed is answered by it
def _status(data: bytes) -> Sequence[Facts]:
    status = r.STATUS.decode(data)
    runs = status is not Status.STOPPED if Status.STOPPED <= status <= Status.CALIBRATING else None
    return ({Fact.RUNNING: runs, Fact.PUSHES: status in (Status.SPEEDING_UP, Status.FULL_SPEED)},)


def _enabled(data: bytes) -> Sequence[Facts]:
    return ({Fact.ENABLED: r.ENABLED.decode(data)},)


def _stalled(data: bytes) -> Sequence[Facts]:
    return ({Fact.STALLED: r.STALLED.decode(data)},)


def _homed(data: bytes) -> Sequence[Facts]:
    return ({Fact.MARK: tuple(r.HOMED.decode(data))},)
