"""The first move, without async: enable, find the origin, go somewhere, say where that is.

python examples/first_move.py                        # a virtual drive
python examples/first_move.py --port /dev/ttyUSB0 --baudrate 38400
"""

import argparse

from rs485bus import blocking
from rs485bus.sim import SimMks, VirtualLine


def main(port: str | VirtualLine, baudrate: int) -> None:
    with blocking.open_bus(port, baudrate=baudrate) as bus:
        x = bus.mks(1)
        x.enable()
        x.home().wait()
        x.move_to(3, rpm=300).wait()
        print(f"at {x.position():.2f} turns")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="a serial port or a gateway; without, a virtual drive")
    parser.add_argument("--baudrate", type=int, default=38400)
    given = parser.parse_args()
    main(given.port or VirtualLine(SimMks(1), baudrate=given.baudrate), given.baudrate)
