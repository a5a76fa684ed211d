"""What `tune` measures, on virtual pairs whose properties are drawn at random."""

import asyncio
import random

import pytest

from rs485bus.bench.tune import MARGIN, Tuned, Tuning
from rs485bus.bus.config import BusConfig
from rs485bus.errors import NoReply
from rs485bus.sim import Dip, Noise, SimDevice, SimMks, SimTlr, SimZlac, VirtualLine
from rs485bus.transport.interface import Transport
from rs485bus.wire.timing import LineSettings
from tests.integration.support import virtual


class Pair:
    """A pair with drives of any family, each with its own need of silence, and a cable that carries some rates."""

    def __init__(self, draw: random.Random) -> None:
        self.turnaround = draw.uniform(0.0005, 0.02)
        self.rate = draw.choice([9600, 38400, 115200])
        self.carries = draw.choice([rate for rate in (19200, 38400, 57600, 115200, 256000) if rate >= self.rate])
        families = draw.choice([["mks"], ["mks", "mks"], ["tlr"], ["zlac", "mks"], ["tlr", "zlac"]])
        self.drives = dict(enumerate(families, 20))
        self.devices = [self._drive(family, address) for address, family in self.drives.items()]
        self.needs = [draw.uniform(0.3, 1.0) for _ in self.devices]
        """What silence each needs, as a part of t3.5."""
        self.tries = draw.random() < 0.6

    def _drive(self, family: str, address: int) -> SimDevice:
        if family == "mks":
            return SimMks(address, baudrate=self.rate)
        if family == "zlac":
            zlac = SimZlac(address)
            zlac.baudrate = self.rate
            return zlac
        tlr = SimTlr(address, dip=Dip(0, custom_baudrate=True), serial_at_once=False)
        tlr.baudrate = self.rate
        return tlr

    def port(self, line: LineSettings) -> Transport:
        for device, part in zip(self.devices, self.needs, strict=True):
            device.silence = part * line.t35
        noise = Noise(flipped=0.05) if line.baudrate > self.carries else Noise()
        return VirtualLine(*self.devices, baudrate=line.baudrate, turnaround=self.turnaround, noise=noise)

    async def tuned(self, rates: list[int], rounds: int) -> Tuned:
        tuning = Tuning(
            port=self.port,
            drives=self.drives,
            line=LineSettings(baudrate=self.rate),
            config=BusConfig(),
            rounds=rounds,
        )
        return await tuning.run(rates, self._power_cycle, lambda question: True)

    async def _power_cycle(self, text: str) -> bool:
        for device in self.devices:
            if isinstance(device, SimTlr | SimZlac):
                device.power_cycle(asyncio.get_running_loop().time())
        return True


async def check_tune(draw: random.Random, rounds: int = 60) -> None:
    pair = Pair(draw)
    common = [19200, 38400, 57600, 115200] if pair.tries and set(pair.drives.values()) == {"mks"} else []
    rates = [rate for rate in (*common, 256000) if rate > pair.rate] if common else []
    tuned = await pair.tuned(rates, rounds)
    best = max(rate for rate in (pair.rate, *rates) if rate <= pair.carries)
    assert tuned.line.baudrate == best
    assert [device.rate(1e6) for device in pair.devices] == [best] * len(pair.devices)
    line = tuned.line
    for took in tuned.replies.values():  # a drive knows that a frame is over only after t3.5
        assert took == pytest.approx(max(pair.turnaround, line.t35), abs=0.0005)
    needed = min(line.t35, max(line.shortest_silence, max(pair.needs) * line.t35))
    assert tuned.shortest is not None
    resolution = (line.t35 - line.shortest_silence) / 2**5
    assert needed - 1e-6 <= tuned.shortest <= needed + resolution + 1e-6
    assert tuned.silence is None or tuned.silence >= min(line.t35, needed)


@pytest.mark.parametrize("seed", range(3))
@virtual
async def test_what_a_pair_can_do_is_found(seed: int) -> None:
    await check_tune(random.Random(seed))


@virtual
async def test_a_pair_that_loses_answers_already_is_told_and_not_tuned() -> None:
    pair = Pair(random.Random(1))
    pair.carries = 300
    with pytest.raises(NoReply, match="Look at termination"):
        await pair.tuned([], 60)
    pair = Pair(random.Random(1))
    pair.drives[99] = "mks"
    with pytest.raises(NoReply, match="Nobody answers at address 99"):
        await pair.tuned([], 60)


def test_what_is_kept_has_a_margin() -> None:
    line = LineSettings(baudrate=9600)
    tuned = Tuned(line=line, replies={1: 0.002, 2: 0.04}, shortest=line.shortest_silence)
    assert tuned.silence == pytest.approx(MARGIN * line.shortest_silence, abs=1e-6)
    assert tuned.reply_timeout(1) == 0.03
    assert tuned.reply_timeout(2) == 0.16
    assert Tuned(line=line, shortest=line.t35).silence is None
