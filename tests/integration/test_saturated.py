"""An application that asks without a pause, on every axis: what it moves still begins, is looked at, and ends."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from rs485bus import Bus, BusConfig, MksServo, Zlac8015d, open_bus
from rs485bus.bus.record import Record
from rs485bus.bus.schedule.job import Urgency
from rs485bus.motion.move import MoveState
from rs485bus.sim import SimMks, SimZlac, VirtualLine
from rs485bus.wire.frames import READ_INPUT
from tests.integration.support import bus_on, plant, virtual

QUICK = BusConfig(reply_timeout=0.01)


def questions_of(axis: MksServo) -> list[Callable[[], Awaitable[Any]]]:
    return [axis.position, axis.velocity, axis.motor_status, axis.counts]


def raw_reads_of(axis: MksServo) -> list[Callable[[], Awaitable[Any]]]:
    unit = axis.bus.unit(axis.address)
    return [lambda: unit.read_input_registers(0x31, 3), lambda: unit.read_input_registers(0x32, 1)]


async def without_a_pause(question: Callable[[], Awaitable[Any]]) -> None:
    while True:
        await question()


@pytest.mark.parametrize("asked", [questions_of, raw_reads_of])
@virtual
async def test_moves_end_on_a_bus_that_is_never_idle(
    asked: Callable[[MksServo], list[Callable[[], Awaitable[Any]]]],
) -> None:
    made = plant(8)
    async with bus_on(made, QUICK) as (_, axes):
        await asyncio.gather(*(axis.enable() for axis in axes))
        askers = [asyncio.create_task(without_a_pause(question)) for axis in axes for question in asked(axis)]
        async with asyncio.timeout(20):
            assert await asyncio.gather(*(axis.move_to(2.0) for axis in axes)) == [2.0] * 8
        for asker in askers:
            asker.cancel()


async def _urgencies(bus: Bus, question: Callable[[], Awaitable[Any]]) -> set[Urgency]:
    records: list[Record] = []
    unsubscribe = bus.subscribe(records.append)
    await question()
    unsubscribe()
    return {record.urgency for record in records}


@virtual
async def test_questions_of_either_family_wait_behind_what_moves() -> None:
    async with open_bus(VirtualLine(SimMks(1), SimZlac(2)), config=QUICK) as bus:
        x, base = MksServo(bus, 1), Zlac8015d(bus, 2)
        await base.set_up()
        for question in (*questions_of(x), x.encoder, x.homed, x.status):
            assert await _urgencies(bus, question) == {Urgency.POLL}
        for question in (base.left.position, base.right.velocity, base.snapshot, base.status):
            await asyncio.sleep(0.5)
            assert await _urgencies(bus, question) == {Urgency.POLL}


@virtual
async def test_an_answer_that_takes_longer_than_a_move_may_does_not_fail_it() -> None:
    made = plant()
    (sim,) = made.sims
    async with bus_on(made, BusConfig(reply_timeout=0.4)) as (_, (x,)):
        await x.enable()
        answer, lost = sim.answer, []

        def lose(pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
            reply = answer(pdu, now, broadcast=broadcast)
            if pdu[0] != READ_INPUT or (lost and now > lost[0] + 1.2):
                return reply
            lost.append(now)
            return None

        await x.move_to(0.0)
        move = x.move_to(0.0625)
        await asyncio.sleep(0.02)
        assert move.state is MoveState.MOVING
        sim.answer = lose  # type: ignore[method-assign]
        assert await move == 0.0625
        assert move.started_at is not None
        assert move.eta is not None
        assert len(lost) >= 3
        assert x.bus.now() > 2 * move.eta - move.started_at + 1
