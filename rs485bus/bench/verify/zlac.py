"""What the manual of the ZLAC8015D leaves open. Source: ZLAC8015D RS485 V1.06."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

from rs485bus.bench.verify.question import Answer, Question, ramp_answer, slope
from rs485bus.bus.unit import Unit
from rs485bus.devices.zlac import Zlac8015d
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.telemetry import StatusWord
from rs485bus.devices.zlac.values import ControlMode, ControlWord, ShaftState
from rs485bus.errors import BusError, StopUnconfirmed
from rs485bus.wire.registers import Repeat

_RPM = 30.0
_RAMP_RPM, _RAMP = 60.0, 20.0
_TURNS = 3.0
_SETTLES = 0.6
_STANDS_WITHIN = 3.0
_WATCHDOG_MS = 1000


async def _word(drive: Zlac8015d) -> StatusWord:
    return StatusWord(await drive.bus.unit(drive.address).read(r.STATUS))


async def _counts(unit: Unit) -> int:
    counts: Any = await unit.read(r.POSITION.left)
    return int(counts)


async def _rpm(unit: Unit) -> float:
    rpm: Any = await unit.read(r.VELOCITY.left)
    return float(rpm)


async def _halves(drive: Zlac8015d) -> Answer:
    await drive.left.run(_RPM)
    word = await _word(drive)
    if word.low.running == word.high.running:
        return Answer(words=f"both halves say the same (0x{word.raw:04X}): not known", measured={"word": word.raw})
    left = "low" if word.low.running else "high"
    return Answer(
        words=f"the left wheel's half of the status word is the {left} one",
        options={"status_word_left": left},
        measured={"word": word.raw},
    )


async def _ramp(drive: Zlac8015d) -> Answer:
    unit = drive.bus.unit(drive.address)
    run = drive.left.run(_RAMP_RPM, acceleration=_RAMP)

    measured = await slope(lambda: _rpm(unit), _RAMP_RPM, 2 * _RAMP_RPM / _RAMP)
    milliseconds: Any = await unit.read(r.ACCELERATION_TIME.left)
    seconds = milliseconds / 1000
    with contextlib.suppress(BusError):
        await run
    return ramp_answer(measured, _RAMP_RPM / seconds, _RAMP_RPM, seconds)


async def _mode_change(drive: Zlac8015d) -> Answer:
    unit = drive.bus.unit(drive.address)
    move = drive.left.move_by(_TURNS * drive.left.units_per_turn, rpm=_RPM)
    try:
        await asyncio.sleep(2 * _SETTLES)
        reported = abs(await _rpm(unit))
        turning = await _turns(unit)
        for side in (r.TARGET_VELOCITY.left, r.TARGET_VELOCITY.right):
            await unit.write(side, 0, repeat=Repeat.SAFE)
        await unit.write(r.MODE, ControlMode.VELOCITY, repeat=Repeat.SAFE)
        # Once it stands, short of where it was sent, the bus may take it for held, and stop it harder.
        word = await _word(drive)
        stands = await _stands(unit)
    finally:
        await drive.stop()
        with contextlib.suppress(BusError):
            await move
    held = word.low.shaft is word.high.shaft is ShaftState.LOCKED
    smooth = turning and stands and held
    measured: dict[str, Any] = {
        "rpm_in_position_mode": reported > _RPM / 3,
        "mode_change_releases": not held,
        "stands": stands,
    }
    words = "stops and holds" if smooth else "stops, and lets go of" if stands else "does not stop"
    return Answer(
        words=f"a change to velocity mode with target 0 {words} a wheel that goes to a position",
        options={"smooth_stop": smooth} if turning else {},
        measured=measured,
    )


async def _turns(unit: Unit) -> bool:
    before = await _counts(unit)
    await asyncio.sleep(0.1)
    return abs(await _counts(unit) - before) > 4


async def _stands(unit: Unit) -> bool:
    loop = asyncio.get_running_loop()
    ends = loop.time() + _STANDS_WITHIN
    while loop.time() < ends:
        if not await _turns(unit):
            return True
    return False


async def _watchdog(unit: Unit) -> Answer:
    before = await unit.read(r.WATCHDOG)
    timeout = _WATCHDOG_MS / 1000
    try:
        await unit.write(r.WATCHDOG, _WATCHDOG_MS, repeat=Repeat.SAFE)
        await unit.write(r.MODE, ControlMode.VELOCITY, repeat=Repeat.SAFE)
        for target in (r.TARGET_VELOCITY.left, r.TARGET_VELOCITY.right):
            await unit.write(target, 0, repeat=Repeat.SAFE)
        await unit.write(r.CONTROL, ControlWord.ENABLE, repeat=Repeat.SAFE)
        resolution = await unit.read(r.SPEED_RESOLUTION)
        await unit.write(r.TARGET_VELOCITY.left, round(_RPM * resolution))
        for _ in range(10):
            await unit.read(r.STATUS)
            await asyncio.sleep(0.3 * timeout)
        fed = await _turns(unit)
        await asyncio.sleep(3 * timeout)
        trips = not await _turns(unit)
        word = StatusWord(await unit.read(r.STATUS))
    finally:
        await _stop(unit)
        await unit.write(r.WATCHDOG, before, repeat=Repeat.SAFE)
    state = word.low.shaft.name if trips else ""
    says = f"stops it when it is left alone (then {state})" if trips else "does NOT stop it: do not rely on it"
    return Answer(
        words=f"its watchdog {says}; reads {'' if fed else 'do NOT '}feed it",
        measured={"trips": trips, "reads_feed": fed, "trip_state": state, "set_before": before},
    )


async def _stop(unit: Unit) -> None:
    """Slow both wheels down and see them stand; else stop them as fast as the drive can. Raises `StopUnconfirmed`."""
    for target in (r.TARGET_VELOCITY.left, r.TARGET_VELOCITY.right):
        await unit.write(target, 0, repeat=Repeat.SAFE)
    if not await _stands(unit):
        await unit.write(r.CONTROL, ControlWord.EMERGENCY_STOP, repeat=Repeat.SAFE)
        if not await _stands(unit):
            raise StopUnconfirmed(
                f"ZLAC {unit.address} could not be seen standing. Look at the machine; use the hard-wired stop."
            )


QUESTIONS = (
    Question(
        name="status word",
        asks="Which half of the status word is the left wheel's?",
        does=f"turns the left wheel at {_RPM:g} rpm for a moment",
        ask=_halves,
    ),
    Question(
        name="ramps",
        asks="Which change of speed takes a ramp time?",
        does=f"turns the left wheel at up to {_RAMP_RPM:g} rpm for about three seconds",
        ask=_ramp,
    ),
    Question(
        name="change of mode",
        asks="Does a wheel that goes to a position stop when the mode is changed?",
        does=f"turns the left wheel at {_RPM:g} rpm by up to {_TURNS:g} turns",
        ask=_mode_change,
    ),
    Question(
        name="watchdog",
        asks="Does its watchdog stop it, and do reads feed it?",
        does=f"turns the left wheel at {_RPM:g} rpm for {6 * _WATCHDOG_MS / 1000:g} seconds at most, nobody asking",
        ask=_watchdog,
        bare=True,
    ),
)
