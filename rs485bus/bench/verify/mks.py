"""What the manual of MKS SERVO drives leaves open. Source: MKS RTU V1.0.9."""

from __future__ import annotations

import asyncio

from rs485bus.bench.verify.question import Answer, Question
from rs485bus.devices.mks import MksServo, MotionDirection
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import Status
from rs485bus.devices.mks.verify import RPM, verify_watchdog
from rs485bus.errors import DeviceRefused, MotorStalled
from rs485bus.wire.frames import payload, write_multiple
from rs485bus.wire.registers import Repeat

_RPM = 32
_FIRST_PULSES = 400
_FULL_STEPS = 200
_SLOW = 10
_POLL = 0.05
_STANDS_WITHIN = 20.0
_TIMEOUT = 1.0


async def _counts(servo: MksServo) -> int:
    return int(await servo.counts())


async def _stands(servo: MksServo) -> None:
    """Wait until its position does not change any more, and the bus has seen that as well."""
    loop = asyncio.get_running_loop()
    ends = loop.time() + _STANDS_WITHIN
    last, same = None, 0
    while loop.time() < ends and (same < 4 or servo.motion.may_move):
        position = await _counts(servo)
        same = same + 1 if position == last else 0
        last = position
        await asyncio.sleep(_POLL)


async def _pulses(servo: MksServo, pulses: int, speed: int) -> float:
    """Move by pulses, at a speed value; return how many turns that was. Raises `DeviceRefused`."""
    before = await _counts(servo)
    data = r.MOVE_PULSES.encode(MotionDirection.CCW, 0, speed, pulses)
    words = [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]
    request = write_multiple(servo.address, r.MOVE_PULSES.address, words)
    reply = payload(await servo.bus.ask(request, repeat=Repeat.NEVER, moves=True, motion=servo.motion))
    if reply[-2:] == b"\0\0":
        raise DeviceRefused(f"{servo.name} refused to move by pulses. Is its work mode a serial one (SR_...)?")
    await asyncio.sleep(0.1)
    await _stands(servo)
    try:
        servo.check_ready()
    except MotorStalled:  # so it is told where its status sticks at full speed
        await servo.enable()
    return abs(await _counts(servo) - before) / r.COUNTS_PER_TURN


async def _microsteps(servo: MksServo) -> Answer:
    turns = await _pulses(servo, _FIRST_PULSES, _SLOW)
    if not turns:
        return Answer(words="it did not move: not known. Is it in one of the serial work modes (SR_...)?")
    roughly = _FIRST_PULSES / _FULL_STEPS / turns
    # A speed value turns it at value * 16 / microsteps (7.1).
    pulses = round(roughly * _FULL_STEPS / 2)
    turns = await _pulses(servo, pulses, max(1, round(_SLOW * roughly / 16)))
    microsteps = round(pulses / _FULL_STEPS / turns)
    return Answer(words=f"it is set to {microsteps} microsteps", options={"microsteps": microsteps})


async def _direction(servo: MksServo) -> Answer:
    before = await _counts(servo)
    await servo.run(_RPM)
    await asyncio.sleep(0.3)
    grew = await _counts(servo) > before
    positive = MotionDirection.CCW if grew else MotionDirection.CW
    return Answer(words=f"its position grows where it turns {positive.name}", options={"positive": positive.name})


async def _status(servo: MksServo) -> Answer:
    await servo.move_by(0.1 * servo.units_per_turn, rpm=_RPM)
    await _stands(servo)
    status = await servo.motor_status()
    sticks = status is not Status.STOPPED
    return Answer(
        words=f"its status {'sticks at ' + status.name if sticks else 'tells that it stands'} after a move",
        measured={"stuck_status": status.name if sticks else None},
    )


async def _watchdog(servo: MksServo) -> Answer:
    found = await verify_watchdog(servo, _TIMEOUT)
    feeds = [
        what
        for what, feeds_it in (
            ("reads", found.reads_feed),
            ("frames to others", found.others_feed),
            ("broadcasts", found.broadcasts_feed),
        )
        if feeds_it
    ]
    says = "stops it when it is left alone" if found.trips else "does NOT stop it: do not rely on it"
    latches = "; after that it needs enabling" if found.latches else ""
    fed = ", ".join(feeds) or "writes alone: heartbeats would not do"
    return Answer(
        words=f"its watchdog {says}{latches}; it is fed by {fed}",
        measured={"trips": found.trips, "fed_by": feeds, "latches": found.latches},
    )


QUESTIONS = (
    Question(
        name="microsteps",
        asks="To how many microsteps is it set? It cannot be asked.",
        does="turns the motor by up to ten turns, slowly, by pulses",
        ask=_microsteps,
        assumes={"microsteps": 1},
    ),
    Question(
        name="direction",
        asks="In which direction of a run does the position grow?",
        does=f"turns the motor at {_RPM} rpm for a moment",
        ask=_direction,
    ),
    Question(
        name="status",
        asks="Does its status tell that it stands?",
        does="turns the motor by a tenth of a turn",
        ask=_status,
    ),
    Question(
        name="watchdog",
        asks="What feeds its watchdog, and does a trip latch?",
        does=f"turns the motor at {RPM} rpm, five times {3 * _TIMEOUT:g} s",
        ask=_watchdog,
    ),
)
