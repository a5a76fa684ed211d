"""Reads on a lossy virtual line, in virtual time: what a delivered answer takes, and whether each is the right one."""

from __future__ import annotations

import itertools
import random
from collections.abc import Callable
from dataclasses import dataclass

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.sim import Noise, SimDevice
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding, registers


class Counting(SimDevice):
    """Answers each read with a number that is used once, and remembers what it stood for.

    `turnarounds` tells how long it takes each time, in seconds.
    """

    def __init__(self, address: int, turnarounds: Callable[[], float]) -> None:
        super().__init__(address)
        self.reads: list[tuple[float, bytes]] = []
        self._turnarounds = turnarounds

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        self.turnaround = self._turnarounds()
        self.reads.append((now, pdu))
        count = int.from_bytes(pdu[3:5], "big")
        serial = (self.address << 24 | len(self.reads)).to_bytes(4, "big")
        return bytes((pdu[0], 2 * count)) + (serial + bytes(2 * count))[: 2 * count]


@dataclass
class Delivered:
    """What came of it."""

    ms: float
    """Milliseconds a delivered answer took."""
    wrong: int
    failed: int
    answers: int
    rig: Rig


def delivered(
    noise: Noise,
    *,
    units: int = 3,
    together: bool = False,
    answers: int = 2000,
    seed: int = 1,
    turnarounds: Callable[[random.Random], float] = lambda _: 0.002,
    config: BusConfig | None = None,
) -> Delivered:
    """Read two registers of each unit over and over; what fails is asked again, and its time counts."""
    chance = random.Random(seed)
    devices = [Counting(address, lambda: turnarounds(chance)) for address in range(1, units + 1)]
    config = config or BusConfig(echo=False, reply_timeout=0.1)
    rig = Rig(*devices, noise=noise, seed=seed, config=config, keep_frames=False)
    counted = {"told": 0, "wrong": 0, "failed": 0}

    def ask(turns: itertools.cycle[int], unit: int) -> None:
        asked_at = rig.now

        def ended(job: Job) -> None:
            following = next(turns)
            if job.outcome is Outcome.REPLY:
                counted["told"] += 1
                high, low = registers(job.reply)
                reads = devices[(high >> 8) - 1].reads
                number = ((high & 0xFF) << 16 | low) - 1
                seen_at, pdu = reads[number] if number < len(reads) else (0.0, b"")
                right = high >> 8 == unit and seen_at >= asked_at and pdu == job.request.adu[1:-2]
                counted["wrong"] += not right
            else:
                counted["failed"] += 1
                following = unit
            if counted["told"] < answers:
                rig.at(rig.now, lambda: ask(turns, following))

        rig.owner.submit(Job(read_holding(unit, unit, 2), on_end=ended), rig.now)

    began = rig.now
    addresses = range(1, units + 1)
    for group in [[unit] for unit in addresses] if together else [list(addresses)]:
        turns = itertools.cycle(group)
        ask(turns, next(turns))
    rig.run(3600.0, lambda: counted["told"] >= answers)
    took = 1000 * (rig.now - began) / max(1, counted["told"])
    return Delivered(took, counted["wrong"], counted["failed"], counted["told"], rig)
