"""How looks at what moves share the wire with what others ask."""

import asyncio
import itertools

from benchmarks.virtual_clock import on_virtual_clock
from rs485bus import Bus, BusConfig, TlrStepper, open_bus
from rs485bus.devices.tlr.homing import Homing
from rs485bus.devices.tlr.values import HomingMode
from rs485bus.sim import SimMks, SimTlr, TlrMachine, VirtualLine

MANY = 120


def test_a_look_that_presses_does_not_wait_behind_the_commands_of_many_others() -> None:
    async def ask(bus: Bus, address: int) -> None:
        while True:
            await bus.unit(address).read_input_registers(0x31, 3)

    async def main() -> list[float]:
        others = [SimMks(address) for address in range(2, MANY)]
        line = VirtualLine(SimTlr(1, machine=TlrMachine(origin=(-1001, -1000))), *others, baudrate=115200)
        async with open_bus(line, baudrate=115200, config=BusConfig(echo=False)) as bus:
            x = TlrStepper(bus, 1)
            await x.enable()
            tasks = [asyncio.ensure_future(ask(bus, other.address)) for other in others]
            homing = x.home(Homing(mode=HomingMode.NEGATIVE_ORIGIN, rpm=100))
            await asyncio.sleep(4.0)
            homing.cancel()
            for task in tasks:
                task.cancel()
            return [record.sent_at for record in bus.flight if record.request[0] == 1]

    looks = on_virtual_clock(main())[-5:]
    assert max(after - before for before, after in itertools.pairwise(looks)) < 0.35
