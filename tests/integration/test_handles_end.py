"""A command's handle ends for everybody who waits for it, whatever a callback does and wherever it is awaited."""

import asyncio
import gc
import threading
from collections.abc import Callable
from typing import Any

import pytest

from rs485bus import AxisGroup, Move
from rs485bus.bus.handle import Handle
from rs485bus.errors import LoopNotRunning, MotionError
from rs485bus.sim import VirtualClockLoop
from tests.integration.support import bus_on, plant, virtual


def boom(_: object) -> None:
    raise RuntimeError("boom")


@virtual
async def test_a_callback_that_raises_keeps_neither_other_waiters_nor_the_next_moves_from_going_on(
    caplog: pytest.LogCaptureFixture,
) -> None:
    made, told = plant(), []
    async with bus_on(made) as (_, (x,)):
        x.enable()
        move = x.move_to(1.0)
        move.add_done_callback(boom)
        move.add_done_callback(told.append)
        following = x.move_to(2.0)
        async with asyncio.timeout(10):
            assert await asyncio.gather(move, move, following) == [1.0, 1.0, 2.0]
    assert told == [move]
    assert made.shafts() == [pytest.approx(2.5)]
    assert "a done-callback of move to 1 of MKS 1 failed" in caplog.text
    assert "boom" in caplog.text


@virtual
async def test_a_callback_that_raises_keeps_no_failure_from_being_told() -> None:
    async with bus_on(plant()) as (_, (x,)):
        x.enable()
        move = x.move_to(50.0)
        move.add_done_callback(boom)
        await asyncio.sleep(0.5)
        x.stop().add_done_callback(boom)
        async with asyncio.timeout(10):
            with pytest.raises(MotionError):
                await move
            await x.move_to(1.0)


def of_the_group(move: Any) -> list[Any]:
    return [move]


def of_a_part(move: Any) -> list[Any]:
    return [move.moves["x"]]


@pytest.mark.parametrize("which", [of_the_group, of_a_part])
@pytest.mark.parametrize("ends_well", [True, False])
@virtual
async def test_a_callback_of_a_group_or_of_a_part_that_raises_leaves_nobody_waiting(
    which: Callable[[Any], list[Any]], ends_well: bool
) -> None:
    made = plant(2)
    async with bus_on(made) as (_, (x, y)):
        group = AxisGroup(x=x, y=y)
        group.enable()
        move = group.move_to(x=1.0, y=2.0)
        for handle in which(move):
            handle.add_done_callback(boom)
        following = y.move_to(3.0)
        async with asyncio.timeout(10):
            if ends_well:
                assert await move == {"x": 1.0, "y": 2.0}
                assert await following == 3.0
            else:
                await asyncio.sleep(0.2)
                move.cancel()
                for handle in (move, *move.moves.values(), following):
                    with pytest.raises(MotionError):
                        await handle
                await group.stop()
                assert await y.move_to(1.0) == 1.0
    assert made.stands()


@virtual
async def test_ctrl_c_out_of_a_callback_passes_and_yet_nobody_is_left_waiting() -> None:
    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    handle: Handle[int] = Handle("test")
    handle.add_done_callback(interrupt)
    waiting = asyncio.create_task(handle.wait())
    await asyncio.sleep(0)
    with pytest.raises(KeyboardInterrupt):
        handle.finish(1)
    assert await waiting == 1


@virtual
async def test_a_callback_added_after_the_end_is_called(caplog: pytest.LogCaptureFixture) -> None:
    told: list[Handle[Any]] = []
    handle: Handle[int] = Handle("test")
    handle.finish(1)
    handle.add_done_callback(told.append)
    handle.add_done_callback(boom)
    assert told == [handle]
    assert "a done-callback of test failed" in caplog.text


def test_a_handle_awaited_in_the_event_loop_of_another_thread_ends_there() -> None:
    begun, awaited = threading.Event(), threading.Event()
    moves: list[Handle[float]] = []
    results: list[float] = []

    async def elsewhere() -> None:
        asyncio.get_running_loop().call_later(0.01, awaited.set)
        async with asyncio.timeout(10):
            results.append(await moves[0])

    def in_a_thread() -> None:
        begun.wait(10)
        asyncio.run(elsewhere())

    async def main() -> None:
        handle: Handle[float] = Handle("test")
        moves.append(handle)
        begun.set()
        await asyncio.to_thread(awaited.wait, 10)
        handle.finish(1.0)
        await asyncio.to_thread(thread.join, 10)

    thread = threading.Thread(target=in_a_thread)
    thread.start()
    asyncio.run(main())
    assert results == [1.0]


def test_a_handle_whose_own_event_loop_stands_still_is_not_waited_for_in_another() -> None:
    moves: list[Move] = []

    async def begin() -> None:
        async with bus_on(plant()) as (_, (x,)):
            x.enable()
            moves.append(x.move_to(1.0))
            stopped.set()
            await asyncio.sleep(60)

    async def elsewhere() -> None:
        with pytest.raises(LoopNotRunning, match="Await it in that one"):
            await moves[0]

    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        loop = runner.get_loop()
        stopped = asyncio.Event()
        task = loop.create_task(begin())
        loop.run_until_complete(stopped.wait())
        asyncio.run(elsewhere())
        task.cancel()
        loop.run_until_complete(asyncio.wait([task]))
    assert moves[0].done()


@virtual
async def test_a_command_that_is_cancelled_behind_a_stop_that_is_being_seen_leaves_no_task_that_has_failed() -> None:
    complaints: list[dict[str, Any]] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: complaints.append(context))
    async with bus_on(plant()) as (_, (x,)):
        await x.enable()
        first = x.run(300)
        await asyncio.sleep(0.2)
        first.cancel()
        second = x.run(60, replace=True)
        await asyncio.sleep(0.01)  # its worker waits for the stop of the first
        second.cancel()
        await asyncio.sleep(2)
        assert second.done()
        assert await x.move_by(0.25) is not None
    gc.collect()
    assert complaints == []


@virtual
async def test_what_cannot_be_called_back_is_refused_at_once() -> None:
    """It would be found out when the command ends, by a line in the log."""
    async with bus_on(plant(2)) as (_, (x, y)):
        x.enable()
        handles: list[Any] = [x.move_to(1.0), AxisGroup(x=x, y=y).enable()]
        for handle in handles:
            for wrong in (None, 5, "print"):
                with pytest.raises(TypeError, match="callback must be a function"):
                    handle.add_done_callback(wrong)
            await handle
            with pytest.raises(TypeError, match="callback must be a function"):
                handle.add_done_callback(None)
