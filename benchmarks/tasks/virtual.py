"""What is measured in virtual time: watched devices on a saturated bus, and memory over an hour."""

from __future__ import annotations

import asyncio
import gc
import sys
from pathlib import Path

from benchmarks.setting import READ_COUNT
from benchmarks.tasks.task import Result, Task
from benchmarks.virtual_clock import on_virtual_clock
from rs485bus import MksServo, Urgency, open_bus
from rs485bus.bus.record import Record
from rs485bus.bus.schedule.job import Job
from rs485bus.sim import SimMks, SimUnit, VirtualLine
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding

_OTHERS = range(40, 48)
"""Addresses of plain units that saturate the bus."""
_CALLERS = 32


def watched(task: Task) -> Result:
    """`amount` watched drives while others are asked without pause: the longest time one was unfed.

    It is counted from the sending of one frame that the drive acknowledged to that of the next, as a share of the
    watchdog's time. `allowed` is a third of that and the longest transaction.
    """
    timeout = 1.0
    longest, took = on_virtual_clock(_watch(task, timeout))
    return {"unfed": longest / timeout, "allowed": 1 / 3 + took / timeout, "transaction": took}


async def _watch(task: Task, timeout: float) -> tuple[float, float]:
    setting = task.setting
    units = [SimUnit(address, dict.fromkeys(range(READ_COUNT), 1)) for address in _OTHERS]
    drives = [SimMks(address) for address in range(1, task.amount + 1)]
    line = VirtualLine(*drives, *units, baudrate=setting.baudrate, turnaround=setting.turnaround)
    async with open_bus(line) as bus:
        axes = [MksServo(bus, drive.address) for drive in drives]
        watched = {drive.address for drive in drives}
        longest = slowest = 0.0
        sent: dict[int, float] = {}

        def observe(record: Record) -> None:
            nonlocal longest, slowest
            slowest = max(slowest, record.latency + line.line.t35)
            if record.address in watched and record.outcome == "reply":
                longest = max(longest, record.sent_at - sent.get(record.address, record.sent_at))
                sent[record.address] = record.sent_at

        async def ask(number: int) -> None:
            unit = bus.unit(_OTHERS[number % len(_OTHERS)])
            urgency = (Urgency.COMMAND, Urgency.POLL)[number % 2]
            while True:
                await unit.read_holding_registers(0, READ_COUNT, urgency=urgency)

        async with bus.watchdog(*axes, timeout=timeout):
            forget = bus.subscribe(observe)
            asking = [asyncio.create_task(ask(number)) for number in range(_CALLERS)]
            await asyncio.sleep(task.seconds)
            forget()
            for each in asking:
                each.cancel()
            await asyncio.gather(*asking, return_exceptions=True)
    return longest, slowest


def memory(task: Task) -> Result:
    """A saturated bus, for `seconds` of virtual time: what it holds after a minute, and at the end."""
    units = task.setting.units
    rig = Rig(
        *(SimUnit(address, dict.fromkeys(range(READ_COUNT), 1)) for address in range(1, units + 1)), keep_frames=False
    )
    requests = [read_holding(address, 0, READ_COUNT) for address in range(1, units + 1)]

    def ask(number: int) -> None:
        rig.owner.submit(Job(requests[number % units], on_end=lambda _: rig.at(rig.now, lambda: ask(number))), rig.now)

    for number in range(2 * units):
        ask(number)
    rig.run(60.0)
    early = _held()
    rig.run(task.seconds - 60.0)
    late = _held()
    transactions = rig.owner.journal.stats.transactions
    return {"minute": early, "end": late, "seconds": task.seconds, "transactions": transactions}


def _held() -> dict[str, int]:
    """Blocks that Python has allocated, and memory of the process in kilobytes (Linux)."""
    gc.collect()
    resident = int(Path("/proc/self/statm").read_text().split()[1]) * 4 if sys.platform == "linux" else 0
    return {"blocks": sys.getallocatedblocks(), "kilobytes": resident}
