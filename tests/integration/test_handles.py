"""Handles work with asyncio and anyio as their users expect."""

import ast
import asyncio
import inspect
import signal
from types import FunctionType
from typing import Any

import anyio
import pytest

from rs485bus import MoveState
from rs485bus.bus.handle import Handle
from rs485bus.errors import MotionError, MoveCancelled, MoveFailed, MoveTimeout, RearmRequired
from rs485bus.sim import VirtualClockLoop
from tests.integration.support import bus_on, plant, virtual


@virtual
async def test_gather_waits_for_several() -> None:
    async with bus_on(plant(2)) as (_, (x, y)):
        x.enable()
        y.enable()
        assert await asyncio.gather(x.move_to(1.0), y.move_to(2.0), x.move_by(0.5)) == [1.0, 2.0, 1.5]


@virtual
async def test_gather_raises_what_a_move_raises() -> None:
    made = plant(2)
    async with bus_on(made) as (_, (x, y)):
        x.enable()
        y.enable()
        made.sims[0].motion.machine.travel = (-10.0, 1.0)
        with pytest.raises(MoveFailed):
            await asyncio.gather(x.move_to(3.0), y.move_to(2.0))
        results = await asyncio.gather(y.move_to(3.0), return_exceptions=True)
        assert results == [3.0]


@virtual
async def test_wait_for_leaves_the_move_alone_when_its_time_is_over() -> None:
    async with bus_on(plant()) as (_, (x,)):
        x.enable()
        move = x.move_to(20.0)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(move, 0.5)
        assert move.state is MoveState.MOVING
        assert await asyncio.wait_for(move, 60) == 20.0


@virtual
async def test_asyncio_timeout_and_anyio_scopes_leave_it_alone_too() -> None:
    async with bus_on(plant()) as (_, (x,)):
        x.enable()
        move = x.move_to(20.0)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.5):
                await move
        with anyio.move_on_after(0.5):
            await move
        assert await move == 20.0


@virtual
async def test_shield_and_ensure_future() -> None:
    async with bus_on(plant()) as (_, (x,)):
        x.enable()
        assert await asyncio.shield(x.move_to(1.0)) == 1.0
        assert await asyncio.ensure_future(x.move_to(2.0)) == 2.0


@virtual
async def test_task_groups_take_their_wait() -> None:
    async with bus_on(plant(2)) as (_, (x, y)):
        x.enable()
        y.enable()
        async with asyncio.TaskGroup() as group:
            task = group.create_task(x.move_to(1.0).wait())
        assert task.result() == 1.0
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(x.move_to(2.0).wait)
            tasks.start_soon(y.move_to(2.0).wait)
        assert (await x.position(), await y.position()) == (2.0, 2.0)


@virtual
async def test_a_handle_may_be_awaited_by_many_and_again() -> None:
    async with bus_on(plant()) as (_, (x,)):
        x.enable()
        move = x.move_to(1.0)
        results = await asyncio.gather(move, move, move.wait())
        assert [*results, await move] == [1.0] * 4
        assert move.done()


def test_a_notebook_cell_awaits_handles_at_top_level() -> None:
    """A notebook compiles a cell with top-level await, and runs each on the same loop."""
    cells = [
        "from rs485bus import MksServo, open_bus",
        "bus = await open_bus(made.line)",
        "x = MksServo(bus, 1)\nx.enable()\nmove = x.move_to(2.0)",
        "reached = await move",
        "await bus.aclose()",
    ]
    names: dict[str, Any] = {"made": plant()}
    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        runner.run(asyncio.sleep(0))
        loop = runner.get_loop()

        async def run(cell: str) -> None:
            code = compile(cell, "<cell>", "exec", flags=ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
            result = FunctionType(code, names)()
            if inspect.iscoroutine(result):
                await result

        for cell in cells:
            loop.run_until_complete(run(cell))
    assert names["reached"] == 2.0


@virtual
async def test_cancelling_a_move_under_way_stops_the_axis() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        x.enable()
        move, behind = x.move_to(50.0), x.move_to(60.0)
        await asyncio.sleep(1.0)
        move.cancel()
        with pytest.raises(MoveCancelled, match="move to 50 of MKS 1 was cancelled"):
            await move
        with pytest.raises(MoveCancelled):
            await behind
        await x.drain()
        assert made.stands()
        assert await x.move_to(1.0) == 1.0


@virtual
async def test_cancelling_a_move_that_waits_takes_it_out_of_the_queue_only() -> None:
    async with bus_on(plant()) as (_, (x,)):
        x.enable()
        first, second, third = x.move_to(1.0), x.move_to(2.0), x.move_to(3.0)
        second.cancel()
        with pytest.raises(MoveCancelled):
            await second
        assert (await first, await third) == (1.0, 3.0)
        assert second.state is MoveState.CANCELLED


@virtual
async def test_a_block_around_a_move_waits_for_it() -> None:
    async with bus_on(plant()) as (_, (x,)):
        x.enable()
        async with x.move_to(2.0) as move:
            assert not move.done()
        assert move.state is MoveState.DONE


@virtual
async def test_a_block_around_a_move_that_raises_stops_the_axis() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        x.enable()
        with pytest.raises(RuntimeError):
            async with x.move_to(50.0):
                await asyncio.sleep(1.0)
                raise RuntimeError
        await x.drain()
        assert made.stands()


@virtual
async def test_a_block_around_a_move_that_is_cancelled_at_its_end_stops_the_axis() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        x.enable()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(1.0), x.move_to(50.0):
                pass
        await asyncio.sleep(2.0)
        assert made.stands()
        assert await x.position() < 49.0


@virtual
async def test_positions_follow_a_move_to_its_end() -> None:
    async with bus_on(plant()) as (_, (x,)):
        x.enable()
        seen = [position async for position in x.move_to(10.0).positions(every=0.2)]
        assert seen == sorted(seen)
        assert len(seen) > 8
        assert seen[-1] == 10.0


@virtual
async def test_positions_raise_what_the_move_raises() -> None:
    made = plant()
    made.sims[0].motion.machine.travel = (-10.0, 1.0)
    async with bus_on(made) as (_, (x,)):
        x.enable()
        with pytest.raises(MoveFailed):
            async for _ in x.move_to(3.0).positions():
                pass


@virtual
async def test_a_move_tells_how_far_it_is_and_what_the_drive_makes_of_it() -> None:
    async with bus_on(plant()) as (bus, (x,)):
        await x.enable()
        move = x.move_to(10.0, rpm=600.4, acceleration=990)
        assert (move.state, move.started_at, move.eta) == (MoveState.QUEUED, None, None)
        await asyncio.sleep(0.5)
        assert move.state is MoveState.MOVING
        assert (move.rpm, move.acceleration) == (600.0, 1000.0)
        assert move.started_at is not None
        assert move.eta is not None
        assert move.eta - move.started_at == pytest.approx(10 / 10 + 0.6)
        await move
        assert bus.now() - move.eta < 0.06


@virtual
async def test_a_run_is_done_once_its_speed_is_reached() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        x.enable()
        await x.run(-300)
        assert await x.velocity() == pytest.approx(-300, abs=10)
        await x.run(0)
        assert made.stands()
        start = await x.position()
        await x.run(120, duration=1.5)
        assert made.stands()
        assert await x.position() - start == pytest.approx(3.0, abs=0.3)


@virtual
async def test_a_relative_move_after_a_run_starts_from_where_the_axis_stands() -> None:
    async with bus_on(plant()) as (_, (x,)):
        x.enable()
        x.run(300)
        await x.stop()
        before = await x.position()
        assert await x.move_by(1.0) == pytest.approx(before + 1.0)


@virtual
async def test_a_move_while_it_runs_first_brings_it_to_a_stand() -> None:
    async with bus_on(plant()) as (_, (x,)):
        x.enable()
        await x.run(300)
        assert await x.move_to(0.5) == 0.5


@virtual
async def test_relative_moves_do_not_add_up_their_errors() -> None:
    made = plant()
    made.sims[0].motion.machine.following_error = 3
    async with bus_on(made) as (_, (x,)):
        x.enable()
        x.set_zero()
        for _ in range(20):
            x.move_by(0.3)
        await x.drain()
        assert made.shafts()[0] - 0.5 == pytest.approx(6.0, abs=0.0002)


@virtual
async def test_a_move_that_never_ends_is_stopped_and_says_so() -> None:
    made = plant()
    async with bus_on(made) as (_, (x,)):
        await x.enable()
        made.sims[0].motion.settings[0x84] = 128  # the drive turns slower than the facade was told
        with pytest.raises(MoveTimeout, match="more than twice its time"):
            await x.move_to(10.0)
        await x.drain()
        assert made.stands()


@virtual
async def test_a_signal_handler_may_stop_everything() -> None:
    made = plant(2)
    async with bus_on(made) as (bus, (x, y)):
        for axis in (x, y):
            axis.enable()
            axis.run(600)
        await asyncio.sleep(1.0)
        loop = asyncio.get_running_loop()
        loop.add_signal_handler(signal.SIGUSR1, bus.emergency_stop)
        signal.raise_signal(signal.SIGUSR1)
        await asyncio.sleep(1.0)
        loop.remove_signal_handler(signal.SIGUSR1)
        assert made.stands()
        assert bus.latched


@virtual
async def test_a_stop_that_nobody_awaits_happens_and_one_whose_awaiter_is_cancelled_too() -> None:
    made = plant(2)
    async with bus_on(made) as (_, (x, y)):
        for axis in (x, y):
            axis.enable()
            axis.run(600)
        await asyncio.sleep(1.0)
        x.stop()

        async def stop() -> None:
            await y.stop()

        stopping = asyncio.create_task(stop())
        await asyncio.sleep(0)
        stopping.cancel()
        await asyncio.sleep(1.0)
        assert made.stands()


@virtual
async def test_a_failure_whose_only_waiter_gives_up_at_the_same_moment_is_raised_from_the_block() -> None:
    for given_up_first in (True, False):
        with pytest.raises(ExceptionGroup) as group:
            async with bus_on(plant()) as (bus, _):
                handle: Handle[None] = Handle("test", bus.unseen)
                waiting = asyncio.create_task(handle.wait())
                await asyncio.sleep(0)
                if given_up_first:
                    waiting.cancel()
                handle.fail(MotionError("it failed"))
                waiting.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await waiting
        assert str(group.value.exceptions[0]) == "it failed"


@virtual
async def test_a_failure_is_not_logged_that_is_waited_for_by_who_asked(caplog: pytest.LogCaptureFixture) -> None:
    async with bus_on(plant()) as (bus, (x,)):
        await bus.emergency_stop()
        bus.clear_emergency_stop()
        caplog.clear()
        # It fails before the task that waits for it has begun.
        with pytest.raises(RearmRequired):
            await asyncio.gather(x.move_to(1.0))
        with pytest.raises(RearmRequired):
            await asyncio.wait_for(x.move_to(1.0), 5.0)
        await asyncio.sleep(0.1)
        assert "failed" not in caplog.text
