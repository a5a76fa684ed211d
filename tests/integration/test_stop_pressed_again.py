"""Stop is pressed again and again: each press is told how it ended, in its own time."""

import asyncio
from contextlib import suppress

import pytest

from rs485bus import MksServo, open_bus
from rs485bus.errors import StopUnconfirmed
from rs485bus.sim import SimMks, VirtualLine
from tests.integration.support import virtual


async def pressed(axis: MksServo, every: float, times: int) -> list[float]:
    """For how long each press has waited."""
    loop = asyncio.get_running_loop()

    async def press() -> float:
        asked_at = loop.time()
        with suppress(StopUnconfirmed):
            await axis.stop()
        return loop.time() - asked_at

    presses = []
    for _ in range(times):
        presses.append(asyncio.ensure_future(press()))
        await asyncio.sleep(every)
    return await asyncio.gather(*presses)


@pytest.mark.parametrize("every", [0.05, 0.2, 0.5, 1.0])
@virtual
async def test_on_a_drive_that_is_dead_nobody_waits_for_whoever_presses_next(every: float) -> None:
    sim = SimMks(1)
    with suppress(ExceptionGroup):  # that it was not seen standing is told once more
        async with open_bus(VirtualLine(sim, baudrate=115200)) as bus:
            axis = MksServo(bus, 1)
            await axis.enable()
            await axis.run(100)
            sim.receive = lambda frame, now: None  # type: ignore[method-assign]
            assert max(await pressed(axis, every, int(10 / every))) < 2


@virtual
async def test_on_a_drive_that_slows_down_nobody_is_told_that_it_does_not_stop() -> None:
    sim = SimMks(1)
    loop = asyncio.get_running_loop()
    async with open_bus(VirtualLine(sim, baudrate=115200)) as bus:
        axis = MksServo(bus, 1, acceleration=100)
        await axis.enable()
        await axis.run(300)
        first = axis.stop()
        stops = [axis.stop() for _ in range(20) if await asyncio.sleep(0.1) is None]
        for stop in (first, *stops):
            await stop
        assert not sim.moving(loop.time())
