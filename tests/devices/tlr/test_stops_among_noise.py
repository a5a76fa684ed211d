"""A stop of two frames on a pair that is never quiet."""

import asyncio
import itertools

from rs485bus import TlrStepper, open_bus
from rs485bus.devices.tlr.frames import control
from rs485bus.devices.tlr.values import ControlWord
from rs485bus.sim import SimTlr, VirtualLine
from tests.integration.support import virtual

STOP = control(1, ControlWord.STOP).adu
BOTH = control(1, ControlWord.STOP | ControlWord.EMERGENCY_STOP).adu


@virtual
async def test_one_frame_of_a_stop_that_is_acknowledged_is_worth_a_look_though_the_other_was_not_heard() -> None:
    sim = SimTlr(1)
    hears = sim.receive
    line = VirtualLine(sim)
    line.pair.lenient = True  # it hunts for frames
    async with open_bus(line) as bus:
        y = TlrStepper(bus, 1)
        await y.enable()
        await y.run(60)
        line.babble(itertools.repeat(0.001))
        await asyncio.sleep(0.2)
        sim.receive = lambda frame, now: None if frame in (BOTH, STOP) else hears(frame, now)  # type: ignore[method-assign]
        begun = bus.now()
        await y.stop()
        assert bus.now() - begun < 1.5
        assert not sim.moving(bus.now())
