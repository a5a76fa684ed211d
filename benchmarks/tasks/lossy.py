"""Units are read as fast as the library goes, on a line that loses frames: in turn, or each by a caller of its own.

What failed is asked again at once, and its time counts: what is measured is the time that a delivered answer takes.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import time
from collections.abc import Sequence

from benchmarks.clients.interface import AsyncClient, BlockingClient
from benchmarks.tasks.task import Result, Task

REPLY_TIMEOUT = 0.1
COUNT = 2
"""Registers a read."""
_WARM_UP = 0.3
"""Seconds before it counts."""


class Deliveries:
    """What was asked and what was told, as `benchmarks.judge` takes it."""

    def __init__(self, task: Task) -> None:
        self._begins = time.monotonic() + _WARM_UP
        self.ends = self._begins + task.seconds
        self._reads: list[tuple[int, int, int, float, list[int]]] = []
        self._requests = 0
        self._failed = 0
        self._counted: dict[int, int] = {}

    def asked(self) -> float:
        self._requests += 1
        return time.monotonic()

    def told(self, unit: int, asked_at: float, values: list[int]) -> None:
        self._reads.append((unit, unit, COUNT, asked_at, values))
        if self._begins <= time.monotonic() < self.ends:
            self._counted[unit] = self._counted.get(unit, 0) + 1

    def failed(self) -> None:
        self._failed += 1

    def result(self) -> Result:
        delivered = sum(self._counted.values())
        return {
            "requests": self._requests,
            "failed": self._failed,
            "cancelled": 0,
            "reads": self._reads,
            "writes": [],
            "delivered": delivered,
            "ms": 1000 * (self.ends - self._begins) / delivered if delivered else float("inf"),
            "by_unit": self._counted,
        }


async def run(task: Task, client: AsyncClient) -> Result:
    await client.open(task.port, task.setting.baudrate, REPLY_TIMEOUT)
    deliveries = Deliveries(task)

    async def caller(units: Sequence[int]) -> None:
        for unit in itertools.cycle(units):
            if time.monotonic() >= deliveries.ends:
                break
            asked_at = deliveries.asked()
            try:
                deliveries.told(unit, asked_at, list(await client.read(unit, unit, COUNT)))
            except Exception:
                deliveries.failed()
                await asyncio.sleep(0)

    units = range(1, task.setting.units + 1)
    await asyncio.gather(*(caller([unit]) for unit in units) if task.amount else [caller(units)])
    with contextlib.suppress(Exception):
        await client.close()
    return deliveries.result()


def run_blocking(task: Task, client: BlockingClient) -> Result:
    client.open(task.port, task.setting.baudrate, REPLY_TIMEOUT)
    deliveries = Deliveries(task)
    while time.monotonic() < deliveries.ends:
        for unit in range(1, task.setting.units + 1):
            asked_at = deliveries.asked()
            try:
                deliveries.told(unit, asked_at, list(client.read(unit, unit, COUNT)))
            except Exception:
                deliveries.failed()
                time.sleep(0.001)
    client.close()
    return deliveries.result()
