"""Where something is asked every so many seconds, that is from one question to the next, however long each takes."""

import asyncio
from collections.abc import AsyncIterator

import pytest

from rs485bus import AxisGroup, DifferentialDrive, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.motion.pace import Pace
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualLine
from tests.integration.support import virtual

EVERY = 0.05


def test_a_turn_that_took_too_long_is_followed_at_once_and_not_caught_up_on() -> None:
    pace = Pace(EVERY, 10.0)
    assert pace.left(10.02) == pytest.approx(0.03)
    assert pace.left(10.30) == 0.0
    assert pace.left(10.31) == pytest.approx(0.04)


async def _times(items: AsyncIterator[object], count: int) -> list[float]:
    times = []
    async for _ in items:
        times.append(asyncio.get_running_loop().time())
        if len(times) == count:
            break
    return times


def _is_kept(times: list[float]) -> bool:
    """Whether the pace is kept, once what was asked for before is done."""
    times = times[5:]
    return (times[-1] - times[0]) / (len(times) - 1) == pytest.approx(EVERY, rel=0.02)


@virtual
async def test_positions_of_four_axes_come_twenty_times_a_second() -> None:
    line = VirtualLine(SimMks(1), SimMks(2), SimZlac(3), SimTlr(4), baudrate=115200)
    async with open_bus(line) as bus:
        axes = AxisGroup(a=MksServo(bus, 1), b=MksServo(bus, 2), c=Zlac8015d(bus, 3).left, d=TlrStepper(bus, 4))
        await axes.enable()
        move = axes.move_to(a=4, b=2, c=3, d=1, duration=3.0)
        assert _is_kept(await _times(move.positions(every=EVERY), 40))
        await move


@virtual
async def test_samples_and_poses_come_twenty_times_a_second() -> None:
    async with open_bus(VirtualLine(SimMks(1), SimZlac(3), baudrate=38400)) as bus:
        x, base = MksServo(bus, 1), Zlac8015d(bus, 3)
        vehicle = DifferentialDrive(base, 0.085, 0.4)
        assert _is_kept(await _times(vehicle.poses(every=EVERY), 40))
        before = bus.stats.units[1].requests if 1 in bus.stats.units else 0
        assert _is_kept(await _times(x.samples(every=EVERY), 40))
        assert bus.stats.units[1].requests - before >= 40  # each is new
        await x.enable()
        move = x.move_to(3.0)
        assert _is_kept((await _times(move.positions(every=EVERY), 20))[:-1])
        await move
