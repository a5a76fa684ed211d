"""What a write can do to the wheels of a ZLAC8015D, whoever makes it. Source: ZLAC8015D RS485 V1.06, 3, 4. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.memory import ZlacMemory, decode, written_words
from rs485bus.devices.zlac.values import ControlMode, ControlWord, Side
from rs485bus.motion.drive import NO_EFFECT, Effect
from rs485bus.motion.state import MOTION, Fact
from rs485bus.wire.answers import WRITE_MULTIPLE, WRITE_SINGLE
from rs485bus.wire.frames import Request

_FOREVER = float("inf")
_STARTED: Final = {
    ControlWord.START_BOTH: tuple(Side),
    ControlWord.START_LEFT: (Side.LEFT,),
    ControlWord.START_RIGHT: (Side.RIGHT,),
}
_RUNNING: Final[dict[int, r.Twin[int]]] = {
    ControlMode.VELOCITY: r.TARGET_VELOCITY,
    ControlMode.TORQUE: r.TARGET_TORQUE,
}
"""The targets that need no start word."""
_ANYTHING: Final = Effect(frozenset(Fact), _FOREVER, shifts=True)


@dataclass(slots=True)
class _Effect:
    """The effect on one wheel, as far as it was put together."""

    changes: set[Fact] = field(default_factory=set)
    fastest: float | None = None
    stops: bool = False
    shifts: bool = False
    holds: bool | None = None
    restarts: str = ""
    keeps: bool = False

    def moves(self, fastest: float) -> None:
        self.changes |= MOTION
        self.fastest = max(fastest, self.fastest or 0.0)

    def stands(self) -> None:
        self.changes |= MOTION
        self.stops = True

    def told(self) -> Effect:
        changes = frozenset(self.changes)
        return Effect(changes, self.fastest, self.stops, self.shifts, self.holds, self.restarts, self.keeps)


def effects(memory: ZlacMemory, request: Request) -> tuple[Effect, Effect]:
    """What a write can do to the left and the right wheel of a drive that holds so much."""
    if not request.writes:
        return NO_EFFECT, NO_EFFECT
    if request.function not in (WRITE_SINGLE, WRITE_MULTIPLE):
        return _ANYTHING, _ANYTHING
    words = written_words(request)
    left, right = (_of_wheel(memory, words, side).told() for side in Side)
    return left, right


def zeroed(words: dict[int, int], side: Side) -> bool:
    """Whether what is written has the counter of a wheel begin anew."""
    return any(words.get(register.address, 0) & side for register in (r.CLEAR_POSITION, r.RESET_ZERO))


def _of_wheel(memory: ZlacMemory, words: dict[int, int], side: Side) -> _Effect:
    effect = _Effect()
    mode, word = memory.value(r.MODE), words.get(r.CONTROL.address)
    if word is not None:
        _control(effect, memory, word, side)
    velocity, torque = decode(r.TARGET_VELOCITY.of(side), words), decode(r.TARGET_TORQUE.of(side), words)
    if velocity is not None and mode in (ControlMode.VELOCITY, None):
        if velocity:
            effect.moves(abs(velocity) / (memory.value(r.SPEED_RESOLUTION) or 1))
            effect.keeps = mode is ControlMode.VELOCITY
        else:
            effect.stands()
    if torque is not None and mode in (ControlMode.TORQUE, None):
        effect.moves(_FOREVER if torque else 0.0)
    if r.MODE.address in words:
        effect.changes.add(Fact.MARK)
        new = words[r.MODE.address]
        if not _is_quiet(memory, new, side):
            effect.moves(_FOREVER)
        elif new != mode:
            effect.changes |= MOTION
    if zeroed(words, side) or r.ENCODER_LINES.of(side).address in words:
        effect.changes.add(Fact.POSITION)
        effect.shifts = True
    if words.get(r.RESTORE.address):
        effect.changes |= set(Fact)
        effect.restarts = "its factory settings were restored."
    return effect


def _control(effect: _Effect, memory: ZlacMemory, word: int, side: Side) -> None:
    if word == ControlWord.EMERGENCY_STOP:
        effect.stands()
        effect.changes.add(Fact.ENABLED)
        effect.holds = False
    elif word == ControlWord.CLEAR_FAULT:
        effect.changes |= {Fact.FAULT, Fact.ENABLED}
    elif word == ControlWord.RELEASE:
        effect.changes |= MOTION | {Fact.ENABLED}
        effect.holds, effect.shifts = False, True  # it rolls
    elif word == ControlWord.ENABLE:
        effect.changes.add(Fact.ENABLED)
        effect.holds = True
        if not _is_quiet(memory, memory.value(r.MODE), side):
            effect.moves(_FOREVER)
    elif side in _STARTED.get(_known(word), ()):
        fastest = memory.value(r.POSITION_SPEED.of(side))
        effect.moves(float(r.MAX_POSITION_RPM if fastest is None else fastest))


def _known(word: int) -> ControlWord:
    try:
        return ControlWord(word)
    except ValueError:
        return ControlWord.UNDEFINED


def _is_quiet(memory: ZlacMemory, mode: int | None, side: Side) -> bool:
    """Whether a wheel that is held in a mode stays where it is, by its targets. A position needs a start word."""
    twin = _RUNNING.get(-1 if mode is None else mode)
    return mode is not None and (twin is None or memory.value(twin.of(side)) == 0)
