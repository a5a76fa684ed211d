"""One axis: enable it, find its origin, move, ask where it is.

python examples/one_axis.py                        # virtual drives
python examples/one_axis.py --port /dev/ttyUSB0 --baudrate 38400 --address 1
"""

import argparse
import asyncio

from rs485bus import MksServo, open_bus
from rs485bus.sim import SimMks, VirtualLine


async def main(port: str | VirtualLine, baudrate: int, address: int) -> None:
    async with open_bus(port, baudrate=baudrate) as bus:
        x = MksServo(bus, address, units_per_turn=8.0, limits=(0.0, 200.0))  # 8 mm a turn: positions are mm
        x.enable()
        await x.home()
        move = x.move_to(60.0, rpm=600)
        x.move_by(-20.0, rpm=300)
        async for position in move.positions(every=0.2):
            print(f"{position:6.2f} mm")
        await x.drain()
        print(f"at {await x.position():.2f} mm")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="a serial port or a gateway; without, virtual drives")
    parser.add_argument("--baudrate", type=int, default=38400)
    parser.add_argument("--address", type=int, default=1)
    given = parser.parse_args()
    plant = VirtualLine(SimMks(given.address), baudrate=given.baudrate)
    asyncio.run(main(given.port or plant, given.baudrate, given.address))
