"""Fifty plants of eight axes at one broker: latencies, loss, memory."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import random
import statistics
import sys
from collections import Counter
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.service.drives import plant_file
from benchmarks.service.mosquitto import running
from benchmarks.service.processes import cpu_seconds, memory
from benchmarks.service.standstills import Standstills
from rs485bus.errors import BusError
from rs485bus.plant import Plant
from rs485bus.remote import RemotePlant, connect
from rs485bus.service.broker import Broker
from rs485bus.service.ledger import Ledger
from rs485bus.service.schema import AxisReport
from rs485bus.service.service import Service

_DRIVES = 8
_EACH = 10
"""Plants in one process."""


@dataclass(slots=True)
class Many:
    """What was measured."""

    plants: int
    seconds: float
    pauses: Standstills = field(default_factory=Standstills)
    moves: Counter[str] = field(default_factory=Counter)
    questions: list[float] = field(default_factory=list)
    """Seconds until a question to a drive was answered."""
    ages: list[float] = field(default_factory=list)
    """Seconds that a state was old when it came in."""
    states: int = 0
    lost: int = 0
    memory: list[tuple[float, float]] = field(default_factory=list)
    """MB of a process of services after a while, and at the end."""
    broker_memory: float = 0.0
    cpu: float = 0.0
    broker_cpu: float = 0.0

    @property
    def holds(self) -> bool:
        whole = self.pauses.undisturbed >= self.seconds
        return whole and self.lost == 0 and set(self.moves) <= {"done"}

    def __str__(self) -> str:
        grown = max(end - begin for begin, end in self.memory)
        return (
            f"{self.plants} plants of {_DRIVES} axes for {self.pauses.undisturbed:.0f} s (the machine stood still "
            f"{self.pauses.count} times, for {self.pauses.stood:.0f} s: left out, with what followed); moves "
            f"{dict(self.moves)}; a question to a drive is answered after {_spread(self.questions)}; states are "
            f"{_spread(self.ages)} old when they come in, lost {self.lost} of {self.states}; memory "
            f"{max(end for _, end in self.memory):.0f} MB for {_EACH} plants and their drives (grown by {grown:.1f}), "
            f"mosquitto {self.broker_memory:.0f} MB; CPU {100 * self.cpu:.0f} % of a core for all services and their "
            f"drives, mosquitto {100 * self.broker_cpu:.1f} %"
        )


def _spread(seconds: list[float]) -> str:
    ordered = sorted(1000 * each for each in seconds)
    return f"{statistics.median(ordered):.0f} ms (median), {ordered[int(0.99 * len(ordered))]:.0f} ms (99 %)"


async def measure(folder: Path, plants: int, seconds: float) -> Many:
    """Serve so many plants, use each, and look."""
    many = Many(plants, seconds)
    names = [f"plant{number}" for number in range(plants)]
    with running(folder) as broker:
        async with contextlib.AsyncExitStack() as stack:
            processes = []
            for first in range(0, plants, _EACH):
                served = names[first : first + _EACH]
                processes.append(await stack.enter_async_context(_served(folder, broker.url, served)))
            cells = [await stack.enter_async_context(connect(broker.url, plant=name, lease=5.0)) for name in names]
            for cell in cells:
                _count(cell, many)
            using = [asyncio.create_task(_use(cell, many)) for cell in cells]
            await many.pauses.wait_for(min(30.0, seconds / 3))
            began = [(memory(process.pid), cpu_seconds(process.pid)) for process in processes]
            broker_began = cpu_seconds(broker.pid)
            loop = asyncio.get_running_loop()
            ran = loop.time() - many.pauses.stood
            await many.pauses.wait_for(seconds - many.pauses.undisturbed)
            ran = loop.time() - many.pauses.stood - ran
            many.memory = [(begin, memory(process.pid)) for (begin, _), process in zip(began, processes, strict=True)]
            taken = [cpu_seconds(process.pid) - cpu for (_, cpu), process in zip(began, processes, strict=True)]
            many.cpu, many.broker_cpu = sum(taken) / ran, (cpu_seconds(broker.pid) - broker_began) / ran
            many.broker_memory = memory(broker.pid)
            for task in using:
                task.cancel()
            await asyncio.gather(*using, return_exceptions=True)
            await asyncio.gather(*(cell.stop().wait() for cell in cells), return_exceptions=True)
    return many


def _count(cell: RemotePlant, many: Many) -> None:
    last: dict[str, int] = {}

    def count(name: str, report: AxisReport) -> None:
        if not many.pauses.disturbed:
            many.states += 1
            many.lost += max(0, report.n - last.get(name, report.n - 1) - 1)
            if report.n % 10 == 0:
                many.ages.append(cell.session.now() - report.at)
        last[name] = report.n

    cell.session.on_state.append(count)


async def _use(cell: RemotePlant, many: Many) -> None:
    """Ask, and move two axes together, every other second or so."""
    loop = asyncio.get_running_loop()
    chance = random.Random(cell.name)
    axes = list(cell.axes)
    ready = False
    while True:
        began, stops = loop.time(), many.pauses.count
        counts = not many.pauses.disturbed
        how = "done"
        try:
            if not ready:
                await cell.take_control()
                for name in axes:
                    await cell.axes[name].enable()
                ready = True
                continue
            await cell.axes[chance.choice(axes)].position()
            asked = loop.time() - began
            await cell.move_to(**{name: chance.uniform(-2, 2) for name in chance.sample(axes, 2)})
        except BusError as error:
            ready, how = False, type(error).__name__
        await asyncio.sleep(0.2)  # where the machine stood still meanwhile, that is known now
        if counts and stops == many.pauses.count and not many.pauses.disturbed:
            many.moves[how] += 1
            if how == "done":
                many.questions.append(asked)
        await asyncio.sleep(chance.uniform(0.8, 2.8))


@contextlib.asynccontextmanager
async def _served(folder: Path, url: str, names: list[str]) -> AsyncIterator[asyncio.subprocess.Process]:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "benchmarks.service.many", str(folder), url, *names),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
    )
    try:
        assert process.stdout is not None
        await process.stdout.readline()
        yield process
    finally:
        assert process.stdin is not None
        process.stdin.close()
        await process.wait()


async def _serve(folder: Path, url: str, names: list[str]) -> None:
    """Serve plants with virtual drives until the standard input ends."""
    logging.disable(logging.WARNING)
    async with contextlib.AsyncExitStack() as stack:
        services = []
        for name in names:
            file = folder / f"{name}.toml"
            file.write_text(plant_file(name, {"b0": "/dev/null"}, _DRIVES, rpm=600))
            plant = await stack.enter_async_context(Plant.load(file, sim=True))
            ledger = Ledger(folder / f"{name}.sqlite")
            stack.callback(ledger.close)
            service = Service(plant, Broker.at(url), ledger)
            services.append(asyncio.create_task(service.run()))
            await service.online.wait()
        print(json.dumps(names), flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
        for running_service in services:
            running_service.cancel()
        await asyncio.gather(*services, return_exceptions=True)


if __name__ == "__main__":
    asyncio.run(_serve(Path(sys.argv[1]), sys.argv[2], sys.argv[3:]))
