"""Blocks entered, left, nested, cancelled and entered again, on several devices and buses, with ports that are lost.

What the drives' registers hold and what the drives heard is compared with what the blocks promise. The oracle knows
nothing else.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rs485bus import Bus, BusConfig, MksServo, Zlac8015d, open_bus
from rs485bus.bus.watchdog.guard import WatchdogGuard
from rs485bus.errors import BusError, MotionError, NotGuarding, StopUnconfirmed, WatchdogInUse
from rs485bus.sim import SimMks, SimZlac, VirtualClockLoop, VirtualLine

ENDS_WITHIN = 6.0
LEASE = 0.4
AS_SHIPPED = 1000
"""What the ZLAC's register holds at first, in ms."""

Facade = MksServo | Zlac8015d


@dataclass
class Drive:
    """A drive, and what its register must hold while no block guards it; None where nobody can know."""

    sim: SimMks | SimZlac
    facade: Facade
    line: VirtualLine
    former: int | None
    guarded_by: int | None = None

    def stands(self, now: float) -> bool:
        return not self.sim.moving(now) if isinstance(self.sim, SimMks) else not any(self.sim.rpm(now))


@dataclass
class Block:
    """One block, as the application holds it."""

    guard: WatchdogGuard
    drives: list[Drive]
    timeout: float
    lease: float | None
    entered: bool = False
    alive_until: float = float("inf")


class Machine:
    """Two buses with three drives, four blocks over them, and the oracle."""

    def __init__(self) -> None:
        self.sims = (SimMks(1), SimZlac(2, watchdog=AS_SHIPPED), SimMks(1))
        self.lines = [VirtualLine(*self.sims[:2]), VirtualLine(self.sims[2])]
        self.drives: list[Drive] = []
        self.blocks: list[Block] = []
        self.buses: list[Bus] = []
        self.was_lost = [False, False]
        """Whether the port of a bus was away since nothing of it was guarded."""

    def open(self, buses: list[Bus]) -> None:
        self.buses = buses
        one, two = buses
        mks, zlac, other = MksServo(one, 1), Zlac8015d(one, 2), MksServo(two, 1)
        for sim, facade, line in zip(self.sims, (mks, zlac, other), (0, 0, 1), strict=True):
            self.drives.append(Drive(sim, facade, self.lines[line], sim.watchdog_ms))
        first, second, third = self.drives
        plans: list[tuple[Bus, list[Drive], float, float | None]] = [
            (one, [first], 0.6, None),
            (one, [first, second], 0.9, LEASE),
            (one, [second], 0.7, None),
            (two, [third], 0.5, LEASE),
        ]
        for bus_, drives, timeout, lease in plans:
            guard = bus_.watchdog(*(drive.facade for drive in drives), timeout=timeout, lease=lease)
            self.blocks.append(Block(guard, drives, timeout, lease))

    # What is done

    async def enter(self, number: int, cancel_after: int | None) -> None:
        block = self.blocks[number]
        if block.entered:
            return
        taken = any(drive.guarded_by is not None for drive in block.drives)
        entering = asyncio.ensure_future(block.guard.__aenter__())
        await self._bounded(entering, cancel_after)
        error = None if entering.cancelled() else entering.exception()
        if taken:
            assert entering.cancelled() or isinstance(error, WatchdogInUse)
        elif entering.cancelled() or error is not None:
            assert entering.cancelled() or isinstance(error, BusError | MotionError)
        else:
            block.entered, block.alive_until = True, self.now + (block.lease or float("inf"))
            for drive in block.drives:
                drive.guarded_by = number
                assert drive.sim.watchdog_ms == round(1000 * block.timeout)

    async def leave(self, number: int, cancel_after: int | None, fails: bool = False) -> None:
        block = self.blocks[number]
        if not block.entered:
            return
        error = KeyError() if fails else None
        leaving = asyncio.ensure_future(block.guard.__aexit__(type(error) if error else None, error, None))
        await self._bounded(leaving, cancel_after)
        told = None if leaving.cancelled() else leaving.exception()
        assert told is None or isinstance(told, StopUnconfirmed | BusError | MotionError)
        block.entered = False
        for drive in block.drives:
            drive.guarded_by = None
            if self.is_connected(drive) and told is None:
                assert drive.stands(self.now)
        self.judge_report(block)

    def renew(self, number: int) -> None:
        block = self.blocks[number]
        if block.entered:
            block.guard.renew()
            if block.lease is not None:  # one that has lapsed holds again, too: then its axes must be enabled
                block.alive_until = self.now + block.lease
        else:
            with contextlib.suppress(NotGuarding):
                block.guard.renew()
                raise AssertionError("renew() outside of the block was taken")

    async def run(self, number: int) -> None:
        facade = self.drives[number].facade
        with contextlib.suppress(BusError, MotionError):
            await asyncio.wait_for(facade.enable(), 3.0)
            await asyncio.wait_for(facade.run(20) if isinstance(facade, MksServo) else facade.run(20, 20), 3.0)

    async def write(self, milliseconds: int) -> None:
        """The application sets the ZLAC's register itself."""
        drive = self.drives[1]
        if drive.guarded_by is not None or not self.is_connected(drive):
            return
        drive.former = None
        with contextlib.suppress(BusError, MotionError):
            await self.buses[0].unit(2).write_register(0x2000, milliseconds)
            drive.former = milliseconds

    # What must be so

    @property
    def now(self) -> float:
        return asyncio.get_running_loop().time()

    def is_connected(self, drive: Drive) -> bool:
        return self.buses[self.lines.index(drive.line)].connected

    async def _bounded(self, task: asyncio.Future[Any], cancel_after: int | None) -> None:
        begun = self.now
        if cancel_after is not None:
            for _ in range(cancel_after):
                await asyncio.sleep(0)
                if task.done():
                    break
            task.cancel()
        await asyncio.wait([task], timeout=60.0)
        assert task.done(), "it never ended"
        assert self.now - begun <= ENDS_WITHIN

    def judge_report(self, block: Block) -> None:
        for report in block.guard.report():
            assert report.trips or report.longest < report.timeout + 1e-6

    def judge(self) -> None:
        """At any time."""
        for drive in self.drives:
            lost = self.was_lost[self.lines.index(drive.line)]
            if not lost:
                assert not drive.sim.trips, "a drive was starved whose port was never lost"
            if drive.guarded_by is None:
                continue
            block = self.blocks[drive.guarded_by]
            if not lost:
                assert drive.sim.watchdog_ms == round(1000 * block.timeout)
            if block.lease is not None and self.now > block.alive_until + 0.3 and not lost:
                assert drive.stands(self.now), "a lease lapsed, and the motor turns on"

    async def judge_the_end(self) -> None:
        """When all blocks were left, the ports are there, and some time has passed."""
        for drive in self.drives:
            if drive.former is not None:
                assert drive.sim.watchdog_ms == drive.former, "its register holds something else than before"
            fed = self.buses[self.lines.index(drive.line)].owner.feeding.get(drive.sim.address)
            assert fed is None or drive.sim.watchdog_ms, "what is off is fed"


after = st.none() | st.integers(1, 12)
number = st.integers(0, 3)
steps = st.one_of(
    st.tuples(st.just("enter"), number, after),
    st.tuples(st.just("enter"), number, st.none()),
    st.tuples(st.just("leave"), number, after),
    st.tuples(st.just("fail"), number, after),
    st.tuples(st.just("renew"), number, st.none()),
    st.tuples(st.just("run"), st.integers(0, 2), st.none()),
    st.tuples(st.just("wait"), st.sampled_from([1, 3, 10, 30]), st.none()),
    st.tuples(st.just("write"), st.sampled_from([0, 250, 800, 2000]), st.none()),
    st.tuples(st.just("unplug"), st.integers(0, 1), st.none()),
    st.tuples(st.just("plug"), st.integers(0, 1), st.none()),
)


async def _play(script: list[tuple[str, int, int | None]], logged: Callable[[], str]) -> None:
    machine = Machine()
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(contextlib.suppress(ExceptionGroup))
        config = BusConfig(reopen_max=0.2)
        machine.open([await stack.enter_async_context(open_bus(line, config=config)) for line in machine.lines])
        for what, argument, cancel_after in script:
            match what:
                case "enter":
                    await machine.enter(argument, cancel_after)
                case "leave" | "fail":
                    await machine.leave(argument, cancel_after, what == "fail")
                case "renew":
                    machine.renew(argument)
                case "run":
                    await machine.run(argument)
                case "wait":
                    await asyncio.sleep(argument / 10)
                case "write":
                    await machine.write(argument)
                case "unplug":
                    machine.was_lost[argument] = True
                    machine.lines[argument].unplug()
                case "plug":
                    machine.lines[argument].plug()
            machine.judge()
            assert "the event loop did not run" not in logged()
        for line in machine.lines:
            line.plug()
        for block in range(len(machine.blocks)):
            await machine.leave(block, None)
        await asyncio.sleep(8.0)
        await machine.judge_the_end()


@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(steps, min_size=3, max_size=14))
def test_blocks_keep_their_promises_whatever_order_they_come_in(
    caplog: pytest.LogCaptureFixture, script: list[tuple[str, int, int | None]]
) -> None:
    caplog.clear()
    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        runner.run(_play(script, lambda: caplog.text))
