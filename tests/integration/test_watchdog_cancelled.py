"""Entering, using and leaving a watchdog block, cancelled at every await: it ends, and the drives are off or unfed."""

from __future__ import annotations

import asyncio
import logging
import types
from collections.abc import Callable, Coroutine, Generator
from typing import Any

import pytest

from rs485bus import Bus, BusConfig, MksServo, Zlac8015d, open_bus
from rs485bus.sim import VirtualClockLoop, VirtualLine
from tests.integration.guarded import SET_HEARTBEAT, FaultyMks, FaultyZlac

ENDS_WITHIN = 6.0


class World:
    """Two drives on a line, and what becomes of them."""

    def __init__(self) -> None:
        self.mks, self.zlac = FaultyMks(1), FaultyZlac(2, watchdog=0)
        self.line = VirtualLine(self.mks, self.zlac)
        self.bus: Bus
        self.x: MksServo
        self.base: Zlac8015d

    @property
    def sims(self) -> tuple[FaultyMks, FaultyZlac]:
        return self.mks, self.zlac

    def stands(self) -> bool:
        now = self.bus.now()
        return not self.mks.moving(now) and not any(self.zlac.rpm(now))

    def armed(self) -> list[int]:
        return [sim.address for sim in self.sims if sim.watchdog_ms]

    def fed(self) -> list[int]:
        return [watch.address for watch in self.bus.owner.feeding.all() if watch.retry_at != float("inf")]


async def use(world: World) -> None:
    async with world.bus.watchdog(world.x, world.base, timeout=0.6):
        await world.x.run(60)
        world.base.run(20, 20)
        await asyncio.sleep(0.5)


async def use_and_drain(world: World) -> None:
    async with world.bus.watchdog(world.x, world.base, timeout=0.6):
        world.x.move_to(1.0)
        world.x.move_by(1.0)
        world.base.move_by(0.5, 0.5)


async def use_and_fail(world: World) -> None:
    async with world.bus.watchdog(world.x, world.base, timeout=0.6):
        await world.x.run(60)
        raise KeyError


async def a_drive_is_silent_to_its_arming(world: World) -> None:
    world.mks.deaf_to = lambda frame: frame[1:4] == SET_HEARTBEAT
    try:
        async with world.bus.watchdog(world.base, world.x, timeout=0.6):
            pass
    finally:
        world.mks.deaf_to = lambda frame: False


async def a_drive_dies(world: World) -> None:
    async with world.bus.watchdog(world.x, world.base, timeout=0.6):
        await world.x.run(60)
        await world.base.run(20, 20)
        world.mks.dead = True


async def the_port_is_lost(world: World) -> None:
    async with world.bus.watchdog(world.x, world.base, timeout=0.6):
        await world.x.run(60)
        world.x.move_to(5.0)
        world.line.unplug()
        await asyncio.sleep(0.3)


async def the_port_is_lost_while_it_is_entered(world: World) -> None:
    loss = asyncio.get_running_loop().call_later(0.006, world.line.unplug)
    try:
        async with world.bus.watchdog(world.x, world.base, timeout=0.6):
            await asyncio.sleep(1.0)
    finally:
        loss.cancel()


@types.coroutine
def _cancelling(
    coroutine: Coroutine[Any, Any, None], at: int, times: int, cancelled: list[float]
) -> Generator[Any, Any, None]:
    """Run a coroutine, and cancel its task at the await of that number, so many times."""
    task, steps = asyncio.current_task(), 0
    assert task is not None
    loop = asyncio.get_running_loop()
    send, value = coroutine.send, None
    while True:
        try:
            future = send(value)
        except StopIteration:
            return
        steps += 1
        if at <= steps < at + times:
            cancelled.append(loop.time())
            loop.call_soon(task.cancel)
        try:
            send, value = coroutine.send, (yield future)
        except BaseException as error:
            send, value = coroutine.throw, error  # type: ignore[assignment]


def run(story: Callable[[World], Coroutine[Any, Any, None]], at: int, times: int, logged: Callable[[], str]) -> bool:
    """Carry out a story, cancelled at an await. False if it has no such await."""

    async def main() -> bool:
        world = World()
        told: list[str] = []
        reached = False
        try:
            async with open_bus(world.line, config=BusConfig(reopen_max=0.2)) as bus:
                world.bus, world.x, world.base = bus, MksServo(bus, 1), Zlac8015d(bus, 2)
                await world.x.enable()
                await world.base.enable()
                cancelled: list[float] = []

                async def go() -> None:
                    await _cancelling(story(world), at, times, cancelled)

                task = asyncio.ensure_future(go())
                done, _ = await asyncio.wait([task], timeout=60.0)
                assert done, "it never ended"
                try:
                    task.result()
                except (Exception, asyncio.CancelledError) as error:
                    told += [repr(error), *getattr(error, "__notes__", [])]
                reached = bool(cancelled)
                assert not cancelled or bus.now() - cancelled[0] < ENDS_WITHIN
                for address in world.armed():
                    # What is armed still is not fed, or the bus is at it; and that was said.
                    assert address not in world.fed()
                    assert any(word in " ".join(told) + logged() for word in ("seen standing", "set back", "port"))
                # Whatever happened: when the line and the drives are there again all of it is brought to an end.
                world.mks.dead = False
                world.line.plug()
                await asyncio.sleep(8.0)
                assert world.stands()
                assert world.armed() == []
                assert world.fed() == []
                assert not any(bus.owner.units[sim.address].guarded for sim in world.sims)
                await world.x.enable()
                async with bus.watchdog(world.x, timeout=0.6):
                    await world.x.move_by(0.1)
                assert world.armed() == []
        except ExceptionGroup as group:
            told += [repr(error) for error in group.exceptions]
        return reached

    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        return runner.run(main())


@pytest.mark.parametrize("times", [1, 50])
@pytest.mark.parametrize(
    "story",
    [
        use,
        use_and_drain,
        use_and_fail,
        a_drive_is_silent_to_its_arming,
        a_drive_dies,
        the_port_is_lost,
        the_port_is_lost_while_it_is_entered,
    ],
)
def test_cancelled_at_any_await_a_block_ends_in_time_with_its_drives_off_or_unfed_and_told(
    story: Callable[[World], Coroutine[Any, Any, None]], times: int, caplog: pytest.LogCaptureFixture
) -> None:
    at = 1
    with caplog.at_level(logging.WARNING, "rs485bus"):
        while True:
            caplog.clear()
            if not run(story, at, times, lambda: caplog.text):
                break
            at += 1
    assert at > 1


def test_ctrl_c_while_the_port_is_away_ends_the_entry() -> None:
    """Entering does not wait for a port, so that there is nothing for Ctrl-C to be put off by."""
    world = World()

    async def main() -> float:
        async with open_bus(world.line) as bus:
            world.x = MksServo(bus, 1)
            await world.x.position()
            world.line.unplug()
            await asyncio.sleep(0.01)
            begun = bus.now()
            task = asyncio.ensure_future(world.x.watchdog(1.0).__aenter__())
            await asyncio.wait([task], timeout=60.0)
            assert task.done()
            assert task.exception() is not None
            return bus.now() - begun

    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        assert runner.run(main()) < 0.1
