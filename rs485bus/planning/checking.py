"""The plan beside the simulation: the same quantities, measured on the facades in virtual time."""

from __future__ import annotations

import asyncio
import random
from typing import NamedTuple

from rs485bus.bus.record import Record
from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.axis import Axis
from rs485bus.planning.plan import PairPlan, settle, virtual_plant
from rs485bus.planning.streams import between_set_points
from rs485bus.plant import Plant, PlantFile
from rs485bus.sim import VirtualClockLoop

_CYCLES = 20
_STOPS = 60
_OFTEN = 0.0031
"""Seconds between two set-points: not those by which the plan was made."""
_APART = 0.02
"""Seconds between two cycles: who asks at once again may be told what was just asked."""
_JUST_AFTER = 1e-5
"""Seconds."""


class Measured(NamedTuple):
    """One quantity."""

    name: str
    planned: float
    measured: float
    within: float = 0.03
    """By which part they may differ."""

    @property
    def agrees(self) -> bool:
        """Whether the plan is right."""
        return self.off <= self.within

    @property
    def off(self) -> float:
        """By which part the plan differs from what was measured."""
        return abs(self.planned - self.measured) / self.measured if self.measured else abs(self.planned)


def check(pair: PairPlan, file: PlantFile) -> list[Measured]:
    """Measure what a plan says."""
    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        return runner.run(_check(pair, file))


async def _check(pair: PairPlan, file: PlantFile) -> list[Measured]:
    loop = asyncio.get_running_loop()
    plant = virtual_plant(pair, file)
    async with plant:
        bus = plant.buses[pair.bus]
        listens = await settle(pair, plant)
        before, began = bus.stats.airtime, loop.time()
        await asyncio.sleep(listens)
        load = (bus.stats.airtime - before) / (loop.time() - began)
        found = [Measured("load while standing", pair.load_standing, load)]
        found.append(Measured("positions asked in turn", pair.poll_rate, 1 / await _cycle(plant, pair)))
        _, apart = await between_set_points(list(plant.axes.values()), _OFTEN)
        if apart:
            found.append(Measured("set-points to the slowest axis", pair.set_point_rate, 1 / apart))
        found.append(
            Measured(
                "longest wait of a stop behind them", pair.stop_wait_behind_positions, await _stop_wait(plant, pair)
            )
        )
    return found


async def _cycle(plant: Plant, pair: PairPlan) -> float:
    """How long it takes to ask all axes for their positions, one after another, in seconds."""
    bus, records, cycles = plant.buses[pair.bus], list[Record](), list[float]()
    end = bus.subscribe(records.append)
    while len(cycles) < _CYCLES:
        await asyncio.sleep(_APART)
        records.clear()
        for axis in plant.axes.values():
            await axis.position()
        if all(record.urgency > Urgency.CONFIRM for record in records):
            cycles.append(records[-1].ended_at - records[0].sent_at + bus.stats.silence)
    end()
    return sum(cycles) / len(cycles)


async def _stop_wait(plant: Plant, pair: PairPlan) -> float:
    """The longest wait of stops that are asked for right after a question for a position has begun, in seconds."""
    loop, bus = asyncio.get_running_loop(), plant.buses[pair.bus]
    axes = list(plant.axes.values())
    asked_at: list[float] = []
    waits: list[float] = []

    def see(record: Record) -> None:
        if record.urgency is Urgency.STOP and len(waits) < len(asked_at):
            waits.append(record.sent_at - asked_at[-1])
        elif record.urgency > Urgency.CONFIRM and len(waits) == len(asked_at) and rng.random() < 0.3:
            loop.call_later(pair.silence + _JUST_AFTER, stop)

    def stop() -> None:
        if len(waits) == len(asked_at):
            asked_at.append(loop.time())
            rng.choice(axes).stop()

    async def ask(axis: Axis) -> None:
        while True:
            await axis.position()
            await asyncio.sleep(_APART / 4)

    rng = random.Random(1)
    end = bus.subscribe(see)
    asking = [asyncio.ensure_future(ask(axis)) for axis in axes]
    while len(waits) < _STOPS:  # noqa: ASYNC110 - in virtual time
        await asyncio.sleep(0.01)
    end()
    for task in asking:
        task.cancel()
    await asyncio.gather(*asking, return_exceptions=True)
    return max(waits)
