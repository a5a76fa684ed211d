"""A line that mangles what it carries, on a pseudo-terminal in a process of its own, with witnesses on it.

    python -m benchmarks.noisy '{"units": 8, "seed": 1}'

Requests and replies are lost, late, torn, flipped, doubled, short, glued to foreign frames and stray bytes. Every read
is answered with a number that is used once, every write carries one, and the witnesses remember what each was. Prints
the port's path; on SIGTERM it prints all of that.

With `{"servos": 16}` the line is quiet, and virtual MKS drives hang on it.
"""

from __future__ import annotations

import asyncio
import json
import random
import signal
import sys
from typing import Any

from benchmarks.orphans import end_with_parent
from rs485bus.sim import Noise, SimDevice, SimMks, VirtualLine
from rs485bus.sim.campaign import HOSTILE

SHORT = 0.02
"""The probability that a unit answers fewer registers than it was asked for."""


class Witnesses:
    """What all units were asked, in one log."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.reads: list[tuple[float, int, str]] = []
        """When, which unit, and what it was asked; the place in the list is the number it answered."""
        self.writes: list[tuple[float, int, str]] = []


class Witness(SimDevice):
    """A unit that answers reads with a number that is used once."""

    def __init__(self, address: int, log: Witnesses) -> None:
        super().__init__(address)
        self._log = log

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        log = self._log
        if pdu[0] not in (3, 4):
            log.writes.append((now, self.address, pdu.hex()))
            return pdu if pdu[0] == 6 else pdu[:5]
        serial = len(log.reads)
        log.reads.append((now, self.address, pdu.hex()))
        count = int.from_bytes(pdu[3:5], "big")
        if log.rng.random() < SHORT:
            count = max(2, count - 1)
        return bytes((pdu[0], 2 * count)) + serial.to_bytes(4, "big") + bytes(2 * count - 4)


async def serve(options: dict[str, Any]) -> None:
    log = Witnesses(options.get("seed", 1))
    baudrate = options.get("baudrate", 115200)
    devices: list[SimDevice] = [SimMks(address) for address in range(1, options.get("servos", 0) + 1)]
    noise = Noise()
    if not devices:
        devices = [Witness(address, log) for address in range(1, options.get("units", 8) + 1)]
        noise = HOSTILE
    line = VirtualLine(*devices, baudrate=baudrate, noise=noise, seed=options.get("seed", 1))
    stopped = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stopped.set)
    async with await line.serve_pty() as port:
        print(json.dumps({"port": port.path}), flush=True)
        await stopped.wait()
    counted = {"reads": log.reads, "writes": log.writes, "frames": line.pair.frames, "early": line.pair.early_frames}
    print(json.dumps(counted), flush=True)


if __name__ == "__main__":
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    asyncio.run(serve(json.loads(sys.argv[1])))
