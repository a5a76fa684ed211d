"""What a frame does to a TL-R drive. Pure. Source: TL-R manual, 3.1.3, 3.5.3."""

from __future__ import annotations

from collections.abc import Mapping

from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.frames import written
from rs485bus.devices.tlr.values import Auxiliary, ControlWord
from rs485bus.motion.drive import Effect
from rs485bus.motion.state import MOTION, Fact
from rs485bus.wire.frames import Request

JOGGING = ControlWord.JOG
_FOREVER = float("inf")
_POSITIONING = range(r.POSITIONING.address, r.POSITIONING.address + r.POSITIONING.count)
_JOG = range(r.JOG.address, r.JOG.address + r.JOG.count)
_INPUTS = {r.INPUT_POLARITY.address, *(register.address for register in r.INPUT_FUNCTIONS)}
_COUNTING = {r.SUBDIVISION.address, r.DIRECTION.address}
_AUXILIARY = {
    Auxiliary.FACTORY_RESET: Effect(frozenset(Fact), _FOREVER, restarts="its drive was reset."),
    Auxiliary.CLEAR_ALARM: Effect(frozenset({Fact.FAULT})),
    Auxiliary.CLEAR_POSITION: Effect(frozenset({Fact.POSITION}), shifts=True),
    Auxiliary.ENABLE: Effect(frozenset({Fact.ENABLED}), holds=True),
    Auxiliary.RELEASE: Effect(MOTION | {Fact.ENABLED}, holds=False),
}


def effect_of(request: Request, word: ControlWord, sent: Mapping[int, int], may_move: bool) -> Effect:
    """What a request does.

    Args:
        request: what goes out.
        word: what the control word was before it.
        sent: what the registers of motion were last written to, by it or before it.
        may_move: whether the motor may move before it.
    """
    registers = written(request)
    if not registers:
        return Effect(frozenset(Fact), _FOREVER, shifts=True)  # nothing that is known
    auxiliary = registers.get(r.AUXILIARY.address)
    if auxiliary in _AUXILIARY:
        return _AUXILIARY[Auxiliary(auxiliary)]
    if r.CONTROL.address in registers:
        return _controlled(ControlWord(registers[r.CONTROL.address]), sent, may_move)
    changes: frozenset[Fact] = frozenset()
    if not registers.keys().isdisjoint(_POSITIONING):
        changes |= {Fact.MARK}
    if not registers.keys().isdisjoint(_INPUTS):
        changes |= {Fact.INPUTS, Fact.LIMIT}
    if not registers.keys().isdisjoint(_COUNTING):
        return Effect(changes | {Fact.POSITION}, shifts=True)
    if not registers.keys().isdisjoint(_JOG) and JOGGING in word and may_move:
        return _jogs(sent, changes)
    return Effect(changes)


def _controlled(word: ControlWord, sent: Mapping[int, int], may_move: bool) -> Effect:
    if word & (ControlWord.STOP | ControlWord.EMERGENCY_STOP):
        return Effect(MOTION, stops=True)
    if word & ControlWord.HOME:
        return Effect(MOTION | {Fact.HOMED}, _FOREVER, shifts=True)
    if word & ControlWord.POSITION:
        speeds = (sent.get(register.address, _FOREVER) for register in (r.MOVE_SPEED, r.START_SPEED))
        return Effect(MOTION, max(speeds))
    if word & ControlWord.JOG:
        return _jogs(sent)
    return Effect(MOTION if may_move else frozenset())  # it may end a jog


def _jogs(sent: Mapping[int, int], changes: frozenset[Fact] = frozenset()) -> Effect:
    raw = sent.get(r.JOG_SPEED.address)
    speed = _FOREVER if raw is None else abs(raw - 0x10000 if raw >= 0x8000 else raw)
    return Effect(changes | MOTION, speed, keeps=speed > 0)
