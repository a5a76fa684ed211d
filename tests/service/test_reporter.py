"""States at the rate that was asked for, on the virtual clock."""

from __future__ import annotations

import asyncio
from collections import Counter
from dataclasses import dataclass
from typing import Any

from rs485bus import Bus, MksServo, open_bus
from rs485bus.service.clock import Clock
from rs485bus.service.desk import Desk
from rs485bus.service.reporter import Reporter
from rs485bus.service.schema import AxisReport, Message
from rs485bus.service.topics import Topics
from rs485bus.sim import SimMks, VirtualLine
from tests.integration.support import virtual
from tests.service.office import table

TOPICS = Topics("cell")


@dataclass
class Plant:
    """Axes of one bus."""

    buses: dict[str, Bus]
    axes: dict[str, Any]
    name: str = "cell"
    groups: Any = None
    vehicle: Any = None


@virtual
async def test_four_axes_of_a_pair_that_move_are_told_twenty_times_a_second_each() -> None:
    """Whatever a look takes: a state that is late by some milliseconds is told, and the beat does not drift."""
    line = VirtualLine(*(SimMks(address) for address in range(1, 5)), baudrate=115200)
    async with open_bus(line) as bus:
        axes = {f"a{address}": MksServo(bus, address) for address in range(1, 5)}
        told: list[tuple[str, AxisReport]] = []

        def publish(topic: str, message: Message, **options: Any) -> None:
            if topic.endswith("/state"):
                assert isinstance(message, AxisReport)
                told.append((topic, message))

        desk = Desk(TOPICS, {name: frozenset({name}) for name in axes}, table)
        reporter = Reporter(Plant({"main": bus}, axes), desk, Clock(), TOPICS, publish, 20.0)
        for axis in axes.values():
            await axis.enable()
            await axis.run(30)
        reporting = asyncio.create_task(reporter.run())
        await asyncio.sleep(1)
        told.clear()
        await asyncio.sleep(5)
        counts = Counter(topic for topic, _ in told)
        assert len(counts) == 4
        assert all(99 <= count <= 101 for count in counts.values()), counts
        assert all(report.moving for _, report in told)
        reporting.cancel()
        await asyncio.gather(reporting, return_exceptions=True)


@virtual
async def test_an_axis_that_stands_is_looked_at_once_a_second_and_told_as_often() -> None:
    line = VirtualLine(SimMks(1), baudrate=115200)
    async with open_bus(line) as bus:
        axis = MksServo(bus, 1)
        told: list[AxisReport] = []

        def publish(topic: str, message: Message, **options: Any) -> None:
            if topic.endswith("/state"):
                assert isinstance(message, AxisReport)
                told.append(message)

        desk = Desk(TOPICS, {"a": frozenset({"a"})}, table)
        reporter = Reporter(Plant({"main": bus}, {"a": axis}), desk, Clock(), TOPICS, publish, 20.0)
        reporting = asyncio.create_task(reporter.run())
        await asyncio.sleep(2)
        before, so_far = bus.stats.transactions, len(told)
        await asyncio.sleep(20)
        assert bus.stats.transactions - before <= 2 * 21  # position and status
        assert 19 <= len(told) - so_far <= 21
        assert not any(report.moving for report in told)
        reporting.cancel()
        await asyncio.gather(reporting, return_exceptions=True)


@virtual
async def test_the_status_of_an_axis_that_its_positions_show_to_move_is_not_asked_for() -> None:
    line = VirtualLine(SimMks(1), baudrate=115200)
    async with open_bus(line) as bus:
        axis = MksServo(bus, 1)
        await axis.enable()
        await axis.run(60)
        await asyncio.sleep(1)
        before = bus.stats.transactions
        moving = []
        async for sample in axis.samples(0.02):
            moving.append(sample.moving)
            if len(moving) == 50:
                break
        assert all(moving)
        assert bus.stats.transactions - before < 65  # 50 positions, and what the supervisor asks for in a second
        await axis.stop()
        async for sample in axis.samples(0.02):
            if sample.moving is False:
                break
