"""A ZLAC8015D, as it is told from other drives. Source: ZLAC8015D RS485 V1.06.

Both wheels share one address, one control word, one mode and one watchdog. So a wheel can be stopped alone in velocity
mode only, by its target; everything else stops both. A fault of one wheel is a fault of both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence

from rs485bus.bus.units.adapter import WatchdogRegister
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.zlac import plans
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.ability import ZlacAbility, ZlacOptions
from rs485bus.devices.zlac.effects import effects, zeroed
from rs485bus.devices.zlac.frames import control, read, write, write_twins
from rs485bus.devices.zlac.memory import ZlacMemory, decode, read_words, words_from, written_words
from rs485bus.devices.zlac.setup import ZlacSetup, set_up
from rs485bus.devices.zlac.telemetry import STILL_RPM, StatusWord, tell
from rs485bus.devices.zlac.values import ControlMode, ControlWord, Fault, ShaftState, Side
from rs485bus.motion.drive import Drive, Effect, Reading
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Plan
from rs485bus.motion.standstill import StandstillRule
from rs485bus.motion.state import MOTION, AxisState, Fact, Facts
from rs485bus.wire.answers import READ_HOLDING, WRITE_MULTIPLE, WRITE_SINGLE
from rs485bus.wire.frames import Request, payload, read_holding

FAMILY = "ZLAC"
_LONGEST = max(13 + 2 * block.count for side in Side for block in (*r.PARAMETER_BLOCKS[side], r.CONTROL_BLOCK))
"""Bytes: a read has 8, and its reply has 5 beside its data. Writes take less."""
_STOP_TAKES = 0.5
"""Seconds that a quick stop may take; its ramp is 10 ms as shipped."""
_SAME = 2
"""Counts by which a standing wheel may seem to move."""
_CONTRADICTED = 0.1
"""Seconds for which the position of a standing wheel stays though a run bit is set: it may be the other wheel's."""
_JUMP = 4096 * 5 // 360
_WRAPS = 0x1_0000_0000
_STARTS = {Side.LEFT: ControlWord.START_LEFT, Side.RIGHT: ControlWord.START_RIGHT}
_SIDES = tuple(Side)
_AS_SHIPPED = ZlacOptions()
_LETTING_GO = (ControlWord.EMERGENCY_STOP, ControlWord.CLEAR_FAULT, ControlWord.RELEASE)


class ZlacWatchdog(WatchdogRegister):
    """Register 0x2000, of both wheels. 1000 ms according to the manual; drives have been shipped with 0, which is off.

    The drive keeps what is written to it when it is switched off.
    """

    register = r.WATCHDOG.address
    highest = 0x7FFF

    def __init__(self, address: int) -> None:
        self._address = address

    def write(self, milliseconds: int) -> Request:
        return write(self._address, r.WATCHDOG, milliseconds)

    def read(self) -> Request:
        return read(self._address, r.WATCHDOG)

    def decode(self, reply: bytes) -> int:
        return r.WATCHDOG.decode(payload(reply))


class ZlacDrive(Drive):
    """One drive and its two wheels: axis 0 is the left one, axis 1 the right one.

    Args:
        address: 1..127.
        options: how it is used.
    """

    family = FAMILY
    longest = _LONGEST
    start_grace = 0.1
    tells_restarts = True
    turns_through_zero = True
    zeroed_by_one_frame = False
    causes = (Fact.FAULT, Fact.ENABLED)
    fault_remedy = "Then clear_faults() and enable(); both wheels stop for an error of one."

    def __init__(self, address: int, options: ZlacOptions = _AS_SHIPPED) -> None:
        self.options = options
        self.watchdog = ZlacWatchdog(address)
        self.memory = ZlacMemory()
        self.faults = (Fault(0), Fault(0))
        """Left and right, as they were last read."""
        self.zeroings = [0, 0]
        """How often the counter of each wheel may have begun anew, because it was told to."""
        self.restarts = 0
        """How often it was seen to have restarted."""
        self.paused = False
        """A controlled stop was made by control word 0x05: it is enabled again before the next command."""
        self.ready = False
        """It was enabled here, with no target left from before, and nothing has happened since."""
        self.setup: ZlacSetup | None = None
        """What was found when it was set up."""
        self.now: Callable[[], float] = lambda: math.inf
        """The time; as long as nobody has said that, what was asked may be of any age."""
        self.accelerations: dict[int, float | None] = {}
        """With which each wheel changes its speed, in rpm/s, if that is known."""
        self._kept: dict[int, tuple[ControlMode | None, int]] = {}
        """What each wheel was told to keep, and in which epoch: no stop leaves anything of it."""
        self._status: StatusWord | None = None
        self._was_in_a_mode = self._forgot_its_mode = False
        name = f"{FAMILY} {address}"
        self.abilities = tuple(ZlacAbility(f"{name} {side.name.lower()}", options) for side in Side)
        self.sides = {Side.LEFT: Motion(), Side.RIGHT: Motion()}
        state, first = r.STATE.address + r.STATE.count, r.STATE.address
        # After a lost reply an equal request waits, lest it be answered late. One that reads a little more need not.
        wider = [read_holding(address, at, state - at) for at in range(first, r.REPORT.address - 1, -1)]
        self._readings = (
            *(self._reading(request, *MOTION, Fact.ENABLED, Fact.FAULT) for request in wider),
            self._reading(read(address, r.MOTION), Fact.POSITION, Fact.SPEED),
            self._reading(read(address, r.MODES), Fact.MARK),
            self._reading(read(address, r.MODE), Fact.MARK),
        )
        self._reads = (read(address, r.STATUS), read(address, r.STATE), read(address, r.MOTION))
        states = tuple(AxisState(self.sides[side], self._rule(1), _JUMP) for side in Side)
        super().__init__(name, address, states, Motion(self.sides.values()))

    # Telemetry

    @property
    def readings(self) -> Sequence[Reading]:
        return self._readings

    @staticmethod
    def _reading(request: Request, *told: Fact) -> Reading:
        return Reading(request, frozenset(told), lambda data: tell(words_from(request.register, data)))

    def decode(self, request: Request, reply: bytes) -> Sequence[Facts]:
        # Whatever of its registers is read, by whomever, tells of the wheels.
        return tell(read_words(request, reply)) if request.function == READ_HOLDING else ()

    def restarted(self, axis: int) -> str:
        if self._forgot_its_mode:
            return "its drive may have restarted: it is in no mode, as after power-on, and counts from zero then."
        return "its encoder or its Hall sensor failed." if self.faults[axis].spoils_position else ""

    def marks(self, axis: int) -> tuple[Fact, ...]:
        return (Fact.POSITION, Fact.ENABLED, Fact.MARK)

    def halted_by(self, axis: int) -> str:
        if not self.is_in_emergency_stop:
            return ""
        return (
            "the drive is in emergency stop, by its input, its watchdog or a stop that concerned both wheels. enable() "
            "it."
        )

    def what_else(self, axis: int) -> str:
        if self.options.ramp_rpm is not None:
            return "It is enabled and reports no error. Something may hold it."
        return (
            "It is enabled and reports no error. Something may hold it; or its ramps are steeper than it was told, "
            "where its ramp times are for the whole range of speeds: then make it with ramp_rpm=1000."
        )

    @property
    def enabled(self) -> bool:
        """Whether it says that both wheels are held."""
        return bool(self.state.axes[0].value(Fact.ENABLED))

    @property
    def is_in_emergency_stop(self) -> bool:
        """Whether its status word, as it was last read, says so."""
        return self._status is not None and self._status.either(ShaftState.EMERGENCY_STOP)

    def on_reply(self, request: Request, reply: bytes, asked_at: float, now: float) -> None:
        self.memory.heard(request, reply, asked_at)
        words = read_words(request, reply)
        self._notice(words)
        super().on_reply(request, reply, asked_at, now)

    def _notice(self, words: Mapping[int, int]) -> None:
        """Take in what concerns both wheels."""
        if r.STATUS.address in words:
            self._status = StatusWord(words[r.STATUS.address])
        faults = decode(r.ERRORS.left, words), decode(r.ERRORS.right, words)
        if faults[0] is not None and faults[1] is not None:
            self.faults = faults[0], faults[1]
        mode, told = self.memory.value(r.MODE), decode(r.MODE, words)
        if told is ControlMode.UNDEFINED and self._was_in_a_mode:
            # After power-on it is in no mode, and nobody took it out of its one.
            self.restarts += 1
            self.memory.forget()
            self.forget()
            self._forgot_its_mode = True
        elif mode is not None:
            self._forgot_its_mode = self._forgot_its_mode and mode is ControlMode.UNDEFINED
        if mode is not None:
            self._was_in_a_mode = mode is not ControlMode.UNDEFINED

    def forget(self) -> None:
        """It may have been switched off and on, or stopped: what it was told goes on no more."""
        self.paused = self.ready = False
        self._kept.clear()

    def on_sent(self, request: Request, at: float) -> None:
        words = written_words(request)
        for axis, side in enumerate(Side):
            self.zeroings[axis] += zeroed(words, side)
        if words.get(r.CONTROL.address) in _LETTING_GO:
            self.ready = False
        super().on_sent(request, at)
        self.memory.sent(request, at)

    def effects(self, request: Request) -> Sequence[Effect]:
        return effects(self.memory, request)

    # What it can be told

    def ability(self, axis: int) -> ZlacAbility:
        return self.abilities[axis]

    @property
    def mode(self) -> ControlMode | None:
        """What it is in, if that is known."""
        return self.memory.value(r.MODE)

    def learn(self, counts: Sequence[int]) -> None:
        """What it is set to is known: so many counts to a turn of each wheel, and the rest by its replies."""
        limit = self.memory.value(r.SPEED_LIMIT) or r.MAX_RPM
        for axis, ability in enumerate(self.abilities):
            ability.resolution = self.memory.value(r.SPEED_RESOLUTION) or ability.resolution
            ability.speed_limit = float(min(limit, self.options.max_rpm, r.MAX_RPM))
            ability.counts_per_turn = counts[axis]
            self.state.axes[axis].set_rule(self._rule(ability.resolution, counts[axis]))
            self.state.axes[axis].jump = counts[axis] * 5 // 360
        self.on_recounted()

    def keep(self, axis: int, mode: ControlMode | None, acceleration: float | None = None) -> None:
        """A wheel is told to keep a speed or a torque from now on; None for neither."""
        self._kept[axis] = mode, self.state.axes[axis].motion.epoch
        self.accelerations[axis] = acceleration

    def kept(self, axis: int) -> ControlMode | None:
        """In which mode a wheel keeps a speed or a torque; None if it keeps neither."""
        motion, (mode, epoch) = self.state.axes[axis].motion, self._kept.get(axis, (None, 0))
        return mode if motion.may_move and motion.epoch == epoch else None

    @staticmethod
    def _rule(resolution: int, counts_per_turn: int = 4096) -> StandstillRule:
        """It stands where its position stays for as long as the slowest speed would need to show."""
        shows = (_SAME + 1) * 60 * resolution / counts_per_turn
        return StandstillRule(
            same=_SAME, apart=shows, contradicted=max(_CONTRADICTED, shows), still_rpm=STILL_RPM, wraps=_WRAPS
        )

    # Plans. What both wheels do together is told by one frame: `wanted` has a part for each that takes part.

    def set_up(self) -> Plan[None]:
        yield from set_up(self)

    def resume(self, axis: int) -> Plan[None]:
        yield from plans.resume(self)

    def enable(self, axis: int) -> Plan[None]:
        yield from plans.enable(self)

    def disable(self, axis: int) -> Plan[None]:
        yield from plans.release(self, axis)

    def zero(self, axis: int) -> Plan[None]:
        yield from plans.zero(self, axis)

    def move(self, axis: int, target: int, parameters: MotionParameters) -> Plan[None]:
        yield from plans.move(self, {axis: (target, parameters)})

    def run(self, axis: int, rpm: float, parameters: MotionParameters, ticks: int | None) -> Plan[None]:
        yield from plans.run(self, {axis: (rpm, parameters)})

    def move_all(self, wanted: Mapping[int, tuple[int, MotionParameters]]) -> Plan[None]:
        yield from plans.move(self, wanted)

    def run_all(self, wanted: Mapping[int, tuple[float, MotionParameters]]) -> Plan[None]:
        yield from plans.run(self, wanted)

    @property
    def spreads_changes(self) -> bool:  # type: ignore[override] # by how its ramp times are read
        return self.options.ramp_rpm is None

    def setpoint(self, axis: int, rpm: float, acceleration: float, *, afresh: bool) -> Sequence[Request]:
        return self.setpoints({axis: rpm}, acceleration, afresh=afresh)

    def setpoints(self, speeds: Mapping[int, float], acceleration: float, *, afresh: bool) -> Sequence[Request]:
        return plans.setpoints(self, speeds, acceleration)

    def push_all(self, wanted: Mapping[int, tuple[int, int | None]]) -> Plan[None]:
        """Have wheels push: (mA, mA/s or None), told by one frame."""
        yield from plans.push(self, wanted)

    def start_frame(self, axis: int, target: int, parameters: MotionParameters) -> Request:
        return self.start_word((axis,))

    def start_word(self, axes: Collection[int]) -> Request:
        """What starts wheels that were told where to go."""
        both = len(axes) == len(Side)
        return control(self.address, ControlWord.START_BOTH if both else _STARTS[_SIDES[next(iter(axes))]])

    def motion_of(self, axes: Collection[int]) -> Motion:
        """One wheel, or both."""
        return self.motion if len(axes) == len(Side) else self.state.axes[next(iter(axes))].motion

    # As the owner of the wire sees it

    def reads(self) -> Sequence[Request]:
        return self._reads

    def stopped_with(self, axis: int, emergency: bool) -> Motion:
        alone = not emergency and self.mode is ControlMode.VELOCITY
        return self.state.axes[axis].motion if alone else self.motion

    def stops(self, motion: Motion, emergency: bool) -> Sequence[Request]:
        if emergency:
            return self._quick_stop(emergency=True)
        if self.mode is ControlMode.VELOCITY:
            return plans.frames_for_stop(self, self._axes_of(motion))
        if self.mode is not None and not self.motion.may_move:
            # It was seen standing, and target velocities do nothing now: to be confirmed without letting go of it.
            return (self._stand(motion),)
        if self.options.smooth_stop and self.mode is not None:
            return (self._stand(self.motion), write(self.address, r.MODE, ControlMode.VELOCITY))
        return self._quick_stop(emergency=False)

    def slows_down_for(self, emergency: bool) -> float:
        if emergency:
            return _STOP_TAKES
        times = (r.DECELERATION_TIME, r.QUICK_STOP_TIME)
        held = [self.memory.value(twin.of(side)) or 0 for twin in times for side in Side]
        return max(held) / 1000 + _STOP_TAKES

    def may_be_moved_by(self, request: Request) -> bool:
        known = all(address in r.BY_ADDRESS for address in written_words(request))
        return not known or any(effect.changes & MOTION for effect in self.effects(request))

    def interrupted(self, unheard: float, reason: str) -> None:
        self.forget()
        self.setup = None
        super().interrupted(unheard, reason)

    def hears(self, request: Request) -> bool:
        """Whether it would act on this broadcast. The manual is silent: taken for granted for what it has registers
        for, and for functions that are not known. Nothing else could do anything to it if it did listen."""
        if request.function not in (WRITE_SINGLE, WRITE_MULTIPLE):
            return request.writes
        count = 1 if request.function == WRITE_SINGLE else int.from_bytes(request.adu[4:6], "big")
        return request.register <= r.LAST and request.register + count > r.FIRST

    def _axes_of(self, motion: Motion) -> tuple[int, ...]:
        return tuple(at for at, axis in enumerate(self.state.axes) if motion in (axis.motion, self.motion))

    def _stand(self, motion: Motion) -> Request:
        for side, part in self.sides.items():
            if motion is part:
                return write(self.address, r.TARGET_VELOCITY.of(side), 0)
        return write_twins(self.address, (r.TARGET_VELOCITY, 0, 0))

    def _quick_stop(self, emergency: bool) -> tuple[Request]:
        # The wheel that was not meant is stopped as well, and nothing older may set it in motion again.
        self.motion.stop()
        enabled = any(axis.value(Fact.ENABLED) or axis.holds for axis in self.state.axes)
        self.paused = not emergency and (self.paused or enabled)
        self._kept.clear()
        return (control(self.address, ControlWord.EMERGENCY_STOP),)
