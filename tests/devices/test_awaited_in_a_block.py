"""What begins after a stream is not awaited for ever in its block, by whichever task of that."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest

from rs485bus import AxisGroup, MksServo, open_bus
from rs485bus.errors import MotionError
from rs485bus.sim import SimMks, VirtualLine
from tests.integration.support import virtual


async def in_a_group_of_tasks(move: Any) -> None:
    try:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(move.wait())
    except ExceptionGroup as errors:
        raise errors.exceptions[0] from None


async def as_positions(move: Any) -> None:
    async for _ in move.positions():
        pass


WAYS: dict[str, Callable[[Any], Awaitable[Any]]] = {
    "gather": lambda move: asyncio.gather(move.wait(), asyncio.sleep(0.1)),
    "task": lambda move: asyncio.create_task(move.wait()),
    "task group": in_a_group_of_tasks,
    "wait_for": lambda move: asyncio.wait_for(move.wait(), 60.0),
    "positions": as_positions,
}


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
@pytest.mark.parametrize("which", ["axis", "group"])
@virtual
async def test_a_move_is_refused_to_a_task_that_was_begun_in_the_block_of_the_stream_before_it(
    which: str, way: Callable[[Any], Awaitable[Any]]
) -> None:
    async with open_bus(VirtualLine(SimMks(1), SimMks(2))) as bus:
        x, y = MksServo(bus, 1), MksServo(bus, 2)
        group = AxisGroup(x=x, y=y)
        await group.enable()
        async with (x if which == "axis" else group).stream(timeout=5.0) as setpoint:  # type: ignore[attr-defined]
            with suppress(TypeError):
                setpoint(30) if which == "axis" else setpoint(x=30, y=30)
            move = x.move_by(0.5) if which == "axis" else group.move_by(x=0.5, y=0.5)
            with pytest.raises(MotionError, match="leave the block first"):
                async with asyncio.timeout(10.0):
                    await way(move)
        await move  # it is done all the same


@virtual
async def test_a_task_that_was_begun_before_the_block_waits_for_its_end() -> None:
    async with open_bus(VirtualLine(SimMks(1))) as bus:
        axis = MksServo(bus, 1)
        await axis.enable()
        begun = asyncio.Event()

        async def afterwards() -> float:
            await begun.wait()
            return await axis.move_by(0.5)

        waiting = asyncio.create_task(afterwards())
        async with axis.stream(timeout=5.0) as setpoint:
            setpoint(30)
            begun.set()
            await asyncio.sleep(1.0)
            assert not waiting.done()
        await waiting


@virtual
async def test_a_task_that_was_begun_in_a_block_that_has_ended_may_wait_for_anything() -> None:
    async with open_bus(VirtualLine(SimMks(1))) as bus:
        axis = MksServo(bus, 1)
        await axis.enable()
        over = asyncio.Event()

        async def afterwards() -> None:
            await over.wait()
            await axis.move_by(0.5)

        async with axis.stream(timeout=5.0) as setpoint:
            setpoint(30)
            waiting = asyncio.create_task(afterwards())
            await asyncio.sleep(0.5)
        over.set()
        async with asyncio.timeout(10.0):
            await waiting
        await axis.move_by(0.5)


@virtual
async def test_a_task_of_the_bus_own_that_is_begun_in_a_block_is_no_part_of_it() -> None:
    async with open_bus(VirtualLine(SimMks(1))) as bus:
        axis = MksServo(bus, 1)
        await axis.enable()
        ends: list[float] = []

        async def wait(move: Any) -> None:
            ends.append(await move)

        async with axis.stream(timeout=5.0) as setpoint:
            setpoint(30)
            task = bus.spawn(wait(axis.move_by(0.5)), "waits")
            await asyncio.sleep(0.5)
            assert not task.done()
        await task
        assert len(ends) == 1
