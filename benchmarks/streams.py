"""How old set-points are when they are on the wire, how many are told, and what share of it they take.

python -m benchmarks.streams

Streams of 20, 50 and 100 Hz on each family, on virtual drives and a virtual clock: alone, with three other drives that
are polled, and with 5 % of the frames lost. A transaction is what the same line takes for a frame of the stream alone.
Beside that, how long a motor turns on when the stick is released, and when the task that streams dies.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import random
import statistics
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from rs485bus import Bus, BusConfig, MksServo, TlrStepper, open_bus
from rs485bus.bus.record import Record
from rs485bus.errors import BusError
from rs485bus.sim import Noise, SimMks, SimTlr, TlrMachine, VirtualClockLoop, VirtualLine

ACCELERATION = 2000.0
SECONDS = 4.0
CASES = ("alone", "with 3 polled", "5 % lost")
RATES = (20, 50, 100)
BAUDRATES = (38400, 115200)


@dataclass(frozen=True, slots=True)
class Family:
    """A drive to stream to."""

    sim: Callable[[], Any]
    axis: Callable[[Bus], Any]


FAMILIES = {
    "MKS": Family(lambda: SimMks(1), lambda bus: MksServo(bus, 1)),
    "TL-R": Family(lambda: SimTlr(1, machine=TlrMachine(origin=None)), lambda bus: TlrStepper(bus, 1)),
    "TL-R, live_jog": Family(
        lambda: SimTlr(1, machine=TlrMachine(origin=None), live_jog=True),
        lambda bus: TlrStepper(bus, 1, live_jog=True),
    ),
}


@dataclass(frozen=True, slots=True)
class Result:
    """What was measured."""

    median: float
    """Of the ages, in transactions."""
    p99: float
    worst: float
    told: float
    """Set-points a second."""
    share: float
    """The part of the time in which frames of the stream, or their answers, take the wire."""


def now() -> float:
    """The time on the loop's clock."""
    return asyncio.get_running_loop().time()


def on_virtual_clock(main: Any) -> Any:
    """What a coroutine gives on a loop whose clock is virtual."""
    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        return runner.run(main)


async def stream(family: Family, baudrate: int, rate: int, case: str) -> Result:
    """One stream of random speeds."""
    loss = 0.025 if case == "5 % lost" else 0.0
    others = [SimMks(address) for address in (2, 3, 4)] if case == "with 3 polled" else []
    noise = Noise(lost_request=loss, lost_reply=loss)
    sim = family.sim()
    sim.baudrate = baudrate
    line = VirtualLine(sim, *others, baudrate=baudrate, noise=noise, seed=rate)
    async with open_bus(line, config=BusConfig(retries=5)) as bus:
        axis = family.axis(bus)
        await axis.enable()
        took: list[float] = []
        bus.subscribe(lambda record: took.append(record.latency) if _is_setpoint(record) else None)
        polling = [asyncio.create_task(_poll(MksServo(bus, other.address))) for other in others]
        ages: list[float] = []
        told = 0
        rng = random.Random(rate)
        async with axis.stream(acceleration=ACCELERATION) as setpoint:
            rpm, until = 200.0, now() + SECONDS
            while now() < until:
                rpm += rng.uniform(-1, 1) * ACCELERATION / rate / 2
                setpoint(rpm := max(50.0, min(rpm, 400.0)))
                await asyncio.sleep(rng.uniform(0.9, 1.1) / rate)
                if setpoint.count > told:
                    told = setpoint.count
                    ages.append(setpoint.delay)
            share = sum(took) / SECONDS
        for task in polling:
            task.cancel()
    one = statistics.median(took)
    ages = sorted(age / one for age in ages)
    return Result(statistics.median(ages), ages[int(0.99 * (len(ages) - 1))], ages[-1], told / SECONDS, share)


def _is_setpoint(record: Record) -> bool:
    return record.address == 1 and record.request[1] in (6, 16)


async def _poll(axis: MksServo) -> None:
    while True:
        with suppress(BusError):
            await axis.position()
        await asyncio.sleep(0.02)


async def rest(family: Family, dies: bool) -> float:
    """Seconds for which a motor turns on beyond its ramp: when the stick is released, or its task dies."""
    sim, rpm = family.sim(), 400.0
    async with open_bus(VirtualLine(sim, baudrate=115200)) as bus:
        axis = family.axis(bus)
        await axis.enable()

        async def source() -> None:
            async with axis.stream(timeout=0.25, acceleration=ACCELERATION) as setpoint:
                for step in range(10**6):
                    setpoint(rpm if step < 50 or dies else 0.0)
                    await asyncio.sleep(0.02)

        streaming = asyncio.create_task(source())
        await asyncio.sleep(1.0)
        begun = now()
        if dies:
            streaming.cancel()
        while sim.moving(now()):  # noqa: ASYNC110 # a virtual shaft tells nobody that it stands
            await asyncio.sleep(0.005)
        took = now() - begun
        streaming.cancel()
        with suppress(asyncio.CancelledError):
            await streaming
    return took - rpm / ACCELERATION


def table(families: dict[str, Family], rates: tuple[int, ...]) -> Iterator[str]:
    """The lines of the report."""
    columns = ("median", "p99", "worst", "told/s", "share")
    yield f"{'family':15} {'baud':>6} {'Hz':>4}  {'case':14} " + " ".join(f"{column:>7}" for column in columns)
    for name, family in families.items():
        for baudrate in BAUDRATES:
            for rate in rates:
                for case in CASES:
                    r = on_virtual_clock(stream(family, baudrate, rate, case))
                    yield (
                        f"{name:15} {baudrate:6} {rate:4}  {case:14} {r.median:7.2f} {r.p99:7.2f} {r.worst:7.2f} "
                        f"{r.told:7.1f} {r.share:7.0%}"
                    )
        stick, task = (on_virtual_clock(rest(family, dies)) for dies in (False, True))
        yield f"{name}: at rest {stick:.3f} s after its ramp if the stick is released, {task:.3f} s if its task dies"


if __name__ == "__main__":
    logging.disable(logging.WARNING)
    parser = argparse.ArgumentParser(description="How old set-points are when they are on the wire.")
    parser.add_argument("--rates", type=int, nargs="+", default=RATES, help="set-points a second")
    given = parser.parse_args()
    for text in table(FAMILIES, tuple(given.rates)):
        print(text, flush=True)
