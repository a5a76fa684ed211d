"""A vehicle on two hub motors: drive it by speed and turn, and know where it is.

python examples/vehicle.py                        # virtual drives
python examples/vehicle.py --port /dev/ttyUSB0 --baudrate 115200
"""

import argparse
import asyncio
import math

from rs485bus import DifferentialDrive, Zlac8015d, open_bus
from rs485bus.sim import SimZlac, VirtualLine


async def main(port: str | VirtualLine, baudrate: int) -> None:
    async with open_bus(port, baudrate=baudrate) as bus:
        base = Zlac8015d(bus, 1, reverse=(False, True))  # the right wheel is mounted mirrored
        vehicle = DifferentialDrive(base, wheel_radius=0.085, track=0.4)
        async with base.watchdog(0.5):
            await base.enable()
            await vehicle.reset()  # here and so it begins
            vehicle.drive(0.3, 0.0)  # m/s ahead, rad/s to the left
            await asyncio.sleep(1.0)
            vehicle.drive(0.3, math.radians(45))
            async with asyncio.timeout(1.5):
                async for pose in vehicle.poses(every=0.25):
                    print(f"x {pose.x:5.2f} m   y {pose.y:5.2f} m   heading {math.degrees(pose.heading):5.1f} deg")
                    if pose.heading > math.radians(45):
                        break
            await vehicle.stop()
            pose = await vehicle.update()
            print(f"stands at x {pose.x:.2f} m, y {pose.y:.2f} m")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="a serial port or a gateway; without, virtual drives")
    parser.add_argument("--baudrate", type=int, default=115200)
    given = parser.parse_args()
    plant = VirtualLine(SimZlac(1), baudrate=given.baudrate)
    asyncio.run(main(given.port or plant, given.baudrate))
