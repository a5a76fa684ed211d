"""`rs485bus serve` as a process that can be killed, and what a process takes of the machine."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import AsyncIterator
from pathlib import Path

_TICKS = os.sysconf("SC_CLK_TCK")


class Served:
    """A service in a process of its own.

    Args:
        plant: the plant file.
        broker: the broker's address.
        ledger: where it remembers requests.
        options: further options of the command.
    """

    def __init__(self, plant: Path, broker: str, ledger: Path, *options: str) -> None:
        self._arguments = (str(plant), "--broker", broker, "--ledger", str(ledger), *options)
        self._log = ledger.with_suffix(".log")
        self._process: asyncio.subprocess.Process | None = None

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    async def start(self) -> None:
        """Start it, and wait until it serves."""
        with self._log.open("ab") as log:
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-m", "rs485bus", "serve", *self._arguments),
                stdout=asyncio.subprocess.PIPE,
                stderr=log,
            )
        assert self._process.stdout is not None
        async with asyncio.timeout(60):
            told = await self._process.stdout.readline()
        assert b"is served at" in told, self._log.read_text()

    async def kill(self) -> None:
        """Like kill -9."""
        assert self._process is not None
        self._process.kill()
        await self._process.wait()

    async def stop(self) -> None:
        if self._process is not None and self._process.returncode is None:
            self._process.terminate()
            await self._process.wait()


@contextlib.asynccontextmanager
async def serving(plant: Path, broker: str, ledger: Path, *options: str) -> AsyncIterator[Served]:
    """A service for the length of a block."""
    served = Served(plant, broker, ledger, *options)
    try:
        await served.start()
        yield served
    finally:
        await served.stop()


def cpu_seconds(pid: int) -> float:
    """The CPU that a process has taken."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def memory(pid: int) -> float:
    """The memory that a process has, in MB."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return 0.0
