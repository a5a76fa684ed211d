"""What a call of the blocking face costs more than an await, in the same run.

python -m benchmarks.blocking --rounds 5 --calls 200

A virtual drive is asked for its position, by both faces in turns. The wire takes the same time for both; what differs
is two changes of thread.
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import time

from rs485bus import MksServo, blocking, open_bus
from rs485bus.sim import SimMks, VirtualLine

_BAUDRATE = 115200
_WARM = 20


def _line() -> VirtualLine:
    return VirtualLine(SimMks(1), baudrate=_BAUDRATE)


async def _by_async(calls: int) -> list[float]:
    """Seconds that each of so many awaits took."""
    took = []
    async with open_bus(_line()) as bus:
        x = MksServo(bus, 1)
        for _ in range(_WARM + calls):
            begun = time.perf_counter()
            await x.position()
            took.append(time.perf_counter() - begun)
    return took[_WARM:]


def _by_blocking(calls: int) -> list[float]:
    """Seconds that each of so many calls took."""
    took = []
    with blocking.open_bus(_line()) as bus:
        x = bus.mks(1)
        for _ in range(_WARM + calls):
            begun = time.perf_counter()
            x.position()
            took.append(time.perf_counter() - begun)
    return took[_WARM:]


def measure(rounds: int, calls: int) -> tuple[float, float]:
    """The median call by async and by the blocking face, in seconds."""
    awaited: list[float] = []
    blocked: list[float] = []
    for _ in range(rounds):
        awaited += asyncio.run(_by_async(calls))
        blocked += _by_blocking(calls)
    return statistics.median(awaited), statistics.median(blocked)


def main() -> None:
    """Measure, and say what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--calls", type=int, default=200)
    given = parser.parse_args()
    awaited, blocked = measure(given.rounds, given.calls)
    print(f"async     {1e6 * awaited:7.0f} us, the median of {given.rounds * given.calls} calls")
    print(f"blocking  {1e6 * blocked:7.0f} us, {1e6 * (blocked - awaited):+.0f} us")


if __name__ == "__main__":
    main()
