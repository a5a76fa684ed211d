"""Watchdogs: while the block runs the drives are fed; if the program dies, they stop by themselves.

python examples/watchdog.py                        # virtual drives
python examples/watchdog.py --port /dev/ttyUSB0 --baudrate 38400
"""

import argparse
import asyncio

from rs485bus import MksServo, open_bus
from rs485bus.sim import SimMks, VirtualLine


async def main(port: str | VirtualLine, baudrate: int) -> None:
    async with open_bus(port, baudrate=baudrate) as bus:
        x, y = MksServo(bus, 1), MksServo(bus, 2)
        # Without a frame for a second the drives stop. Without renew() for half a second the bus stops them.
        async with bus.watchdog(x, y, timeout=1.0, lease=0.5) as guard:
            x.enable()
            y.enable()
            x.run(200)
            y.run(-200)
            for _ in range(8):
                await asyncio.sleep(0.2)
                guard.renew()  # the part of the program that must be alive says so
            for device in guard.report():
                print(
                    f"unit {device.address}: unheard for {1000 * device.longest:.0f} ms at most, "
                    f"{device.feeds} feeds sent, {device.saved} not needed"
                )
        print("left the block: both stand, their watchdogs are off")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="a serial port or a gateway; without, virtual drives")
    parser.add_argument("--baudrate", type=int, default=38400)
    given = parser.parse_args()
    plant = VirtualLine(SimMks(1), SimMks(2), baudrate=given.baudrate)
    asyncio.run(main(given.port or plant, given.baudrate))
