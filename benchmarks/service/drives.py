"""Virtual MKS drives on pseudo-terminals, in a process of their own: they outlive whoever commands them.

They write down each move that they are told to make: what a service says it did is held against that.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from rs485bus.devices.mks import registers as r
from rs485bus.sim import SimMks, VirtualLine

COUNTS = r.COUNTS_PER_TURN


class WitnessMks(SimMks):
    """A drive that tells what it is told."""

    def __init__(self, address: int, name: str, log: IO[str]) -> None:
        super().__init__(address)
        self._name = name
        self._log = log

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        if pdu[0] == 16 and int.from_bytes(pdu[1:3], "big") == r.MOVE_TO_COUNTS.address:
            speed, target = int.from_bytes(pdu[-6:-4], "big"), int.from_bytes(pdu[-4:], "big", signed=True)
            if speed:  # without, it is a stop (9.4.2)
                print(json.dumps({"axis": self._name, "target": target}), file=self._log, flush=True)
        return super().answer(pdu, now, broadcast=broadcast)


def names(buses: int, drives: int) -> Iterator[tuple[str, str, int]]:
    """The axes: name, bus and address."""
    for bus in range(buses):
        for drive in range(drives):
            yield f"a{bus}{drive}", f"b{bus}", drive + 1


def plant_file(name: str, ports: dict[str, str], drives: int, *, rpm: float = 1500.0) -> str:
    """A plant of such drives."""
    lines = [f'name = "{name}"']
    for bus, port in ports.items():
        lines += [f"[buses.{bus}]", f'port = "{port}"', "baudrate = 115200"]
    for axis, bus, address in names(len(ports), drives):
        lines += [f"[axes.{axis}]", f'bus = "{bus}"', 'family = "mks"', f"address = {address}"]
        lines += [f"rpm = {rpm:g}", "acceleration = 20000"]
    return "\n".join(lines) + "\n"


@dataclass
class Drives:
    """A running process of drives."""

    process: asyncio.subprocess.Process
    ports: dict[str, str]
    log: Path
    positions: dict[str, int] = field(default_factory=dict)
    turning: list[str] = field(default_factory=list)

    async def end(self) -> None:
        """End it, and learn where the shafts are, in counts, and which of them turn."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        self.positions, self.turning = json.loads(await self.process.stdout.readline())
        await self.process.wait()

    def moves(self) -> Iterator[tuple[str, int]]:
        """Each move that a drive was told to make: the axis, and where to."""
        for line in self.log.read_text().splitlines():
            told = json.loads(line)
            yield told["axis"], told["target"]


@contextlib.asynccontextmanager
async def running(folder: Path, buses: int, drives: int) -> AsyncIterator[Drives]:
    """Drives for the length of a block."""
    log = folder / "moves.jsonl"
    arguments = (sys.executable, "-m", "benchmarks.service.drives", str(buses), str(drives), str(log))
    process = await asyncio.create_subprocess_exec(
        *arguments, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
    )
    assert process.stdout is not None
    try:
        yield Drives(process, json.loads(await process.stdout.readline()), log)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


async def main(buses: int, drives: int, log: IO[str]) -> None:
    lines: dict[str, list[WitnessMks]] = {f"b{bus}": [] for bus in range(buses)}
    for axis, bus, address in names(buses, drives):
        lines[bus].append(WitnessMks(address, axis, log))
    async with contextlib.AsyncExitStack() as stack:
        ports: dict[str, Any] = {}
        for bus, devices in lines.items():
            port = await stack.enter_async_context(await VirtualLine(*devices, baudrate=115200).serve_pty())
            ports[bus] = port.path
        print(json.dumps(ports), flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
        now = asyncio.get_running_loop().time()
        every = [drive for some in lines.values() for drive in some]
        positions = {drive._name: drive.motion.counts(now) for drive in every}
        print(json.dumps([positions, [drive._name for drive in every if drive.motion.motor.moving(now)]]))


if __name__ == "__main__":
    with open(sys.argv[3], "a") as moves:
        asyncio.run(main(int(sys.argv[1]), int(sys.argv[2]), moves))
