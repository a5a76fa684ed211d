"""Through gateways: Modbus TCP beside pymodbus, and many buses in one process.

    python -m benchmarks.gateways          # both
    python -m benchmarks.gateways tcp      # share of the limit over tcp://, beside pymodbus' TCP client
    python -m benchmarks.gateways buses    # one bus, and sixteen in one process, over socket://

Over tcp:// one caller asks unit after unit, then each of eight units has a caller of its own, as where eight devices
are polled; last, two requests may be out at a time (`pipeline=2`). Beside the buses stand bare connections, which send
the next request as soon as anything comes: what the cores, the system and the gateways allow.

The gateways (`gateway_line.py`) are one process. The libraries take turns; what is told is the median, and every run.
The share means something on a quiet machine only, as everywhere; the ratios of CPU hold on a busy one too.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import os
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence

from pymodbus.client import AsyncModbusTcpClient

from benchmarks.gateway_line import limit
from benchmarks.processes import cores
from benchmarks.setting import READ_COUNT, Setting
from rs485bus import Bus, BusConfig, open_bus
from rs485bus.wire.frames import read_holding

_FAST = Setting(baudrate=115200)
_SLOW = Setting(baudrate=38400)
"""Sixteen buses at this rate take half of a core."""
_UNITS = range(1, 9)
_WARM_UP = 0.3
_OURS, _THEIRS = cores()
"""The core of the libraries and that of the gateways: asked for before this process keeps to one."""

Read = Callable[[int], Awaitable[object]]
Figures = tuple[float, float]
"""Requests a second of each bus, and microseconds of CPU a request."""


async def _ours(url: str, setting: Setting, pipeline: int = 1) -> tuple[Bus, Read]:
    bus = await open_bus(url, baudrate=setting.baudrate, config=BusConfig(pipeline=pipeline))
    units = {unit: bus.unit(unit) for unit in _UNITS}
    return bus, lambda unit: units[unit].read_holding_registers(0, READ_COUNT)


async def _measure(reads: Sequence[Read], callers: int, seconds: float) -> Figures:
    """All at once, each one request after the other, by one caller of all units or by several that share them."""
    done = 0

    async def one(read: Read, units: Sequence[int]) -> None:
        nonlocal done
        while time.monotonic() < ends:
            for unit in units:
                await read(unit)
                done += 1

    shares = [_UNITS[caller::callers] for caller in range(callers)]
    ends = time.monotonic() + _WARM_UP
    await asyncio.gather(*(one(read, units) for read in reads for units in shares))
    done, begun, cpu = 0, time.monotonic(), time.process_time()
    ends = begun + seconds
    await asyncio.gather(*(one(read, units) for read in reads for units in shares))
    return done / (time.monotonic() - begun) / len(reads), 1e6 * (time.process_time() - cpu) / done


async def _tcp(library: str, callers: int, port: int, seconds: float) -> Figures:
    if library.startswith("rs485bus"):
        bus, read = await _ours(f"tcp://127.0.0.1:{port}", _FAST, 2 if "pipeline" in library else 1)
        try:
            return await _measure([read], callers, seconds)
        finally:
            await bus.aclose()
    client = AsyncModbusTcpClient("127.0.0.1", port=port)
    await client.connect()
    try:
        reads = [lambda unit: client.read_holding_registers(0, count=READ_COUNT, device_id=unit)]
        return await _measure(reads, callers, seconds)
    finally:
        client.close()


async def _buses(ports: Sequence[int], setting: Setting, seconds: float) -> Figures:
    async with contextlib.AsyncExitStack() as stack:
        reads = []
        for port in ports:
            bus, read = await _ours(f"socket://127.0.0.1:{port}", setting)
            stack.push_async_callback(bus.aclose)
            reads.append(read)
        return await _measure(reads, 1, seconds)


class _Bare(asyncio.Protocol):
    """Asks unit after unit, and looks at nothing that comes."""

    def __init__(self) -> None:
        self.done = 0
        self._frames = [read_holding(unit, 0, READ_COUNT).adu for unit in _UNITS]

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.transport = transport
        transport.write(self._frames[0])

    def data_received(self, data: bytes) -> None:
        self.done += 1
        self.transport.write(self._frames[self.done % len(self._frames)])


async def _bare(ports: Sequence[int], seconds: float) -> Figures:
    loop = asyncio.get_running_loop()
    bare = [(await loop.create_connection(_Bare, "127.0.0.1", port))[1] for port in ports]
    await asyncio.sleep(_WARM_UP)
    before, begun, cpu = sum(each.done for each in bare), time.monotonic(), time.process_time()
    await asyncio.sleep(seconds)
    done = sum(each.done for each in bare) - before
    figures = done / (time.monotonic() - begun) / len(bare), 1e6 * (time.process_time() - cpu) / done
    for each in bare:
        each.transport.abort()
    return figures


@contextlib.contextmanager
def _gateways(count: int, mbap: bool, setting: Setting) -> Iterator[list[int]]:
    options = {"count": count, "mbap": mbap, "baudrate": setting.baudrate, "core": _THEIRS}
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
    print(f"  {name:32} {rate:7.1f} a second each  {rate / most:.3f} of the limit ({each})  {cpu:5.0f} us CPU")
    return rate, cpu


def tcp(turns: int, seconds: float) -> None:
    """Share of the limit over Modbus TCP."""
    print(f"tcp://, {_FAST.baudrate} baud behind it, limit {limit(_FAST):.1f} reads a second, {turns} turns")
    kinds = [("rs485bus", 1), ("pymodbus", 1), ("rs485bus", 8), ("pymodbus", 8), ("rs485bus, pipeline=2", 8)]
    runs: dict[tuple[str, int], list[Figures]] = {kind: [] for kind in kinds}
    for _ in range(turns):
        for (library, callers), found in runs.items():
            with _gateways(1, True, _FAST) as ports:
                found.append(asyncio.run(_tcp(library, callers, ports[0], seconds)))
    for (library, callers), found in runs.items():
        _told(f"{library}, {callers} caller{'s' * (callers > 1)}", found, limit(_FAST))


def buses(turns: int, seconds: float, count: int = 16) -> None:
    """One bus, and many in one process."""
    print(f"socket://, {_SLOW.baudrate} baud behind each, limit {limit(_SLOW):.1f} reads a second, {turns} turns")
    runs: dict[tuple[str, int], list[Figures]] = {(kind, some): [] for kind in ("bus", "bare") for some in (1, count)}
    for _ in range(turns):
        for (kind, some), found in runs.items():
            with _gateways(some, False, _SLOW) as ports:
                found.append(asyncio.run(_bare(ports, seconds) if kind == "bare" else _buses(ports, _SLOW, seconds)))
    for kind, one, many in (("bus", "bus", "buses"), ("bare", "bare connection", "bare connections")):
        alone, cpu_alone = _told(f"1 {one}", runs[kind, 1], limit(_SLOW))
        rate, cpu = _told(f"{count} {many}", runs[kind, count], limit(_SLOW))
        print(f"  {count} beside 1: {rate / alone:.3f} of its rate each, {cpu / cpu_alone:.2f} of its CPU a request,")
        print(f"  which is {100 * count * rate * cpu / 1e6:.0f} % of a core")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gateways", description=__doc__.partition("\n")[0])
    parser.add_argument("what", nargs="?", choices=("tcp", "buses"))
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=3.0)
    options = parser.parse_args()
    if _OURS is not None:
        os.sched_setaffinity(0, {_OURS})
    for name, run in (("tcp", tcp), ("buses", buses)):
        if options.what in (None, name):
            run(options.turns, options.seconds)


if __name__ == "__main__":
    main()
