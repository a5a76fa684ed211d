"""Through gateways: Modbus TCP beside pymodbus, and many buses in one process.

    python -m benchmarks.gateways          # both
    python -m benchmarks.gateways tcp      # share of the limit over tcp://, beside pymodbus' TCP client
    python -m benchmarks.gateways buses    # one bus, and sixteen in one process, over socket://

The gateways (`gateway_line.py`) are one process. The libraries take turns; what is told is the median, and every run.
The share means something on a quiet machine only, as everywhere; the ratios of CPU hold on a busy one too.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence

from pymodbus.client import AsyncModbusTcpClient

from benchmarks.gateway_line import limit
from benchmarks.processes import cores
from benchmarks.setting import READ_COUNT, Setting
from rs485bus import Bus, open_bus

_FAST = Setting(baudrate=115200)
_SLOW = Setting(baudrate=38400)
"""Sixteen buses at this rate take half of a core."""
_UNITS = 8
_WARM_UP = 0.3

Read = Callable[[int], Awaitable[object]]
Figures = tuple[float, float]
"""Requests a second of each bus, and microseconds of CPU a request."""


async def _ours(url: str, setting: Setting) -> tuple[Bus, Read]:
    bus = await open_bus(url, baudrate=setting.baudrate)
    return bus, lambda unit: bus.unit(unit).read_holding_registers(0, READ_COUNT)


async def _measure(reads: Sequence[Read], seconds: float) -> Figures:
    """All at once, each one request after the other."""
    done = 0

    async def one(read: Read) -> None:
        nonlocal done
        while time.monotonic() < ends:
            for unit in range(1, _UNITS + 1):
                await read(unit)
                done += 1

    ends = time.monotonic() + _WARM_UP
    await asyncio.gather(*map(one, reads))
    done, begun, cpu = 0, time.monotonic(), time.process_time()
    ends = begun + seconds
    await asyncio.gather(*map(one, reads))
    return done / (time.monotonic() - begun) / len(reads), 1e6 * (time.process_time() - cpu) / done


async def _tcp(library: str, port: int, setting: Setting, seconds: float) -> Figures:
    if library == "rs485bus":
        bus, read = await _ours(f"tcp://127.0.0.1:{port}", setting)
        try:
            return await _measure([read], seconds)
        finally:
            await bus.aclose()
    client = AsyncModbusTcpClient("127.0.0.1", port=port)
    await client.connect()
    try:
        return await _measure(
            [lambda unit: client.read_holding_registers(0, count=READ_COUNT, device_id=unit)], seconds
        )
    finally:
        client.close()


async def _buses(ports: Sequence[int], setting: Setting, seconds: float) -> Figures:
    async with contextlib.AsyncExitStack() as stack:
        reads = []
        for port in ports:
            bus, read = await _ours(f"socket://127.0.0.1:{port}", setting)
            stack.push_async_callback(bus.aclose)
            reads.append(read)
        return await _measure(reads, seconds)


@contextlib.contextmanager
def _gateways(count: int, mbap: bool, setting: Setting) -> Iterator[list[int]]:
    _, core = cores()
    options = {"count": count, "mbap": mbap, "baudrate": setting.baudrate, "core": core}
    command = [sys.executable, "-m", "benchmarks.gateway_line", json.dumps(options)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    try:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())
    finally:
        process.terminate()
        process.wait()


def _told(name: str, runs: list[Figures], most: float) -> Figures:
    rate, cpu = (statistics.median(figures) for figures in zip(*runs, strict=True))
    each = " ".join(f"{run[0] / most:.3f}" for run in runs)
    print(f"  {name:24} {rate:7.1f} a second each  {rate / most:.3f} of the limit ({each})  {cpu:5.0f} us CPU")
    return rate, cpu


def tcp(turns: int, seconds: float) -> None:
    """Share of the limit over Modbus TCP."""
    print(f"tcp://, {_FAST.baudrate} baud behind it, limit {limit(_FAST):.1f} reads a second, {turns} turns")
    runs: dict[str, list[Figures]] = {"rs485bus": [], "pymodbus": []}
    for _ in range(turns):
        for library, found in runs.items():
            with _gateways(1, True, _FAST) as ports:
                found.append(asyncio.run(_tcp(library, ports[0], _FAST, seconds)))
    for library, found in runs.items():
        _told(library, found, limit(_FAST))


def buses(turns: int, seconds: float, count: int = 16) -> None:
    """One bus, and many in one process."""
    print(f"socket://, {_SLOW.baudrate} baud behind each, limit {limit(_SLOW):.1f} reads a second, {turns} turns")
    runs: dict[int, list[Figures]] = {1: [], count: []}
    for _ in range(turns):
        for some, found in runs.items():
            with _gateways(some, False, _SLOW) as ports:
                found.append(asyncio.run(_buses(ports, _SLOW, seconds)))
    one = _told("1 bus", runs[1], limit(_SLOW))
    many = _told(f"{count} buses", runs[count], limit(_SLOW))
    print(f"  {count} beside 1: {many[0] / one[0]:.3f} of its rate each, {many[1] / one[1]:.2f} of its CPU a request")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gateways", description=__doc__.partition("\n")[0])
    parser.add_argument("what", nargs="?", choices=("tcp", "buses"))
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=3.0)
    options = parser.parse_args()
    core, _ = cores()
    if core is not None:
        os.sched_setaffinity(0, {core})
    for name, run in (("tcp", tcp), ("buses", buses)):
        if options.what in (None, name):
            run(options.turns, options.seconds)


if __name__ == "__main__":
    main()
