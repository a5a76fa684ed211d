"""A stop asked for while reads are queued: when was it asked? The line tells when it arrived."""

from __future__ import annotations

import asyncio
import random
import time

from benchmarks.clients.interface import AsyncClient
from benchmarks.setting import MARK, READ_COUNT
from benchmarks.tasks.task import Result, Task


async def run(task: Task, client: AsyncClient) -> Result:
    """`amount` reads are queued; a stop is asked for at a random moment. As often as `seconds` says."""
    rng = random.Random(task.seed)
    units = task.setting.units
    await client.open(task.port, task.setting.baudrate, 0.5)
    await client.read(1, 0, READ_COUNT)
    asked = []
    for token in range(max(1, round(task.seconds))):
        reads = [asyncio.create_task(client.read(1 + number % units, 0, READ_COUNT)) for number in range(task.amount)]
        await asyncio.sleep(rng.uniform(0.03, 0.05))
        asked.append((time.monotonic(), token))
        await client.stop(1, MARK, [token, 0])
        for read in reads:
            read.cancel()
        await asyncio.gather(*reads, return_exceptions=True)
        await asyncio.sleep(0.05)
    await client.close()
    return {"asked": asked}
