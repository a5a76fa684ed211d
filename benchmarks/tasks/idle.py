"""A bus on which nothing happens but the feeding of watchdogs: how much of a core it takes."""

from __future__ import annotations

import asyncio
import time

from benchmarks.tasks.task import Result, Task
from rs485bus import MksServo, open_bus


async def run(task: Task) -> Result:
    """`amount` drives, fed on a line that has them, for `seconds` after they were armed."""
    async with open_bus(task.port, baudrate=task.setting.baudrate) as bus:
        drives = [MksServo(bus, address) for address in range(1, task.amount + 1)]
        async with bus.watchdog(*drives, timeout=WATCHDOG) as watchdog:
            await asyncio.sleep(0.3)
            begun, cpu, sent = time.monotonic(), time.process_time(), bus.stats.transactions
            await asyncio.sleep(task.seconds)
            cpu, seconds = time.process_time() - cpu, time.monotonic() - begun
            sent = bus.stats.transactions - sent
            longest = max(report.longest for report in watchdog.report())
    return {"core": cpu / seconds, "feeds_a_second": sent / seconds, "unfed": longest / WATCHDOG}


WATCHDOG = 1.0
"""Seconds for which the watchdogs are set."""
