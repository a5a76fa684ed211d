"""Turn a motor by the keys of a terminal, as with a joystick.

python examples/teleop.py                            # a virtual drive
python examples/teleop.py --port /dev/ttyUSB0 --baudrate 38400 --address 1
python examples/teleop.py --plot speeds.png          # and a picture of asked, told and measured speed

Hold w or s to turn forwards or backwards, W or S to turn faster; it stands when no key is held. q ends it. Where there
is no terminal, it plays three seconds by itself.
"""

import argparse
import asyncio
import contextlib
import math
import sys
from collections.abc import AsyncIterator, Iterator

from rs485bus import BusConfig, MksServo, open_bus
from rs485bus.sim import SimMks, VirtualLine

SPEEDS = {"w": 120.0, "W": 600.0, "s": -120.0, "S": -600.0}
HELD = 0.6
"""Seconds for which a key counts as held: a terminal repeats it after about half a second."""
EVERY = 0.02


@contextlib.contextmanager
def keys() -> Iterator[asyncio.Queue[str]]:
    """The keys that are pressed, one by one."""
    import termios
    import tty

    pressed: asyncio.Queue[str] = asyncio.Queue()
    loop, before = asyncio.get_running_loop(), termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    loop.add_reader(sys.stdin, lambda: pressed.put_nowait(sys.stdin.read(1)))
    try:
        yield pressed
    finally:
        loop.remove_reader(sys.stdin)
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


async def by_keys() -> AsyncIterator[float]:
    """The speed that is asked for, again and again."""
    with keys() as pressed:
        rpm, until = 0.0, 0.0
        while True:
            now = asyncio.get_running_loop().time()
            while not pressed.empty():
                key = pressed.get_nowait()
                if key == "q":
                    return
                rpm, until = SPEEDS.get(key, 0.0), now + HELD
            yield rpm if now < until else 0.0
            await asyncio.sleep(EVERY)


async def by_itself() -> AsyncIterator[float]:
    """The same, as if somebody moved a stick."""
    for step in range(round(3.0 / EVERY)):
        yield 0.0 if step * EVERY > 2.0 else 600.0 * math.sin(step * EVERY * math.pi)
        await asyncio.sleep(EVERY)


async def main(port: str | VirtualLine, baudrate: int, address: int, plot: str | None) -> None:
    speeds: list[tuple[float, float, float, float]] = []
    async with open_bus(port, baudrate=baudrate, config=BusConfig(supervision=0.1)) as bus:
        x = MksServo(bus, address)
        await x.enable()
        asked = by_keys() if sys.stdin.isatty() else by_itself()
        async with bus.watchdog(x, timeout=1.0), x.stream(timeout=0.25, acceleration=2000.0) as setpoint:
            begun = asyncio.get_running_loop().time()
            async for rpm in asked:
                setpoint(rpm)
                now = asyncio.get_running_loop().time() - begun
                speeds.append((now, rpm, setpoint.sent, setpoint.measured or 0.0))
                if len(speeds) % 10 == 0:
                    print(f"asked {rpm:7.1f} rpm, told {setpoint.sent:7.1f}, measured {speeds[-1][3]:7.1f}")
    print(f"at {x.sample.position or 0.0:.2f} turns")
    if plot is not None:
        draw(speeds, plot)


def draw(speeds: list[tuple[float, float, float, float]], file: str) -> None:
    """A picture of the speeds."""
    from matplotlib import pyplot

    times, *curves = zip(*speeds, strict=True)
    for name, curve in zip(("asked", "told", "measured"), curves, strict=True):
        pyplot.step(times, curve, label=name, where="post")
    pyplot.xlabel("s")
    pyplot.ylabel("rpm")
    pyplot.legend()
    pyplot.savefig(file)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Turn a motor by the keys of a terminal.")
    parser.add_argument("--port", help="a serial port or a gateway; without, a virtual drive")
    parser.add_argument("--baudrate", type=int, default=38400)
    parser.add_argument("--address", type=int, default=1)
    parser.add_argument("--plot", metavar="FILE", help="draw asked, told and measured speed")
    given = parser.parse_args()
    line = given.port or VirtualLine(SimMks(given.address), baudrate=given.baudrate)
    asyncio.run(main(line, given.baudrate, given.address, given.plot))
