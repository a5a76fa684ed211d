"""One simulated TL-R drive on a line with a virtual clock."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from rs485bus import BusConfig, TlrStepper, open_bus
from rs485bus.sim import Noise, SimTlr, VirtualLine

TRIGGERS = pytest.mark.parametrize("trigger", ["edge", "write"])
"""The two ways in which a drive may take what starts something."""


def now() -> float:
    return asyncio.get_running_loop().time()


@asynccontextmanager
async def stepper_on(
    sim: SimTlr, *, noise: Noise | None = None, seed: int = 0, config: BusConfig | None = None, **options: Any
) -> AsyncIterator[TlrStepper]:
    """An axis on a drive."""
    line = VirtualLine(sim, noise=noise or Noise(), seed=seed)
    async with open_bus(line, config=config or BusConfig()) as bus:
        yield TlrStepper(bus, sim.address, **options)
    assert line.pair.early_frames == 0


def restart_at_once(sim: SimTlr) -> None:
    """The supply breaks down for a moment; the drive answers again when it is asked."""
    sim.power_cycle(now())
    sim._ready_at = 0.0


def lose(
    sim: SimTlr,
    register: int,
    times: int = 1,
    *,
    heard: bool,
    value: int | None = None,
    function: int | None = None,
    after: Callable[[float], None] | None = None,
) -> list[float]:
    """Lose the next writes of a register (and value), or only their replies; then let something happen.

    Returns when that was, as it happens.
    """
    receive, lost = sim.receive, list[float]()

    def lossy(frame: bytes, now: float) -> bytes | None:
        wanted = frame[1] in (6, 16) if function is None else frame[1] == function
        wanted = wanted and int.from_bytes(frame[2:4], "big") == register
        if not wanted or (value is not None and int.from_bytes(frame[4:6], "big") != value) or len(lost) >= times:
            return receive(frame, now)
        lost.append(now)
        if heard:
            receive(frame, now)
        if after is not None:
            after(now)
        return None

    sim.receive = lossy  # type: ignore[method-assign]
    return lost


def writes(sim: SimTlr, *registers: int) -> list[tuple[int, ...]]:
    """What was written to some registers, in order."""
    return [values for _, register, values in sim.writes if register in registers]
