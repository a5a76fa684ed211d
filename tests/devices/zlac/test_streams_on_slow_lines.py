"""A stream whose set-points take the line longer than a step of its ramp: it slows down as it should all the same."""

import asyncio

import pytest

from rs485bus import Zlac8015d, open_bus
from rs485bus.sim import SimZlac, VirtualLine
from tests.integration.support import virtual

LIMIT = 3.0


@pytest.mark.parametrize("ramp_rpm", [None, 1000.0])
@pytest.mark.parametrize(("baudrate", "turnaround"), [(9600, 0.02), (9600, 0.05), (4800, 0.02)])
@virtual
async def test_it_stays_inside_of_its_limits(baudrate: int, turnaround: float, ramp_rpm: float | None) -> None:
    sim = SimZlac(1, ramp_rpm=ramp_rpm)
    sim.turnaround = turnaround
    loop = asyncio.get_running_loop()
    async with open_bus(VirtualLine(sim, baudrate=baudrate)) as bus:
        base = Zlac8015d(bus, 1, ramp_rpm=ramp_rpm, limits=(-LIMIT, LIMIT))
        await base.enable()
        async with base.left.stream(acceleration=120) as setpoint:
            for rpm, seconds in ((-200, 5), (300, 6)):
                until = loop.time() + seconds
                while loop.time() < until:
                    setpoint(rpm)
                    await asyncio.sleep(0.05)
                    assert abs(sim.left.motor.position(loop.time())) < LIMIT


@virtual
async def test_it_stands_after_its_ramp_when_the_stick_is_released() -> None:
    sim = SimZlac(1)
    sim.turnaround = 0.02
    loop = asyncio.get_running_loop()
    async with open_bus(VirtualLine(sim, baudrate=9600)) as bus:
        base = Zlac8015d(bus, 1)
        await base.enable()
        async with base.left.stream(acceleration=120) as setpoint:
            setpoint(100)
            for _ in range(20):
                await asyncio.sleep(0.1)
                setpoint(100)
            released = loop.time()
            while sim.left.motor.rpm(loop.time()):
                setpoint(0)
                await asyncio.sleep(0.02)
            assert loop.time() - released < 100 / 120 + 0.3
