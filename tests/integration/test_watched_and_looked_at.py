"""Looks at moving axes are not counted in the admission of watchdogs: they wait for feeds, and feed themselves."""

from __future__ import annotations

import asyncio
import random

import pytest

from rs485bus import Bus, BusConfig, MksServo, open_bus
from rs485bus.errors import BusError, WatchdogInfeasible
from rs485bus.sim import SimMks, SimUnit, VirtualLine
from tests.integration.support import virtual

SECONDS = 5.0


class Lossy(SimMks):
    """Its replies are lost, two in a row of all drives, once in each time of the watchdogs."""

    timeout = float("inf")
    lost_until = float("inf")
    left = 0
    longest = 0.0
    heard_at: float | None = None
    rng = random.Random(1)

    def receive(self, frame: bytes, now: float) -> bytes | None:
        reply = super().receive(frame, now)
        if frame[0] != self.address:
            return reply
        if self.heard_at is not None:
            self.longest = max(self.longest, now - self.heard_at)
        self.heard_at = now
        if Lossy.left:
            Lossy.left -= 1
            return None
        if now > Lossy.lost_until and self.rng.random() < 0.2:
            Lossy.left, Lossy.lost_until = 1, now + Lossy.timeout
            return None
        return reply


async def tightest(bus: Bus, axes: list[MksServo]) -> float:
    """The shortest time, within a few milliseconds, that is admitted."""
    low, high = 0.05, 3.0
    while high - low > 0.004:
        middle = (low + high) / 2
        try:
            async with bus.watchdog(*axes, timeout=middle):
                high = middle
        except WatchdogInfeasible:
            low = middle
    return high


@pytest.mark.parametrize(("drives", "baudrate", "turnaround"), [(2, 9600, 0.005), (8, 38400, 0.02)])
@virtual
async def test_looks_at_moving_axes_trip_no_watchdog_at_the_tightest_that_is_admitted(
    drives: int, baudrate: int, turnaround: float
) -> None:
    sims = [Lossy(address) for address in range(1, drives + 1)]
    for sim in sims:
        sim.turnaround = turnaround
    sensor = SimUnit(100, dict.fromkeys(range(8), 0))
    config = BusConfig(echo=False, supervision=0.05)
    async with open_bus(VirtualLine(*sims, sensor, baudrate=baudrate), config=config) as bus:
        axes = [MksServo(bus, sim.address) for sim in sims]
        for axis in axes:
            await axis.enable()
        timeout = await tightest(bus, axes)

        async def poll() -> None:
            while True:
                try:
                    await bus.unit(100).read_holding_registers(0, 8)
                except BusError:
                    await asyncio.sleep(0.01)

        async with bus.watchdog(*axes, timeout=timeout):
            for axis in axes:
                axis.run(60)
            await asyncio.sleep(0.5)
            for sim in sims:
                sim.heard_at, sim.longest = None, 0.0
            Lossy.timeout, Lossy.lost_until = timeout, asyncio.get_running_loop().time()
            polls = [asyncio.ensure_future(poll()) for _ in range(2)]
            await asyncio.sleep(SECONDS)
            Lossy.lost_until = float("inf")
            for task in polls:
                task.cancel()
            assert [sim.trips for sim in sims] == [[]] * drives
            assert max(sim.longest for sim in sims) < timeout
            await asyncio.gather(*(axis.stop() for axis in axes))
