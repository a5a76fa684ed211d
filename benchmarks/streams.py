"""How old set-points are when they are on the wire, how many are told, and what share of it they take.

python -m benchmarks.streams

Streams of 20, 50 and 100 Hz on each family, on virtual drives and a virtual clock: alone, with three other drives that
are polled, and with 5 % of the frames lost. Ages are in transactions: a frame of the stream, its answer, and the
silence after it. "wire" is when the frame was sent that carries the speed, "told" when the one was sent by which the
drive turned to it: a TL-R drive is told a speed, and then to jog. What is lost does not count as told. The judge is the
virtual drive, not the library.

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
from dataclasses import dataclass, field
from typing import Any

from benchmarks.virtual_clock import now, on_virtual_clock
from rs485bus import Bus, BusConfig, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.bus.record import Record
from rs485bus.errors import BusError
from rs485bus.sim import Noise, SimMks, SimTlr, SimZlac, TlrMachine, VirtualLine
from rs485bus.sim.motor import Motor

ACCELERATION = 2000.0
SECONDS = 4.0
CASES = ("alone", "with 3 polled", "5 % lost")
RATES = (20, 50, 100)
BAUDRATES = (38400, 115200)
SLOWEST, FASTEST = 40, 240
_WRITES = (6, 16)
_TIMES = (0x2082).to_bytes(2, "big")
"""Where the ramps of a ZLAC are; they carry no speed."""
_CONTROL = (0x4E).to_bytes(2, "big")
"""The control word of a TL-R; it carries none, either."""


@dataclass(frozen=True, slots=True)
class Family:
    """A drive to stream to."""

    sim: Callable[[], Any]
    facade: Callable[[Bus], Any]
    motor: Callable[[Any], Motor]
    """The shaft of the virtual drive that is looked at."""
    told: Callable[[float], tuple[float, ...]] = lambda rpm: (rpm,)
    """What its stream is told for a speed."""


def _tlr(*, live: bool) -> Family:
    return Family(
        lambda: SimTlr(1, machine=TlrMachine(origin=None), live_jog=live),
        lambda bus: TlrStepper(bus, 1, live_jog=live),
        lambda sim: sim.motion.motor,
    )


def _wheel(of: Callable[[Zlac8015d], Any], told: Callable[[float], tuple[float, ...]]) -> Family:
    return Family(lambda: SimZlac(1), lambda bus: of(Zlac8015d(bus, 1)), lambda sim: sim.left.motor, told)


FAMILIES = {
    "MKS": Family(lambda: SimMks(1), lambda bus: MksServo(bus, 1), lambda sim: sim.motion.motor),
    "TL-R": _tlr(live=False),
    "TL-R, live_jog": _tlr(live=True),
    "ZLAC wheel": _wheel(lambda base: base.left, lambda rpm: (rpm,)),
    "ZLAC base": _wheel(lambda base: base, lambda rpm: (rpm, -rpm / 2)),
}


@dataclass(slots=True)
class Ages:
    """How old set-points are. Speeds are whole, and none comes twice within a second."""

    given: dict[int, float] = field(default_factory=dict)
    """When each speed was asked for that was not seen yet."""
    seen: list[float] = field(default_factory=list)

    def ask(self, rpm: int, at: float) -> None:
        """A new set-point."""
        self.given[rpm] = at

    def see(self, rpm: int, at: float) -> None:
        """A speed was told. The set-points before it are not told any more."""
        if rpm in self.given:
            self.seen.append(at - self.given[rpm])
            for older in [each for each in self.given if self.given[each] <= self.given[rpm]]:
                del self.given[older]

    def in_transactions(self, one: float) -> tuple[float, float, float]:
        """The median, the 99th percentile and the highest."""
        ages = sorted(self.seen)
        return statistics.median(ages) / one, ages[int(0.99 * (len(ages) - 1))] / one, ages[-1] / one


@dataclass(frozen=True, slots=True)
class Result:
    """What was measured. Ages are in transactions: the median, the 99th percentile and the highest."""

    wire: tuple[float, float, float]
    told: tuple[float, float, float]
    rate: float
    """Set-points told a second."""
    share: float
    """The part of the time in which frames of the stream, their answers, or the silence after them take the wire."""


async def stream(family: Family, baudrate: int, rate: int, case: str, seconds: float = SECONDS) -> Result:
    """One stream of speeds."""
    loss = 0.025 if case == "5 % lost" else 0.0
    others = [SimMks(address) for address in (2, 3, 4)] if case == "with 3 polled" else []
    noise = Noise(lost_request=loss, lost_reply=loss)
    sim = family.sim()
    sim.baudrate = baudrate
    line = VirtualLine(sim, *others, baudrate=baudrate, noise=noise, seed=rate)
    wire, told, took = Ages(), Ages(), []

    def look(record: Record) -> None:
        if record.address == 1 and record.request[1] in _WRITES:
            took.append(record.latency + line.line.t35)
            if record.request[2:4] not in (_TIMES, _CONTROL):
                wire.see(_carried(record.request), record.sent_at)

    _watch(
        sim,
        lambda frame, at: told.see(
            round(family.motor(sim).wanted_rpm), at - line.line.airtime(len(frame)) - line.line.t35
        ),
    )
    async with open_bus(line, config=BusConfig(retries=5)) as bus:
        facade = family.facade(bus)
        await facade.enable()
        polling = [asyncio.create_task(_poll(MksServo(bus, other.address))) for other in others]
        rng = random.Random(rate)
        async with facade.stream(acceleration=ACCELERATION) as setpoint:
            await _warm_up(setpoint, family, rate)
            bus.subscribe(look)
            until = now() + seconds
            for rpm in _speeds(rng):
                if now() >= until:
                    break
                wire.ask(rpm, now())
                told.ask(rpm, now())
                setpoint(*family.told(rpm))
                await asyncio.sleep(rng.uniform(0.9, 1.1) / rate)
            share = sum(took) / seconds
        for task in polling:
            task.cancel()
    one = statistics.median(took)
    return Result(wire.in_transactions(one), told.in_transactions(one), len(told.seen) / seconds, share)


async def _warm_up(setpoint: Any, family: Family, rate: int) -> None:
    """Have it turn, so that no start is measured."""
    for _ in range(rate):
        setpoint(*family.told(SLOWEST - 1))
        await asyncio.sleep(1 / rate)


def _speeds(rng: random.Random) -> Iterator[int]:
    """Up and down, in small and uneven steps."""
    rpm, way = SLOWEST, 1
    while True:
        rpm += way * rng.randint(1, 3)
        if not SLOWEST <= rpm <= FASTEST:
            way, rpm = -way, rpm - 4 * way
        yield rpm


def _carried(request: bytes) -> int:
    """The speed of the first wheel, or the only one, that a frame carries, in rpm."""
    if request[1] == 6:
        return int.from_bytes(request[4:6], "big")
    if request[2:4] == b"\x00\xf6":
        return int.from_bytes(request[9:11], "big")
    return int.from_bytes(request[7:9], "big")


def _watch(sim: Any, seen: Callable[[bytes, float], None]) -> None:
    """Look at a virtual drive after each frame that it has heard."""
    receive = sim.receive

    def watched(frame: bytes, at: float) -> bytes | None:
        reply = receive(frame, at)
        seen(frame, at)
        return reply  # type: ignore[no-any-return] # any virtual drive

    sim.receive = watched


async def _poll(axis: MksServo) -> None:
    while True:
        with suppress(BusError):
            await axis.position()
        await asyncio.sleep(0.02)


async def rest(family: Family, dies: bool) -> float:
    """Seconds for which a motor turns on beyond its ramp: when the stick is released, or its task dies."""
    sim, rpm = family.sim(), 240.0
    async with open_bus(VirtualLine(sim, baudrate=115200)) as bus:
        facade = family.facade(bus)
        await facade.enable()

        async def source() -> None:
            async with facade.stream(timeout=0.25, acceleration=ACCELERATION) as setpoint:
                for step in range(10**6):
                    setpoint(*family.told(rpm if step < 50 or dies else 0.0))
                    await asyncio.sleep(0.02)

        streaming = asyncio.create_task(source())
        await asyncio.sleep(1.0)
        begun = now()
        if dies:
            streaming.cancel()
        while family.motor(sim).moving(now()):  # noqa: ASYNC110 # a virtual shaft tells nobody that it stands
            await asyncio.sleep(0.005)
        took = now() - begun
        streaming.cancel()
        with suppress(asyncio.CancelledError):
            await streaming
    return took - rpm / ACCELERATION


def table(families: dict[str, Family], rates: tuple[int, ...]) -> Iterator[str]:
    """The lines of the report."""
    columns = ("median", "p99", "worst")
    yield (
        f"{'family':15} {'baud':>6} {'Hz':>4}  {'case':14} "
        + " ".join(
            f"{what:>11}"
            for what in [*(f"wire {column}" for column in columns), *(f"told {column}" for column in columns)]
        )
        + f" {'told/s':>7} {'share':>6}"
    )
    for name, family in families.items():
        for baudrate in BAUDRATES:
            for rate in rates:
                for case in CASES:
                    r = on_virtual_clock(stream(family, baudrate, rate, case))
                    ages = " ".join(f"{age:11.2f}" for age in (*r.wire, *r.told))
                    yield f"{name:15} {baudrate:6} {rate:4}  {case:14} {ages} {r.rate:7.1f} {r.share:6.0%}"
        stick, task = (on_virtual_clock(rest(family, dies)) for dies in (False, True))
        yield f"{name}: at rest {stick:.3f} s after its ramp if the stick is released, {task:.3f} s if its task dies"


if __name__ == "__main__":
    logging.disable(logging.WARNING)
    parser = argparse.ArgumentParser(description="How old set-points are when they are on the wire.")
    parser.add_argument("--rates", type=int, nargs="+", default=RATES, help="set-points a second")
    given = parser.parse_args()
    for text in table(FAMILIES, tuple(given.rates)):
        print(text, flush=True)
