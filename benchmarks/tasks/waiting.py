"""What a request costs while so many others wait."""

from __future__ import annotations

import asyncio
import itertools
import time

from benchmarks.clients.interface import AsyncClient
from benchmarks.setting import READ_COUNT
from benchmarks.tasks.task import Result, Task

_WARM_UP = 40
"""Requests before it counts."""


async def run(task: Task, client: AsyncClient) -> Result:
    """Keep `amount` requests waiting, for `seconds`."""
    await client.open(task.port, task.setting.baudrate, 0.5)
    await client.read(1, 0, READ_COUNT)
    answered = 0
    warm = asyncio.Event()
    units = itertools.cycle(range(1, task.setting.units + 1))

    async def ask() -> None:
        nonlocal answered
        unit = next(units)
        while True:
            await client.read(unit, 0, READ_COUNT)
            answered += 1
            if answered == _WARM_UP:
                warm.set()

    asking = [asyncio.create_task(ask()) for _ in range(task.amount)]
    await warm.wait()
    begun, cpu = answered, time.process_time()
    await asyncio.sleep(task.seconds)
    requests, cpu = answered - begun, time.process_time() - cpu
    for each in asking:
        each.cancel()
    await asyncio.gather(*asking, return_exceptions=True)
    await client.close()
    return {"requests": requests, "cpu_us": 1e6 * cpu / max(1, requests)}
