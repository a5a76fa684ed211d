"""What the manual of TL-R drives leaves open. Source: TL-R manual, 3.1.3, 3.5.3."""

from __future__ import annotations

import asyncio
from typing import Any

from rs485bus.bench.verify.question import Answer, Question, ramp_answer, slope
from rs485bus.bus.unit import Unit
from rs485bus.devices.tlr import TlrStepper
from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.values import Auxiliary, ControlWord, StatusWord
from rs485bus.errors import BusError, DeviceRefused
from rs485bus.wire.registers import Register, Repeat

_PART = 0.1
"""Turns of a short way."""
_RPM, _FASTER = 60, 90
_RAMP_RPM, _RAMP = 120.0, 60.0
_MOVES_FOR = 1.5
_POLL = 0.02
_SETTLES = 0.3


class _Bare:
    """A drive told register by register, as the manual tells, so that no facade does it right by itself."""

    def __init__(self, stepper: TlrStepper) -> None:
        self.stepper = stepper
        self.unit: Unit = stepper.bus.unit(stepper.address)

    async def read(self, register: Register[Any]) -> Any:
        return await self.unit.read(register)

    async def write(self, register: Register[Any], value: Any) -> None:
        await self.unit.write(register, value, repeat=Repeat.SAFE)

    async def auxiliary(self, command: Auxiliary) -> None:
        await self.write(r.AUXILIARY, Auxiliary.NONE)
        await self.unit.write(r.AUXILIARY, command)

    async def aim(self, turns: float) -> list[int]:
        """Write a short way, one register at a time. Returns what the six registers should hold."""
        pulses = round(turns * await self.read(r.SUBDIVISION))
        values = (0, 100, 100, _RPM, pulses)
        for register, value in zip(r.POSITIONING.fields, values, strict=True):
            assert isinstance(register, Register)
            await self.write(register, value)
        return _words(r.POSITIONING.encode(*values))

    async def held(self) -> list[int]:
        """What those registers hold."""
        return await self.unit.read_holding_registers(r.POSITIONING.address, 6)

    async def goes(self, word: ControlWord) -> bool:
        """Whether writing the control word sets it in motion; it stands again afterwards."""
        before = await self.read(r.POSITION)
        try:
            await self.unit.write(r.CONTROL, word)
        except DeviceRefused:
            return False
        await self.stands()
        return bool(abs(await self.read(r.POSITION) - before) > 0.3 * _PART * await self.read(r.SUBDIVISION))

    async def stands(self) -> None:
        loop = asyncio.get_running_loop()
        ends = loop.time() + _MOVES_FOR
        await asyncio.sleep(_SETTLES)
        last = None
        while loop.time() < ends:
            position = await self.read(r.POSITION)
            if position == last and StatusWord.RUNNING not in await self.read(r.STATUS):
                return
            last = position
            await asyncio.sleep(_POLL)


def _words(data: bytes) -> list[int]:
    return [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]


async def _enabled_bit(stepper: TlrStepper) -> Answer:
    bare = _Bare(stepper)
    told = []
    for command in (Auxiliary.RELEASE, Auxiliary.ENABLE):
        await bare.auxiliary(command)
        await asyncio.sleep(_SETTLES)
        told.append(StatusWord.ENABLED in await bare.read(r.STATUS))
    reliable = told == [False, True]
    said = " and ".join("on" if on else "off" for on in told)
    return Answer(
        words=f"status bit 4 is {said} after release and enable: it {'can' if reliable else 'can not'} be relied on",
        options={"enabled_bit": reliable},
        measured={"released": told[0], "enabled": told[1]},
    )


async def _block_writes(stepper: TlrStepper) -> Answer:
    bare = _Bare(stepper)
    await bare.write(r.CONTROL, ControlWord.NONE)
    for register in r.POSITIONING.fields:
        assert isinstance(register, Register)
        await bare.write(register, 0)
    wanted = _words(r.POSITIONING.encode(1, 201, 202, 303, 0x0004_0005))
    said = True
    try:
        await bare.unit.write_registers(r.POSITIONING.address, wanted, repeat=Repeat.SAFE)
    except BusError:
        said = False
    held = await bare.held()
    kept = next((at for at, (one, other) in enumerate(zip(wanted, held, strict=True)) if one != other), len(wanted))
    whole = kept == len(wanted)
    return Answer(
        words="a block of six registers is taken whole" if whole else f"of a block of six registers {kept} are taken",
        options={"block_writes": whole},
        measured={"kept": kept, "acknowledged": said},
    )


async def _keeps_target(stepper: TlrStepper) -> Answer:
    bare = _Bare(stepper)
    await bare.write(r.CONTROL, ControlWord.NONE)
    wanted = await bare.aim(_PART)
    if not await bare.goes(ControlWord.POSITION):
        return Answer(words="it did not move: not known")
    keeps = await bare.held() == wanted
    return Answer(words=f"a target {'is kept' if keeps else 'is used up by its move'}", options={"keeps_target": keeps})


async def _trigger(stepper: TlrStepper) -> Answer:
    bare = _Bare(stepper)
    await bare.write(r.CONTROL, ControlWord.NONE)
    await bare.aim(-_PART)
    if not await bare.goes(ControlWord.POSITION):
        return Answer(words="it did not move: not known")
    await bare.aim(_PART)
    again = await bare.goes(ControlWord.POSITION)
    return Answer(
        words="each write of the control word starts a move" if again else "a move starts when its bit rises from 0",
        options={"clear_trigger": not again},
        measured={"trigger": "write" if again else "edge"},
    )


async def _live_jog(stepper: TlrStepper) -> Answer:
    bare = _Bare(stepper)
    await bare.write(r.CONTROL, ControlWord.NONE)
    for speed, starts in ((_RPM, True), (_FASTER, False)):
        await bare.unit.write_registers(r.JOG.address, _words(r.JOG.encode(speed, 100, 100)), repeat=Repeat.SAFE)
        if starts:
            await bare.unit.write(r.CONTROL, ControlWord.JOG)
        await asyncio.sleep(2 * _SETTLES)
    reached = abs(await bare.read(r.SPEED))
    await bare.write(r.CONTROL, ControlWord.STOP)
    if reached < _RPM / 2:
        return Answer(words="it did not turn: not known")
    live = reached > (_RPM + _FASTER) / 2
    return Answer(
        words=f"a jog under way {'takes' if live else 'does not take'} another speed",
        options={"live_jog": live},
        measured={"rpm": reached},
    )


async def _ramp(stepper: TlrStepper) -> Answer:
    seconds = _RAMP_RPM / _RAMP
    bare = _Bare(stepper)
    await bare.write(r.CONTROL, ControlWord.NONE)
    jog = _words(r.JOG.encode(int(_RAMP_RPM), round(1000 * seconds), 100))
    await bare.unit.write_registers(r.JOG.address, jog, repeat=Repeat.SAFE)
    await bare.unit.write(r.CONTROL, ControlWord.JOG)

    async def rpm() -> float:
        return float(await bare.read(r.SPEED))

    measured = await slope(rpm, _RAMP_RPM, 2 * seconds)
    await bare.write(r.CONTROL, ControlWord.STOP)
    return ramp_answer(measured, _RAMP, _RAMP_RPM, seconds)


QUESTIONS = (
    Question(
        name="enabled bit",
        asks="Does status bit 4 tell whether the motor is held?",
        does="lets go of the shaft for a moment",
        ask=_enabled_bit,
    ),
    Question(
        name="block writes",
        asks="Does it keep all of a write of six registers?",
        does="",
        ask=_block_writes,
    ),
    Question(
        name="target",
        asks="Do the registers of a target hold after the move?",
        does="turns the motor by a tenth of a turn",
        ask=_keeps_target,
    ),
    Question(
        name="trigger",
        asks="Must a bit of the control word be 0 before it starts something?",
        does="turns the motor by a tenth of a turn, back and perhaps forth",
        ask=_trigger,
    ),
    Question(
        name="jog speed",
        asks="Does a jog under way take another speed?",
        does=f"turns the motor at {_RPM} to {_FASTER} rpm for about a second",
        ask=_live_jog,
    ),
    Question(
        name="ramps",
        asks="Which change of speed takes a ramp time?",
        does=f"turns the motor at up to {_RAMP_RPM:g} rpm for about two seconds",
        ask=_ramp,
    ),
)
