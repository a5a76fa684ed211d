"""A TL-R drive, as it is told from others. Source: TL-R manual, the section named at each plan."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from rs485bus.bus.units.adapter import StandstillDetector
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr import telemetry
from rs485bus.devices.tlr.ability import TlrAbility
from rs485bus.devices.tlr.effects import JOGGING, effect_of
from rs485bus.devices.tlr.frames import control, read, words, write, written
from rs485bus.devices.tlr.judge import TlrStopJudge
from rs485bus.devices.tlr.values import Auxiliary, ControlWord, DiFunction, ExceptionCode
from rs485bus.devices.tlr.witness import Witness
from rs485bus.devices.tlr.writing import TlrWriter
from rs485bus.errors import NotEnabled, RequestFailed
from rs485bus.motion.drive import Drive, Effect, Reading
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Ask, Know, Plan, Stand, Start
from rs485bus.motion.standstill import NEVER, StandstillRule
from rs485bus.motion.state import AxisState, Fact, Facts
from rs485bus.wire.frames import Request, payload, read_holding
from rs485bus.wire.registers import Repeat

FAMILY = "TL-R"
_START = ControlWord.POSITION | ControlWord.ABSOLUTE
_STOPS = ControlWord.STOP | ControlWord.EMERGENCY_STOP
_EMERGENCY_STOP_TAKES = 0.1
_LONGEST_RAMP = r.MAX_RAMP_MS / 1000
_LOST_BELOW_TURNS = 5 / 360
_COARSE = 1600
"""Pulses a turn below which a standing axis may seem to move by one of them only."""
_CONTRADICTED = 0.3
"""Seconds for which the position stays of a motor that stands though its status says that it runs."""
_WRITTEN = (range(r.INPUT_POLARITY.address, 0xE0), range(r.OPERATING_MODE.address, 0x11A))
"""Where its parameters are. What the holes between them do nobody says: MKS "home" is one, the sixth word of a path."""
_SET_UP_BY = {r.SUBDIVISION.address, *(register.address for register in r.INPUT_FUNCTIONS)}
_COUNTING = {r.SUBDIVISION.address: r.SUBDIVISION.name, r.DIRECTION.address: r.DIRECTION.name}
_MOVING_INPUTS = {function.value for function in DiFunction if function.moves}
_AT = range(r.POSITIONING.address, r.POSITIONING.address + r.POSITIONING.count)


class TlrDrive(Drive):
    """One TL-R drive.

    Args:
        address: 1..247.
        pulses_per_turn: None for its subdivision, which it is asked for.
        start_rpm: the speed at which moves begin.
        clear_trigger, block_writes: as for `TlrWriter`.
        keeps_target: 0x33 to 0x38 hold what was written until the drive is switched off.
        enabled_bit: rely on status bit 4.
        live_jog: a jog under way takes another speed.
        ramp_rpm: the speed that the times of ramps refer to; None for the speed of the move.
    """

    family = FAMILY
    start_grace = 0.1
    causes = (Fact.FAULT, Fact.LIMIT, Fact.ENABLED)
    refusals: Mapping[int, str] = MappingProxyType(
        {
            ExceptionCode.ILLEGAL_DATA: "illegal data: the value is outside what this parameter can be",
            ExceptionCode.EXECUTION_DENIED: "execution denied: it does not do that now. Look at its status for an "
            "alarm, an input that holds it, or a motion under way",
        }
    )

    def __init__(
        self,
        address: int,
        *,
        pulses_per_turn: int | None = None,
        start_rpm: int = 0,
        clear_trigger: bool = True,
        block_writes: bool = True,
        keeps_target: bool = True,
        enabled_bit: bool = False,
        live_jog: bool = False,
        ramp_rpm: float | None = None,
    ) -> None:
        name = f"{FAMILY} {address}"
        self.pulses_per_turn = pulses_per_turn
        self.start_rpm = start_rpm
        self.writer = TlrWriter(name, address, clear_trigger=clear_trigger, block_writes=block_writes)
        """The plans that write to it."""
        self.keeps_target = keeps_target
        self.enabled_bit = enabled_bit
        self.live_jog = live_jog
        self.tells_restarts = keeps_target
        self.knows_counts = False
        self.rotation = (Fact.MARK,) if keeps_target else ()
        self.ran_at = self.not_homed_at = NEVER
        """When it last said that it runs, and that it is not homed."""
        self.closed_at: dict[int, float] = {}
        """When inputs were last seen active, by their functions."""
        self._word = ControlWord.NONE
        """What the control word was last set to."""
        self._sent: dict[int, int] = {}
        """What was last written to its registers of motion."""
        self._witness = Witness(_AT)
        self._functions: tuple[int, ...] = ()
        """What its inputs do."""
        # Nothing is refused at the coarsest subdivision that could be gone to at the one it turns out to have.
        self._ability = TlrAbility(name, pulses_per_turn or r.LEAST_PULSES, ramp_rpm)
        told = frozenset({Fact.RUNNING, Fact.HOMED, *((Fact.ENABLED,) if enabled_bit else ())})
        more = told | {Fact.FAULT, Fact.LIMIT, Fact.INPUTS, Fact.POSITION}
        self._readings = (
            Reading(read(address, r.TELEMETRY), more | {Fact.SPEED}, self._report),
            Reading(read_holding(address, r.STATUS.address, r.TELEMETRY.count - 1), more, self._report),
            Reading(read(address, r.STATUS), told, self._report),
            Reading(read(address, r.POSITIONING), frozenset({Fact.MARK}), _mark),
        )
        axis = AxisState(Motion(), self._rule(), self._jump)
        axis.unit = "pulses"
        super().__init__(name, address, (axis,))
        self.state.listen(self._see)

    @property
    def axis(self) -> AxisState:
        """What is known of its motor."""
        return self.state.axes[0]

    # Telemetry

    @property
    def readings(self) -> Sequence[Reading]:
        return self._readings if self.keeps_target else self._readings[:3]

    def marks(self, axis: int) -> tuple[Fact, ...]:
        # The mark says more than a jump.
        return self.tells(Fact.MARK, Fact.POSITION, Fact.ENABLED)

    def what_else(self, axis: int) -> str:
        inputs = self.axis.last(Fact.INPUTS).value
        return (
            f"It stands with inputs {inputs!r}: a limit switch or another input may hold it. If it does not move at "
            "all, it may need clear_trigger=True."
        )

    def effects(self, request: Request) -> Sequence[Effect]:
        return (effect_of(request, self._word, self._sent, self.axis.motion.may_move),)

    def on_sent(self, request: Request, at: float) -> None:
        registers = written(request)
        self._sent.update(registers)
        self._witness.sent(registers)
        super().on_sent(request, at)
        self._word = ControlWord(registers.get(r.CONTROL.address, self._word))
        self.knows_counts = self.knows_counts and _SET_UP_BY.isdisjoint(registers)
        for register in registers.keys() & _COUNTING.keys():
            self.axis.stood_at = None
            self.axis.suspect(f"its {_COUNTING[register]} was changed.")
        if registers.get(r.AUXILIARY.address) == Auxiliary.FACTORY_RESET:
            self._forget()

    def interrupted(self, unheard: float, reason: str) -> None:
        self.knows_counts = False
        super().interrupted(unheard, reason)

    def _see(self) -> None:
        """Take in what no other layer knows how to: a restart, and what an alarm means."""
        axis = self.axis
        mark, running, homed = (axis.known(fact) for fact in (Fact.MARK, Fact.RUNNING, Fact.HOMED))
        if mark.value is not None and self._witness.denies(mark.value):
            axis.suspect("its drive has restarted: what was written to it is gone.")
            axis.stood_at = axis.holds = None
            self._forget()
        elif mark.value is not None and self._witness.speaks:
            self._witness.read(mark.value)
        if running.value:
            self.ran_at = running.at
        if homed.value is False:
            self.not_homed_at = homed.at
        inputs = axis.known(Fact.INPUTS)
        for port, function in enumerate(self._functions):
            if inputs.value is not None and inputs.value & (1 << port):
                self.closed_at[function] = inputs.at
        if axis.value(Fact.FAULT) and axis.holds is not False:
            axis.holds = False
            if axis.motion.may_move:
                # Whether the motor was held all the time is not known.
                axis.suspect("its drive raised an alarm in the middle of a move.")
        # Inputs move it only while it counts on; where a restart cannot be told otherwise, a jump tells it.
        axis.may_be_moved = self._witness.speaks and not _MOVING_INPUTS.isdisjoint(self._functions)

    def _forget(self) -> None:
        """It is as it was saved."""
        self._witness.forget()
        self.knows_counts = False

    # What it can be told

    def ability(self, axis: int) -> TlrAbility:
        return self._ability

    @property
    def _jump(self) -> int:
        return max(2, round(_LOST_BELOW_TURNS * self._ability.counts_per_turn))

    def _rule(self) -> StandstillRule:
        """It stands where its position stays for as long as the slowest speed would need to show."""
        pulses = self._ability.counts_per_turn
        same = 2 if pulses >= _COARSE else 1
        shows = (same + 1) * 60 / pulses  # at 1 rpm
        return StandstillRule(same=same, apart=shows, contradicted=max(_CONTRADICTED, 2 * shows))

    # Plans

    def set_up(self) -> Plan[None]:
        if self.knows_counts:
            return
        pulses = self.pulses_per_turn
        if pulses is None:
            pulses = r.SUBDIVISION.decode(payload((yield Ask(read(self.address, r.SUBDIVISION)))))
        self._functions = yield from self.input_functions()
        if pulses != self._ability.counts_per_turn:
            self._ability.counts_per_turn = pulses
            self.axis.stood_at = None
            self.axis.set_rule(self._rule())
            self.axis.jump = self._jump
            self.on_recounted()
        self.knows_counts = True

    def input_functions(self) -> Plan[tuple[int, ...]]:
        """What its inputs do, from DI0 on."""
        return words(payload((yield Ask(read(self.address, r.ALL_INPUT_FUNCTIONS)))))

    def enable(self, axis: int) -> Plan[None]:
        if not self.is_jogging:  # a jog may last as long as its bit is set, and is left alone
            # What stopped it may hold it as long as its bit is set.
            yield Ask(control(self.address, ControlWord.NONE))
        if self.keeps_target:
            yield Know((Fact.MARK,), afresh=True)
            if not self._witness.speaks:
                yield from self.put_nothing(unlike=self.axis.value(Fact.MARK)[1])
        try:
            yield from self.writer.auxiliary(Auxiliary.ENABLE)
        except RequestFailed:
            self.axis.holds = None
            raise
        if self.enabled_bit:
            yield Know((Fact.ENABLED,))
            if not self.axis.value(Fact.ENABLED):
                raise NotEnabled(f"{self.name} was told to enable its motor, and says that it is not enabled.")

    def disable(self, axis: int) -> Plan[None]:
        yield from self.writer.auxiliary(Auxiliary.RELEASE)

    def zero(self, axis: int) -> Plan[None]:
        # Clearing the position of a standing motor twice is clearing it once.
        yield from self.writer.auxiliary(Auxiliary.CLEAR_POSITION)

    def move(self, axis: int, target: int, parameters: MotionParameters) -> Plan[None]:
        # 0 comes before the target, too: nothing that is still set may start it.
        yield from self.writer.clear_control()
        yield from self._put_target(target, parameters)
        yield self.start(_START, parameters)

    def start_frame(self, axis: int, target: int, parameters: MotionParameters) -> Request:
        return control(self.address, _START)

    def retarget(self, axis: int, target: int, parameters: MotionParameters, speed: float) -> Plan[None]:
        yield from self._put_target(target, parameters)
        if self.writer.clear_trigger:
            yield Ask(control(self.address, ControlWord.ABSOLUTE | ControlWord.INTERRUPT))
        yield self.start(_START | ControlWord.INTERRUPT, parameters)

    def run(self, axis: int, rpm: float, parameters: MotionParameters, ticks: int | None) -> Plan[None]:
        # A run for a time is a move over what it covers (`TlrStepper.run`).
        if not rpm:
            *before, last = self.stops(self.axis.motion, False)
            for request in before:
                yield Ask(request)
            yield Start(last, stop=last, stopping=self.axis.ramp_takes)
            return
        values = (round(rpm), parameters.ramp_code, parameters.slowing_code)
        if self.is_jogging and self.live_jog and not self.axis.stands:  # where it stands its start was lost
            yield Start(write(self.address, r.JOG.address, words(r.JOG.encode(*values))), *self._stop(parameters))
            return
        if self.axis.motion.may_move:
            # Whether a jog under way takes another speed is not said.
            yield Stand()
        yield from self.writer.clear_control()
        yield from self.writer.put(r.JOG, *values)
        yield self.start(ControlWord.JOG, parameters)

    def setpoint(self, axis: int, rpm: float, acceleration: float, *, afresh: bool) -> Sequence[Request]:
        speed = int(rpm)
        if not speed:
            # Where it was told to stop before, that is said again as it was: what rises then would do it harder.
            return (control(self.address, self._word if self._word & _STOPS else ControlWord.STOP),)
        full = self._ability.ramp_rpm or abs(speed)
        time = min(r.MAX_RAMP_MS, math.ceil(full * 1000 / acceleration))
        goes_on = self.live_jog and not afresh and bool(self._word & JOGGING)
        frames = [] if goes_on else self._prepared(afresh)
        frames += self._jogging(words(r.JOG.encode(speed, time, time)), afresh)
        return frames if goes_on else [*frames, control(self.address, ControlWord.JOG)]

    def _prepared(self, afresh: bool) -> list[Request]:
        """What has the bit of a trigger rise; nothing where it was cleared.

        Whether a jog under way takes another speed is not said: it is told to jog once more.
        """
        is_clear = not afresh and self._word is ControlWord.NONE
        return [] if is_clear or not self.writer.clear_trigger else [control(self.address, ControlWord.NONE)]

    def _jogging(self, values: Sequence[int], afresh: bool) -> list[Request]:
        """What tells speed and ramps of jogs, the speed last where that takes several frames."""
        first = r.JOG.address
        new = [at for at, value in enumerate(values) if afresh or self._sent.get(first + at) != value]
        if self.writer.block_writes and any(new):
            return [write(self.address, first, values)]
        return [write(self.address, first + at, values[at : at + 1]) for at in sorted({0, *new}, reverse=True)]

    @property
    def is_jogging(self) -> bool:
        """Whether it was told to jog, and nothing else since."""
        return bool(self._word & JOGGING) and self.axis.motion.may_move

    # Parts of them

    def start(self, word: ControlWord, parameters: MotionParameters, **how: Any) -> Start:
        """What starts something, with the stop that belongs to it."""
        return Start(control(self.address, word), *self._stop(parameters), **how)

    def _stop(self, parameters: MotionParameters) -> tuple[Request, float]:
        return control(self.address, ControlWord.STOP), parameters.rpm / parameters.slowing_down

    def _put_target(self, target: int, parameters: MotionParameters) -> Plan[None]:
        speed = parameters.speed_code
        ramps = parameters.ramp_code, parameters.slowing_code
        yield from self._put_positioning(min(self.start_rpm, speed), *ramps, speed, target)

    def put_nothing(self, unlike: int) -> Plan[bool]:
        """A target without a speed: it goes nowhere, and no move is like it, nor what has `unlike` as its time up.
        Whether the drive has restarted since the target before that."""
        if not self.keeps_target:
            return False
        spoke = self._witness.speaks
        yield Know((Fact.MARK,), afresh=spoke)
        restarted = spoke and not self._witness.speaks
        self.knows_counts = self.knows_counts and spoke  # else it may have restarted since: nothing would have told
        yield from self._put_positioning(0, (unlike + 1) % r.MAX_RAMP_MS, 0, 0, 0)
        return restarted

    def _put_positioning(self, *values: int) -> Plan[None]:
        # What is there before it is written once more tells whether the drive has restarted since.
        yield from self.writer.put(r.POSITIONING, *values, repeat=Repeat.VERIFY if self.keeps_target else Repeat.SAFE)
        if self.keeps_target:
            self._witness.read(words(r.POSITIONING.encode(*values)))

    # As the owner of the wire sees it

    def reads(self) -> Sequence[Request]:
        return tuple(reading.request for reading in self._readings[:3])

    def stops(self, motion: Motion, emergency: bool) -> Sequence[Request]:
        # Whether the bits act by their level or by their rising edge is not said. So one that is set already is never
        # taken back, which may end a stop, and yet one rises: the other one.
        held = self._word & _STOPS
        if not held:
            wanted = [ControlWord.EMERGENCY_STOP if emergency else ControlWord.STOP]
        elif held != _STOPS:
            wanted = [_STOPS]
        else:
            wanted = [ControlWord.EMERGENCY_STOP, _STOPS]
        return [control(self.address, word) for word in wanted]

    def slows_down_for(self, emergency: bool) -> float:
        if emergency:
            return _EMERGENCY_STOP_TAKES
        # What an input has set in motion has a ramp of its own.
        ramp = self.axis.ramp_takes if self.axis.motion.may_move and self.axis.ramp_stop else _LONGEST_RAMP
        return ramp + _EMERGENCY_STOP_TAKES

    def judgement(self, motion: Motion) -> StandstillDetector:
        return TlrStopJudge(self.reads(), self.axis.rule, lambda: self.state.so_by)

    def hears(self, request: Request) -> bool:
        """Whether it would act on this broadcast. The manual does not say whether it listens: taken for granted."""
        registers = written(request)
        return any(register in parameters for register in registers for parameters in _WRITTEN)

    def does_nothing(self, request: Request, code: int) -> bool:
        """04 says that it was denied (4.4), not that it failed."""
        return code == ExceptionCode.EXECUTION_DENIED

    # Decoding

    def _report(self, data: bytes) -> Sequence[Facts]:
        return (telemetry.facts(data, self._functions, self.enabled_bit),)


def _mark(data: bytes) -> Sequence[Facts]:
    return ({Fact.MARK: words(data)},)
