"""A plant of simulated drives, and an event loop whose clock is virtual."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from rs485bus import Bus, BusConfig, MksServo, open_bus
from rs485bus.sim import Machine, Noise, SimMks, VirtualClockLoop, VirtualLine

T = TypeVar("T")


def virtual(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """Run a test on a loop whose clock is virtual."""

    @functools.wraps(test)
    def run(*args: Any, **kwargs: Any) -> None:
        with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
            runner.run(test(*args, **kwargs))

    return run


@dataclass
class Plant:
    """Drives on a line."""

    line: VirtualLine
    sims: list[SimMks]

    def stands(self) -> bool:
        """Whether every shaft stands, now."""
        now = asyncio.get_running_loop().time()
        return not any(sim.moving(now) for sim in self.sims)

    def watchdogs_off(self) -> bool:
        return not any(sim.watchdog_ms for sim in self.sims)

    def shafts(self) -> list[float]:
        now = asyncio.get_running_loop().time()
        return [sim.shaft(now) for sim in self.sims]


def plant(count: int = 1, noise: Noise | None = None, seed: int = 0, **options: Any) -> Plant:
    """So many drives, each at its own place with its own switch."""
    sims = [
        SimMks(address, shaft=0.5 * address, machine=Machine(home_switch=-1.0), **options)
        for address in range(1, count + 1)
    ]
    return Plant(VirtualLine(*sims, noise=noise or Noise(), seed=seed), sims)


@asynccontextmanager
async def bus_on(made: Plant, config: BusConfig | None = None) -> AsyncIterator[tuple[Bus, list[MksServo]]]:
    """A bus on a plant, with an axis for each drive."""
    async with open_bus(made.line, config=config or BusConfig()) as bus:
        yield bus, [MksServo(bus, sim.address) for sim in made.sims]
