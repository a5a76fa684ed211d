"""A bus on which nothing happens but the feeding of watchdogs: how much of a core it takes."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Callable

import serial

from benchmarks.clients.registry import FLOOR
from benchmarks.tasks.task import Result, Task
from rs485bus import MksServo, open_bus
from rs485bus.devices.mks.frames import read
from rs485bus.devices.mks.registers import STATUS
from rs485bus.wire.timing import LineSettings

WATCHDOG = 1.0
"""Seconds for which the watchdogs are set."""
_SETTLED = 3.0
"""Seconds after which the devices are fed as they will be from then on."""


async def run(task: Task) -> Result:
    """`amount` drives, fed on a line that has them, for `seconds`."""
    return await (_bare(task) if task.library == FLOOR else _ours(task))


async def _ours(task: Task) -> Result:
    async with open_bus(task.port, baudrate=task.setting.baudrate) as bus:
        drives = [MksServo(bus, address) for address in range(1, task.amount + 1)]
        async with bus.watchdog(*drives, timeout=WATCHDOG) as watchdog:
            used = await _used(task.seconds, lambda: bus.stats.transactions)
            return {**used, "unfed": max(report.longest for report in watchdog.report()) / WATCHDOG}


async def _bare(task: Task) -> Result:
    """The same frames from a bare asyncio loop: made beforehand, believed whatever they are."""
    loop = asyncio.get_running_loop()
    silence = LineSettings(baudrate=task.setting.baudrate).t35
    frames = [(request.adu, request.length) for request in (read(1 + at, STATUS) for at in range(task.amount))]
    port = serial.Serial(task.port, task.setting.baudrate, timeout=0)
    fd = port.fileno()
    begin, sent, received = loop.time(), 0, 0

    def send() -> None:
        nonlocal sent, received
        received = 0
        os.write(fd, frames[sent % len(frames)][0])
        sent += 1

    def receive() -> None:
        nonlocal begin, received
        received += len(os.read(fd, 256))
        if received < frames[(sent - 1) % len(frames)][1]:
            return
        if sent % len(frames):
            loop.call_later(silence, send)
        else:
            begin += WATCHDOG / 3
            loop.call_at(begin, send)

    loop.add_reader(fd, receive)
    send()
    try:
        return await _used(task.seconds, lambda: sent)
    finally:
        loop.remove_reader(fd)
        port.close()


async def _used(seconds: float, count: Callable[[], int]) -> Result:
    """The part of a core that is used while nobody does anything."""
    await asyncio.sleep(_SETTLED)
    begun, cpu, sent = time.monotonic(), time.process_time(), count()
    await asyncio.sleep(seconds)
    cpu, took = time.process_time() - cpu, time.monotonic() - begun
    return {"core": cpu / took, "feeds_a_second": (count() - sent) / took}
