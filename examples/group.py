"""Axes of three families as one group: they start together, arrive together, and stop together.

python examples/group.py                        # virtual drives
python examples/group.py --port /dev/ttyUSB0 --baudrate 115200
"""

import argparse
import asyncio

from rs485bus import AxisGroup, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.errors import LimitExceeded, MoveCancelled
from rs485bus.sim import SimMks, SimTlr, SimZlac, VirtualLine


async def main(port: str | VirtualLine, baudrate: int) -> None:
    async with open_bus(port, baudrate=baudrate) as bus:
        base = Zlac8015d(bus, 3)
        group = AxisGroup(x=MksServo(bus, 1), y=TlrStepper(bus, 2), left=base.left, right=base.right)
        await group.enable()
        for targets in ({"x": 4.0, "y": 1.0, "left": 0.5, "right": 0.7}, {"x": 0.0, "y": 0.0}):
            move = group.move_to(**targets, duration=2.0)
            print("at", {name: round(position, 2) for name, position in (await move).items()})
            for name, part in move.moves.items():
                print(f"  {name} at {part.rpm:.0f} rpm with {part.acceleration:.0f} rpm/s")
            assert move.skew is not None
            print(f"  started within {1000 * move.skew:.1f} ms")
        try:
            await group.move_to(x=100.0, y=1.0, duration=0.5)
        except LimitExceeded as error:
            print(error)
        # Whoever stops one stops all.
        move = group.move_to(x=20.0, y=20.0, left=5.0, right=5.0)
        await asyncio.sleep(1.0)
        await group.axes["y"].stop()
        try:
            await move
        except MoveCancelled as error:
            print(error)
        await group.stop()  # to see all of them stand
        print("standing:", all([await axis.idle() for axis in group.axes.values()]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="a serial port or a gateway; without, virtual drives")
    parser.add_argument("--baudrate", type=int, default=115200)
    given = parser.parse_args()
    plant = VirtualLine(SimMks(1), SimTlr(2), SimZlac(3), baudrate=given.baudrate)
    asyncio.run(main(given.port or plant, given.baudrate))
