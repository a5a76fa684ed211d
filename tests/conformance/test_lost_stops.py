"""A stop of which frames are lost: a lost answer makes it no harder, and one that is not heard is said harder."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read
from rs485bus.devices.mks.values import Status
from rs485bus.errors import StopUnconfirmed
from rs485bus.wire.crc import crc
from tests.conformance.subjects import EACH, SUBJECTS, Rig, Subject, now, rig
from tests.devices.mks.bench import on_virtual_clock

RATE = 200.0
TELLING = [each for each in SUBJECTS if each.name != "made up"]
"""Those that tell how fast they turn, or that they slow down."""


def lose_writes(on: Rig, times: int, *, heard: bool) -> None:
    """Lose the next writes, or the answers to them."""
    receive, lost = on.sim.receive, [0]

    def losing(frame: bytes, at: float) -> bytes | None:
        loses = frame[0] == on.sim.address and frame[1] in (6, 16) and lost[0] < times
        lost[0] += loses
        answer: bytes | None = receive(frame, at) if heard or not loses else None
        return None if loses else answer

    on.sim.receive = losing


async def steepest(on: Rig) -> float:
    """The highest rate, in rpm/s, with which it gets slower until it stands."""
    motor, rates = on.subject.motor(on.sim), [0.0]
    while on.moving:
        before, since = motor.rpm(now()), now()
        await asyncio.sleep(0.005)
        rates.append((before - motor.rpm(now())) / (now() - since))
    return max(rates)


@pytest.mark.parametrize("subject", TELLING, ids=str)
@on_virtual_clock
async def test_a_stop_whose_answers_are_lost_keeps_its_ramp(subject: Subject) -> None:
    async with rig(subject) as on:
        await on.axis.run(300, acceleration=RATE)
        lose_writes(on, 2, heard=True)
        stopped = on.axis.stop()
        assert await steepest(on) < 1.1 * RATE
        await stopped
        await on.axis.move_by(1.0)


@EACH
@on_virtual_clock
async def test_a_stop_that_is_not_heard_twice_is_said_harder(subject: Subject) -> None:
    async with rig(subject) as on:
        await on.axis.run(300, acceleration=RATE)
        lose_writes(on, 2, heard=False)
        stopped = on.axis.stop()
        await on.rests(0.5)
        await stopped


@on_virtual_clock
async def test_a_status_that_is_stuck_keeps_no_stop_from_being_said_harder(monkeypatch: pytest.MonkeyPatch) -> None:
    async with rig(SUBJECTS[0]) as on:
        await on.axis.run(300, acceleration=RATE)
        receive: Callable[[bytes, float], bytes | None] = on.sim.receive
        status = bytes((1, 4, 2, 0, Status.SLOWING_DOWN))

        def stuck(frame: bytes, at: float) -> bytes | None:
            if frame[1] == 16:
                return None
            return status + crc(status) if frame == read(1, r.STATUS).adu else receive(frame, at)

        monkeypatch.setattr(on.sim, "receive", stuck)
        stopped = on.axis.stop()
        await on.rests(1.2)
        monkeypatch.undo()
        with pytest.raises(StopUnconfirmed):
            await stopped
