"""Three axes on one pair: home all at once, move together, and stop all if one fails.

python examples/three_axes.py                        # virtual drives
python examples/three_axes.py --port /dev/ttyUSB0 --baudrate 38400
"""

import argparse
import asyncio

from rs485bus import MksServo, open_bus
from rs485bus.sim import SimMks, VirtualLine


async def main(port: str | VirtualLine, baudrate: int) -> None:
    async with open_bus(port, baudrate=baudrate) as bus:
        axes = [MksServo(bus, address) for address in (1, 2, 3)]
        for axis in axes:
            axis.enable()
        await asyncio.gather(*(axis.home() for axis in axes))
        print("homed")
        # A task group: if one move fails, the block is left, and leaving the bus by an error stops every axis.
        async with asyncio.TaskGroup() as group:
            for turns, axis in enumerate(axes, start=2):
                group.create_task(axis.move_to(float(turns)).wait())
        print("at", [await axis.position() for axis in axes], "turns")
        for axis in axes:
            axis.run(120)
        await asyncio.sleep(1)
        await asyncio.gather(*(axis.stop() for axis in axes))
        print("standing:", all([await axis.idle() for axis in axes]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="a serial port or a gateway; without, virtual drives")
    parser.add_argument("--baudrate", type=int, default=38400)
    given = parser.parse_args()
    plant = VirtualLine(*(SimMks(address) for address in (1, 2, 3)), baudrate=given.baudrate)
    asyncio.run(main(given.port or plant, given.baudrate))
