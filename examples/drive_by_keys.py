"""Drive a vehicle by the keys of a terminal, without `async`.

python examples/drive_by_keys.py                    # virtual wheels
python examples/drive_by_keys.py --port /dev/ttyUSB0 --baudrate 115200

Hold w, s, a or d to go ahead, back, left or right; it stands when no key is held. q ends it. Where there is no
terminal, it goes ahead and turns left by itself.
"""

import argparse
import contextlib
import sys
import time
from collections.abc import Iterator

from rs485bus import blocking
from rs485bus.sim import SimZlac, VirtualLine

KEYS = {"w": (0.4, 0.0), "s": (-0.4, 0.0), "a": (0.0, 1.0), "d": (0.0, -1.0)}
HELD = 0.6
"""Seconds for which a key counts as held: a terminal repeats it after about half a second."""


@contextlib.contextmanager
def each_key() -> Iterator[None]:
    """Have the terminal hand over each key as it comes."""
    import termios
    import tty

    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


def drive(port: str | VirtualLine, baudrate: int, keys: Iterator[str]) -> None:
    """Turn keys into set-points, each a speed in m/s and a turn in rad/s to the left."""
    with blocking.open_bus(port, baudrate=baudrate) as bus:
        base = bus.zlac(1, reverse=(False, True))  # the right wheel is mounted mirrored
        vehicle = bus.vehicle(base, wheel_radius=0.085, track=0.4)
        with bus.watchdog(base, timeout=0.5):
            base.enable().wait()
            vehicle.reset()  # here and so it begins
            with vehicle.stream(timeout=HELD) as setpoint:
                for key in keys:
                    setpoint(*KEYS.get(key, (0.0, 0.0)))
        pose = vehicle.update()
        print(f"stands at x {pose.x:.2f} m, y {pose.y:.2f} m")


def pressed() -> Iterator[str]:
    """The keys that are pressed, until q."""
    with each_key():
        while (key := sys.stdin.read(1)) not in ("q", ""):
            yield key


def by_itself() -> Iterator[str]:
    """The same, as if somebody held w and then a."""
    for key in "w" * 10 + "a" * 10:
        yield key
        time.sleep(0.1)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", help="a serial port or a gateway; without, virtual wheels")
    parser.add_argument("--baudrate", type=int, default=115200)
    given = parser.parse_args()
    there = given.port or VirtualLine(SimZlac(1), baudrate=given.baudrate)
    drive(there, given.baudrate, pressed() if sys.stdin.isatty() else by_itself())
