"""Drives that become slow, die, or lose what is to be lost; and blocks that must end."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any, TypeVar

from rs485bus import Bus, BusConfig, MksServo, Zlac8015d, open_bus
from rs485bus.devices.mks import registers as r
from rs485bus.sim import SimMks, SimZlac, VirtualLine

T = TypeVar("T")

SET_HEARTBEAT = bytes((16, 0, r.WATCHDOG.address))
"""How the frame begins, behind the address, that sets a heartbeat time."""


class _Faulty:
    """A drive that answers as slowly as a test wants, or not at all."""

    slow: float | None = None
    """Seconds before it answers; None for what the line is set to."""
    dead = False
    deaf_to: Callable[[bytes], bool] = staticmethod(lambda frame: False)
    """It does not hear such frames."""
    unheard_since = 0.0
    longest_unheard = 0.0

    def receive(self, frame: bytes, now: float) -> bytes | None:
        if self.dead or self.deaf_to(frame):
            return None
        if frame[0] == self.address:  # type: ignore[attr-defined]
            self.longest_unheard = max(self.longest_unheard, now - (self.unheard_since or now))
            self.unheard_since = now
        reply: bytes | None = super().receive(frame, now)  # type: ignore[misc]
        if self.slow is not None:
            self.turnaround = self.slow
        return reply


class FaultyMks(_Faulty, SimMks):
    """An MKS drive like that."""


class FaultyZlac(_Faulty, SimZlac):
    """A ZLAC like that."""


@asynccontextmanager
async def mks_bus(
    count: int = 1, config: BusConfig | None = None, *, slow: float | None = None, **line: Any
) -> AsyncIterator[tuple[Bus, list[FaultyMks], list[MksServo]]]:
    """So many MKS drives on a line."""
    sims = [FaultyMks(address) for address in range(1, count + 1)]
    for sim in sims:
        sim.slow = slow
    async with open_bus(VirtualLine(*sims, **line), config=config or BusConfig()) as bus:
        yield bus, sims, [MksServo(bus, sim.address) for sim in sims]


@asynccontextmanager
async def zlac_bus(**options: Any) -> AsyncIterator[tuple[Bus, FaultyZlac, Zlac8015d]]:
    """A ZLAC on a line."""
    sim = FaultyZlac(1, **options)
    async with open_bus(VirtualLine(sim)) as bus:
        base = Zlac8015d(bus, 1)
        await base.set_up()
        yield bus, sim, base


def line_of(bus: Bus) -> VirtualLine:
    line = bus._transport
    assert isinstance(line, VirtualLine)
    return line


async def within(seconds: float, awaitable: Awaitable[T]) -> T:
    """It ends in that time."""
    async with asyncio.timeout(seconds):
        return await awaitable
