"""However a block is left, motors stand and watchdogs are off (or armed and unfed, where standing was not seen)."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import anyio
import pytest

from rs485bus import Bus, BusConfig, MksServo, open_bus
from rs485bus.errors import MotionError, MoveCancelled, MoveFailed, WatchdogInUse
from rs485bus.sim import SimMks, VirtualClockLoop
from tests.integration.support import Plant, bus_on, plant, virtual


class Boom(Exception):
    """What a body raises."""


async def guarded(made: Plant, body: Callable[[Bus, list[MksServo]], Coroutine[Any, Any, None]]) -> None:
    """Two drives under way, guarded, when the body runs."""
    async with bus_on(made) as (bus, axes), bus.watchdog(*axes, timeout=0.5):
        for axis in axes:
            axis.enable()
            axis.run(600)
            axis.run(500)
        await asyncio.sleep(1.0)
        assert not made.stands()
        await body(bus, axes)


def done(made: Plant) -> None:
    assert made.stands()
    assert made.watchdogs_off()
    assert made.line.pair.early_frames == 0


async def nothing(bus: Bus, axes: list[MksServo]) -> None:
    pass


async def forever(bus: Bus, axes: list[MksServo]) -> None:
    await asyncio.sleep(1e6)


@virtual
async def test_a_normal_end() -> None:
    made = plant(2)
    await guarded(made, nothing)
    done(made)


@virtual
async def test_a_normal_end_waits_for_queued_moves() -> None:
    made = plant(1)
    async with bus_on(made) as (_, (x,)):
        x.enable()
        x.move_to(3.0)
        x.move_by(1.0)
    assert made.shafts() == [pytest.approx(4.5)]
    done(made)


@virtual
async def test_an_exception_in_the_body_passes_unchanged() -> None:
    made = plant(2)
    error = Boom("boom")

    async def body(bus: Bus, axes: list[MksServo]) -> None:
        raise error

    with pytest.raises(Boom) as raised:
        await guarded(made, body)
    assert raised.value is error
    done(made)


@virtual
async def test_an_exception_stops_moves_that_are_queued() -> None:
    made = plant(1)
    with pytest.raises(Boom):
        async with bus_on(made) as (_, (x,)):
            x.enable()
            x.move_to(100.0)
            x.move_to(-100.0)
            await asyncio.sleep(0.5)
            raise Boom
    done(made)
    assert made.sims[0].moves == 1


@virtual
async def test_an_outer_cancel_scope() -> None:
    made = plant(2)
    with anyio.move_on_after(3.0) as scope:
        await guarded(made, forever)
    assert scope.cancelled_caught
    done(made)


@virtual
async def test_asyncio_timeout() -> None:
    made = plant(2)
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(3.0):
            await guarded(made, forever)
    done(made)


@virtual
async def test_a_failing_sibling_in_a_task_group() -> None:
    made = plant(2)

    async def sibling() -> None:
        await asyncio.sleep(3.0)
        raise Boom

    with pytest.raises(ExceptionGroup) as raised:
        async with asyncio.TaskGroup() as group:
            group.create_task(guarded(made, forever))
            group.create_task(sibling())
    assert raised.group_contains(Boom)
    done(made)


@virtual
async def test_a_task_that_is_cancelled_twice() -> None:
    made = plant(2)
    task = asyncio.create_task(guarded(made, forever))
    await asyncio.sleep(3.0)
    task.cancel()
    await asyncio.sleep(0.001)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    done(made)


@virtual
async def test_a_task_that_is_cancelled_again_and_again() -> None:
    made = plant(2)
    task = asyncio.create_task(guarded(made, forever))
    await asyncio.sleep(3.0)
    while not task.done():
        task.cancel()
        await asyncio.sleep(0.0005)
    assert task.cancelled()
    done(made)


@pytest.mark.parametrize("opened", ["as a block", "by await"])
def test_the_teardown_of_asyncio_run(opened: str) -> None:
    made = plant(2)
    state: list[bool] = []

    async def by_await() -> None:
        bus = await open_bus(made.line)
        x = MksServo(bus, 1)
        x.enable()
        x.run(600)
        await asyncio.sleep(1e6)

    async def main() -> None:
        task = asyncio.create_task(guarded(made, forever) if opened == "as a block" else by_await())
        await asyncio.sleep(3.0)
        assert not made.stands()
        del task

    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        runner.run(main())
        loop = runner.get_loop()
        for task in asyncio.all_tasks(loop):
            task.cancel()
        tasks = asyncio.all_tasks(loop)
        loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        state.append(any(sim.moving(loop.time()) for sim in made.sims))
    assert state == [False]
    assert made.watchdogs_off()


@virtual
async def test_entered_in_one_task_and_left_in_another() -> None:
    made = plant(2)
    opening = open_bus(made.line)

    async def enter() -> Bus:
        return await opening.__aenter__()

    bus = await asyncio.create_task(enter())
    x = MksServo(bus, 1)
    x.enable()
    x.run(600)
    await asyncio.sleep(2.0)
    await asyncio.create_task(opening.__aexit__(None, None, None))
    done(made)


@virtual
async def test_awaited_and_closed_in_another_task() -> None:
    made = plant(1)
    bus = await open_bus(made.line)
    x = MksServo(bus, 1)
    x.enable()
    x.run(600)
    await asyncio.sleep(2.0)
    await asyncio.create_task(bus.aclose())
    await bus.aclose()
    done(made)


@virtual
async def test_cancelled_in_the_middle_of_arming() -> None:
    made = plant(2)

    async def main() -> None:
        async with bus_on(made) as (bus, axes), bus.watchdog(*axes, timeout=0.5):
            await asyncio.sleep(1e6)

    task = asyncio.create_task(main())
    await asyncio.sleep(0.004)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    done(made)


@virtual
async def test_a_move_that_its_watchdog_block_ended_is_cancelled_and_no_fault() -> None:
    made = plant(1)
    async with bus_on(made) as (bus, (x,)):
        await x.enable()
        with pytest.raises(Boom):
            async with bus.watchdog(x, timeout=0.5):
                move = x.move_to(50.0)
                await asyncio.sleep(0.5)
                raise Boom
        with pytest.raises(MoveCancelled, match="its watchdog block was left"):
            await move
        assert made.stands()


@virtual
async def test_a_watchdog_that_cannot_be_turned_off_is_tried_again_and_warned_about(
    caplog: pytest.LogCaptureFixture,
) -> None:
    made = plant(2)
    deaf_for = {1: 3, 2: 100}
    for sim in made.sims:

        def receive(frame: bytes, now: float, sim: SimMks = sim, hear: Any = sim.receive) -> bytes | None:
            off = frame[1:4] == b"\x10\x00\x98" and frame[7:11] == bytes(4)
            if off and deaf_for[sim.address]:
                deaf_for[sim.address] -= 1
                return None
            reply: bytes | None = hear(frame, now)
            return reply

        sim.receive = receive  # type: ignore[method-assign]
    async with bus_on(made) as (bus, axes):
        async with bus.watchdog(*axes, timeout=1.0):
            await axes[1].enable()
            await axes[1].move_by(0.1)
        assert [sim.watchdog_ms for sim in made.sims] == [0, 1000]
        assert "MKS 2: its watchdog could not be set back" in caplog.text
        assert "MKS 1" not in caplog.text


@virtual
async def test_a_drive_that_tripped_has_its_watchdog_off_after_the_block() -> None:
    made = plant(2)
    loop = asyncio.get_running_loop()
    async with bus_on(made) as (bus, axes):
        async with bus.watchdog(*axes, timeout=0.5):
            await axes[0].enable()
            await axes[0].run(600)
            loop._jumping.now += 3.0  # type: ignore[attr-defined] # three seconds in which nothing ran
            await asyncio.sleep(0.5)
            assert made.sims[0].trips
        assert made.watchdogs_off()
        await axes[0].enable()
        axes[0].run(600)
        await asyncio.sleep(2.0)
        assert not made.stands()
        await axes[0].stop()


@virtual
async def test_a_device_is_guarded_by_one_block_at_a_time() -> None:
    made = plant(2)
    async with bus_on(made) as (bus, (x, y)):
        async with x.watchdog(0.5):
            with pytest.raises(WatchdogInUse, match="MKS 1 is guarded by another"):
                async with bus.watchdog(x, y, timeout=1.0):
                    pass
            assert made.sims[0].watchdog_ms == 500
            assert made.sims[1].watchdog_ms == 0
            async with y.watchdog(1.0):
                assert made.sims[1].watchdog_ms == 1000
        async with x.watchdog(0.7):
            assert made.sims[0].watchdog_ms == 700
        with pytest.raises(ValueError, match="guards nothing"):
            bus.watchdog(timeout=1.0)
    assert made.watchdogs_off()


@virtual
async def test_closing_the_bus_inside_a_watchdog_block() -> None:
    made = plant(1)
    bus = await open_bus(made.line)
    x = MksServo(bus, 1)
    async with x.watchdog(0.5):
        x.enable()
        x.run(600)
        await asyncio.sleep(1.0)
        await bus.aclose()
        done(made)


@virtual
async def test_where_standing_is_not_seen_the_watchdog_stays_armed_and_unfed() -> None:
    made = plant(1)
    sim = made.sims[0]
    with pytest.raises(MotionError, match="could not be seen standing"):
        async with bus_on(made, BusConfig(close_timeout=0.5)) as (_, (x,)), x.watchdog(1.0):
            x.enable()
            x.run(600)
            await asyncio.sleep(1.0)
            sim._commands[0xF7] = lambda value, now: None
            sim._blocks.clear()
    assert sim.watchdog_ms == 1000
    await asyncio.sleep(1.5)
    assert made.stands()
    assert sim.trips


@virtual
async def test_motors_are_left_turning_only_if_that_was_asked_for() -> None:
    made = plant(1)
    async with bus_on(made, BusConfig(leave_running=True)) as (_, (x,)):
        x.enable()
        x.run(600)
    assert not made.stands()


@virtual
async def test_a_failure_that_nobody_awaited_is_raised_from_the_block(caplog: pytest.LogCaptureFixture) -> None:
    made = plant(1)
    with pytest.raises(ExceptionGroup) as raised:
        async with bus_on(made) as (_, (x,)):
            x.enable()
            x.move_to(50.0)
            x.move_to(60.0)
            await asyncio.sleep(1.0)
            made.sims[0].motion.machine.travel = (-1000.0, made.shafts()[0])
    assert len(raised.value.exceptions) == 1  # the root failure, not those it cancelled
    assert raised.group_contains(MoveFailed)
    assert "move to 50 of MKS 1 failed" in caplog.text
    done(made)


@virtual
async def test_beside_an_exception_of_the_body_it_becomes_a_note() -> None:
    made = plant(1)
    with pytest.raises(Boom) as raised:
        async with bus_on(made) as (_, (x,)):
            x.enable()
            x.move_to(50.0)
            await asyncio.sleep(1.0)
            made.sims[0].motion.machine.travel = (-1000.0, made.shafts()[0])
            await asyncio.sleep(20.0)
            raise Boom
    assert "Nobody awaited a command that failed: MotorStalled" in raised.value.__notes__[0]
