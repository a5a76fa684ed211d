"""One axis of each family, and what can happen to its virtual drive."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from rs485bus import Bus, BusConfig, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.bus.record import Record
from rs485bus.devices.zlac import Fault
from rs485bus.sim import Noise, SimMks, SimTlr, SimZlac, VirtualLine
from rs485bus.sim.motor import Motor
from tests.conformance.acme import AcmeServo
from tests.conformance.acme_sim import SimAcme


def now() -> float:
    return asyncio.get_running_loop().time()


@dataclass(frozen=True, kw_only=True)
class Subject:
    """A family, as the suite sees it."""

    name: str
    sim: Callable[[int], Any]
    facade: Callable[[Bus, int], Any]
    """Makes what has the address on its bus."""
    axis: Callable[[Any], Any] = lambda facade: facade
    """The axis that is tried, of the facade."""
    motor: Callable[[Any], Motor]
    fails: Callable[[Any, float], None]
    """Something is wrong with the drive."""
    restarts: Callable[[Any, float], None]
    watchdog: bool
    homes: bool
    streams: bool = True

    def __str__(self) -> str:
        return self.name


SUBJECTS = (
    Subject(
        name="MKS",
        sim=SimMks,
        facade=MksServo,
        motor=lambda sim: sim.motion.motor,
        fails=lambda sim, at: sim.motion.protect(at),
        restarts=lambda sim, at: sim.restart(at),
        watchdog=True,
        homes=True,
    ),
    Subject(
        name="TL-R",
        sim=SimTlr,
        facade=TlrStepper,
        motor=lambda sim: sim.motion.motor,
        fails=lambda sim, at: sim.motion.fail(9, at),
        restarts=lambda sim, at: sim.power_cycle(at),
        watchdog=False,
        homes=False,
    ),
    Subject(
        name="ZLAC",
        sim=SimZlac,
        facade=Zlac8015d,
        axis=lambda base: base.left,
        motor=lambda sim: sim.left.motor,
        fails=lambda sim, at: sim.left.fail(Fault.OVER_LOAD, at),
        restarts=lambda sim, at: sim.power_cycle(at),
        watchdog=True,
        homes=False,
    ),
    Subject(
        name="made up",
        sim=SimAcme,
        facade=AcmeServo,
        motor=lambda sim: sim.motor,
        fails=lambda sim, at: sim.fail(at),
        restarts=lambda sim, at: sim.restart(at),
        watchdog=False,
        homes=True,
    ),
)
EACH = pytest.mark.parametrize("subject", SUBJECTS, ids=str)


class Rig:
    """One axis on a virtual line."""

    def __init__(self, subject: Subject, bus: Bus, sims: list[Any]) -> None:
        self.subject = subject
        self.bus = bus
        self.sims = sims
        self.facades = [subject.facade(bus, sim.address) for sim in sims]
        self.axes = [subject.axis(facade) for facade in self.facades]
        self.records: list[Record] = []
        bus.subscribe(self.records.append)

    @property
    def axis(self) -> Any:
        return self.axes[0]

    @property
    def sim(self) -> Any:
        return self.sims[0]

    @property
    def moving(self) -> bool:
        return self.subject.motor(self.sim).moving(now())

    @property
    def turns(self) -> float:
        """Where the shaft truly is."""
        return self.subject.motor(self.sim).position(now())

    async def rests(self, within: float) -> float:
        """Wait until the shaft stands; how long that took."""
        begun = now()
        while self.moving:
            assert now() - begun <= within, "it turns on"
            await asyncio.sleep(0.005)
        return now() - begun

    def frames(self, number: int, lost: str) -> None:
        """Lose one frame of those that come from now on: a request, or the reply to it."""
        receive, count = self.sim.receive, [0]

        def losing(frame: bytes, at: float) -> bytes | None:
            if frame[0] != self.sim.address:
                return receive(frame, at)
            count[0] += 1
            if count[0] - 1 != number:
                return receive(frame, at)
            if lost == "reply":
                receive(frame, at)
            return None

        self.sim.receive = losing


@asynccontextmanager
async def rig(
    subject: Subject,
    *,
    count: int = 1,
    enable: bool = True,
    noise: Noise | None = None,
    config: BusConfig | None = None,
) -> AsyncIterator[Rig]:
    """So many axes of a family, enabled."""
    sims = [subject.sim(address) for address in range(1, count + 1)]
    line = VirtualLine(*sims, noise=noise or Noise())
    async with open_bus(line, config=config or BusConfig()) as bus:
        made = Rig(subject, bus, sims)
        if enable:
            for axis in made.axes:
                await axis.enable()
        yield made
    assert line.pair.early_frames == 0
