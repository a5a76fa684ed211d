"""Of an axis that has failed and coasts for long, it is said first what is wrong with it, and then that it turns."""

import asyncio

import pytest

from rs485bus import AxisGroup, TlrStepper, Zlac8015d, open_bus
from rs485bus.devices.zlac.values import Fault
from rs485bus.errors import DriveFault, RearmRequired
from rs485bus.sim import SimTlr, TlrMachine, VirtualLine, zlac_motion
from tests.devices.zlac.plant import WatchedZlac
from tests.integration.support import virtual


@pytest.mark.parametrize("how", ["move", "run", "group"])
@virtual
async def test_a_wheel_that_coasts_after_a_fault_tells_the_fault_first(
    how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(zlac_motion, "_FRICTION", 1.0)  # rpm/s: it takes a minute and a half
    sim = WatchedZlac(1, watchdog=0)
    machine = TlrMachine(origin=None)
    with pytest.raises(ExceptionGroup, match="nobody awaited"):  # it turns yet
        async with open_bus(VirtualLine(sim, SimTlr(2, machine=machine))) as bus:
            base, y = Zlac8015d(bus, 1), TlrStepper(bus, 2)
            await base.enable()
            await y.enable()
            x = base.left
            if how == "group":
                move = AxisGroup(x=x, y=y).move_to(x=100.0, y=100.0, rpm=100)
            else:
                move = x.move_to(100.0, rpm=100) if how == "move" else x.run(100, acceleration=30)
            await asyncio.sleep(2.0)
            begun = bus.now()
            sim.left.fail(Fault.OVER_LOAD, bus.now())
            with pytest.raises(DriveFault, match=r"(?i)over.?load.*could not be seen standing") as raised:
                await move
            assert bus.now() - begun < 6.0
            assert isinstance(raised.value.__cause__, DriveFault)
            with pytest.raises(RearmRequired, match="could not be seen standing"):
                await x.run(10)
            assert sim.left.motor.moving(bus.now())
