"""One axis of each family on a virtual line, what its shaft does, and how steep that is."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from typing import Any

import pytest

from rs485bus import Bus, BusConfig, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.motion.streaming import STEP
from rs485bus.sim import Noise, SimMks, SimTlr, SimZlac, TlrMachine, VirtualLine

ACCELERATION = 1000.0
Make = Callable[[], tuple[Any, Callable[[Bus], Any]]]


class _LeftWheel(SimZlac):
    """A virtual drive of which the left wheel is looked at."""

    def shaft(self, now: float) -> float:
        return self.shafts(now)[0]

    def moving(self, now: float) -> bool:
        self.advance(now)
        return self.left.motor.moving(now)


def one_mks() -> tuple[Any, Callable[[Bus], Any]]:
    return SimMks(1), lambda bus: MksServo(bus, 1)


def one_tlr() -> tuple[Any, Callable[[Bus], Any]]:
    return SimTlr(1, machine=TlrMachine(origin=None)), lambda bus: TlrStepper(bus, 1)


def one_live_tlr() -> tuple[Any, Callable[[Bus], Any]]:
    sim = SimTlr(1, machine=TlrMachine(origin=None), live_jog=True)
    return sim, lambda bus: TlrStepper(bus, 1, live_jog=True)


def one_zlac() -> tuple[Any, Callable[[Bus], Any]]:
    return _LeftWheel(1), lambda bus: Zlac8015d(bus, 1).left


def one_whole_range_zlac() -> tuple[Any, Callable[[Bus], Any]]:
    return _LeftWheel(1, ramp_rpm=1000.0), lambda bus: Zlac8015d(bus, 1, ramp_rpm=1000.0).left


MAKES: dict[str, Make] = {
    "MKS": one_mks,
    "TL-R": one_tlr,
    "TL-R with live speed": one_live_tlr,
    "ZLAC wheel": one_zlac,
    "ZLAC wheel, ramps for the whole range": one_whole_range_zlac,
}
FAMILIES = pytest.mark.parametrize("make", MAKES.values(), ids=MAKES)


def now() -> float:
    return asyncio.get_running_loop().time()


@dataclass
class Rig:
    """One axis, its virtual drive, and what its shaft does."""

    axis: Any
    sim: Any
    line: VirtualLine
    speeds: list[tuple[float, float]]
    """Times, and speeds in rpm."""

    @property
    def rpm(self) -> float:
        return self.speeds[-1][1]

    async def rests(self, within: float) -> float:
        """Wait until the shaft stands; how long that took."""
        begun = now()
        while self.sim.moving(now()):
            assert now() - begun <= within, f"it turns at {self.rpm:g} rpm"
            await asyncio.sleep(0.01)
        return now() - begun


@asynccontextmanager
async def rig(make: Make, *, noise: Noise | None = None, seed: int = 0, baudrate: int = 115200) -> AsyncIterator[Rig]:
    sim, axis_of = make()
    line = VirtualLine(sim, baudrate=baudrate, noise=noise or Noise(), seed=seed)
    async with open_bus(line, config=BusConfig(retries=5)) as bus:
        on = Rig(axis_of(bus), sim, line, [(now(), 0.0)])
        measuring = asyncio.create_task(_measure(on))
        await on.axis.enable()
        try:
            yield on
        finally:
            measuring.cancel()
            with suppress(asyncio.CancelledError):
                await measuring
    assert line.pair.early_frames == 0
    assert not sim.moving(now())


async def _measure(on: Rig, every: float = 0.01) -> None:
    place = on.sim.shaft(now())
    while True:
        await asyncio.sleep(every)
        before, place = place, on.sim.shaft(now())
        on.speeds.append((now(), (place - before) / every * 60))


def steepest(speeds: list[tuple[float, float]], over: int = 10) -> float:
    """The highest acceleration, in rpm/s, over so many samples."""
    pairs = zip(speeds, speeds[over:], strict=False)
    return max(abs(later[1] - sooner[1]) / (later[0] - sooner[0]) for sooner, later in pairs)


def kept(acceleration: float, over: float = 0.1) -> float:
    """The acceleration that counts as kept: 10 % more, and one step, which is told in whole rpm."""
    return 1.1 * acceleration + max(STEP * acceleration, 2.0) / over


def lose_replies(sim: Any, times: int) -> None:
    """Lose the replies to the next frames."""
    receive, left = sim.receive, [times]

    def lossy(frame: bytes, at: float) -> bytes | None:
        reply = receive(frame, at)
        left[0] -= 1
        return reply if left[0] < 0 else None

    sim.receive = lossy
