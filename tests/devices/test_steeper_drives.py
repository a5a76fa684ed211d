"""The ramp of a stream is kept by drives whose own is steeper than was thought."""

import asyncio

import pytest

from rs485bus import TlrStepper, Zlac8015d
from rs485bus.motion.streaming import STEP
from rs485bus.sim import SimTlr, TlrMachine
from tests.devices.stream_rig import Make, _LeftWheel, rig, steepest
from tests.integration.support import virtual

MAKES: dict[str, Make] = {
    # 3000 rpm in two seconds, the longest that it can be told, are 1500 rpm/s.
    "TL-R": lambda: (
        SimTlr(1, machine=TlrMachine(origin=None), ramp_rpm=3000.0),
        lambda bus: TlrStepper(bus, 1, ramp_rpm=3000.0),
    ),
    "ZLAC": lambda: (_LeftWheel(1, ramp_rpm=1000.0), lambda bus: Zlac8015d(bus, 1).left),
}


@pytest.mark.parametrize("make", MAKES.values(), ids=MAKES)
@pytest.mark.parametrize("acceleration", [300.0, 1000.0])
@virtual
async def test_a_steeper_drive_goes_no_more_than_a_step_and_a_tenth_beyond_the_ramp_of_a_stream(
    make: Make, acceleration: float
) -> None:
    """From rest, at each new set-point after a while, through zero, and back to rest."""
    async with rig(make) as on:
        async with on.axis.stream(acceleration=acceleration, timeout=2.0) as setpoint:
            for rpm in (200, 150, -100, 120, 0):
                setpoint(rpm)
                await asyncio.sleep(1.0)
        for samples in (5, 10, 20):
            over = samples / 100
            most = acceleration * (1.1 + STEP / over) + 2 / over  # whole rpm
            assert steepest(on.speeds, over=samples) <= most, over
