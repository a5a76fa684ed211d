"""One axis: enable it, find its origin, move, ask where it is.

python examples/one_axis.py                          # a virtual drive
python examples/one_axis.py /dev/ttyUSB0 38400 1     # port, baud rate, address
"""

import asyncio
import sys

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
    if len(sys.argv) > 1:
        asyncio.run(main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3])))
    else:
        asyncio.run(main(VirtualLine(SimMks(1), baudrate=38400), 38400, 1))
