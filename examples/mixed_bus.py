"""Three families on one pair: a closed-loop servo, a stepper with its own controller, and a pair of hub motors.

python examples/mixed_bus.py                        # virtual drives
python examples/mixed_bus.py --port /dev/ttyUSB0 --baudrate 115200
"""

import argparse
import asyncio

from rs485bus import MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.errors import NotSupported
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualLine


async def main(port: str | VirtualLine, baudrate: int) -> None:
    async with open_bus(port, baudrate=baudrate) as bus:
        x = MksServo(bus, 1)
        y = TlrStepper(bus, 2)
        base = Zlac8015d(bus, 3)
        try:
            y.watchdog(1.0)
        except NotSupported as error:
            print(error)
        async with bus.watchdog(x, base, timeout=1.0):
            # All have the same verbs, and all of them begin at once.
            for axis in (x, y, base.left):
                axis.enable()
            await asyncio.gather(*(axis.move_to(2.0, rpm=200) for axis in (x, y, base.left)))
            for axis in (x, y, base.left):
                print(axis, f"at {await axis.position():.2f} turns")
            await base.run(60, 60)
            await base.stop()
        stats = bus.stats
        print(f"{sum(unit.requests for unit in stats.units.values())} requests, {100 * stats.load:.0f} % of the wire")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="a serial port or a gateway; without, virtual drives")
    parser.add_argument("--baudrate", type=int, default=115200)
    given = parser.parse_args()
    plant = VirtualLine(SimMks(1), SimTlr(2), SimZlac(3), baudrate=given.baudrate)
    asyncio.run(main(given.port or plant, given.baudrate))
