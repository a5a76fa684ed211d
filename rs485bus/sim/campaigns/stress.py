"""Watchdogs under stress, in virtual time.

    python -m rs485bus.sim.stress tight --hours 1      the tightest admitted sets, two replies lost at the worst moments
    python -m rs485bus.sim.stress deaths               k dead drives of n, for every n and k
    python -m rs485bus.sim.stress slow                 drives that become ten times as slow

`--only N` runs one of them again, by its number.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor

from rs485bus.bus.config import BusConfig
from rs485bus.sim.campaigns.failing import Deaths, Slowness, die, slow_down
from rs485bus.sim.campaigns.guarded import Plant
from rs485bus.sim.campaigns.tight import Verdict, stress

TURNAROUNDS = (0.001, 0.005, 0.02, 0.09)
"""Seconds before the drives answer: all of a set the same, or mixed."""
BAUDRATES = (9600, 38400, 115200)
COUNTS = (1, 2, 4, 10, 31)
_MIXED = [(each,) for each in TURNAROUNDS] + [TURNAROUNDS]
_SLOW_REPLIES = BusConfig(echo=False, reply_timeout=1.0)

Work = Callable[[], "Verdict | Deaths | Slowness"]


class Tight:
    """One tightest set."""

    def __init__(self, plant: Plant, seconds: float, seed: int) -> None:
        self.arguments = (plant, seconds, seed)

    def __call__(self) -> Verdict:
        return stress(*self.arguments)


class Dead:
    """Some dead drives."""

    def __init__(self, plant: Plant, dead: int, timeout: float, pressed: float | None, seed: int) -> None:
        self.plant, self.dead, self.timeout, self.pressed, self.seed = plant, dead, timeout, pressed, seed

    def __call__(self) -> Deaths:
        timeout = max(self.timeout, self.plant.tightest())
        return die(self.plant, self.dead, timeout, pressed=self.pressed, seed=self.seed)


class Slow:
    """Some slow drives."""

    def __init__(self, plant: Plant, slow: int, timeout: float, seed: int) -> None:
        self.plant, self.slow, self.timeout, self.seed = plant, slow, timeout, seed

    def __call__(self) -> Slowness:
        return slow_down(self.plant, self.slow, max(self.timeout, self.plant.tightest()), seed=self.seed)


def tight(hours: float, seed: int) -> list[Work]:
    """The tightest sets of 1 to 31 drives, on slow and fast lines."""
    return [
        Tight(Plant(count, baudrate, each), 3600 * hours, seed)
        for count in COUNTS
        for baudrate in BAUDRATES
        for each in _MIXED
    ]


def deaths(seed: int) -> list[Work]:
    """Every number of dead drives of every number of drives: with a second, at the tightest, and stopped at 20 Hz."""
    return [
        Dead(Plant(count, 115200, (0.002,)), dead, timeout, pressed, seed)
        for timeout, pressed in ((1.0, None), (0.0, None), (0.0, 0.05))
        for count in range(2, 32)
        for dead in range(1, count + 1)
    ]


def slow(seed: int) -> list[Work]:
    """One, half and all of the drives become slow."""
    return [
        Slow(
            Plant(count, baudrate, (turnaround,), _SLOW_REPLIES if turnaround > 0.009 else BusConfig(echo=False)),
            each,
            timeout,
            seed,
        )
        for timeout in (0.0, 1.0, 2.0)
        for baudrate in BAUDRATES
        for turnaround in (0.002, 0.005, 0.009, 0.05)
        for count in (1, 2, 3, 6, 12, 31)
        for each in sorted({1, (count + 1) // 2, count})
    ]


def _carry_out(work: Work) -> Verdict | Deaths | Slowness:
    return work()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["tight", "deaths", "slow"])
    parser.add_argument("--hours", type=float, default=1.0, help="virtual time of each tightest set")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=None)
    parser.add_argument("--only", type=int, default=None, help="one of them, by its number")
    options = parser.parse_args()
    seed = options.seed
    work = {"tight": lambda: tight(options.hours, seed), "deaths": lambda: deaths(seed), "slow": lambda: slow(seed)}[
        options.what
    ]()
    chosen = range(len(work)) if options.only is None else [options.only]
    faults = 0
    with ProcessPoolExecutor(options.processes) as pool:
        for number, verdict in zip(chosen, pool.map(_carry_out, [work[each] for each in chosen]), strict=True):
            print(f"{number:4d}: {verdict}", flush=True)
            for fault in verdict.faults[:5]:
                print("      wrong:", fault)
            faults += bool(verdict.faults)
    print(f"{faults} of {len(chosen)} went wrong")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
