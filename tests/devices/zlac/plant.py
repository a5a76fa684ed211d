"""A virtual line with one virtual drive, and the facade on it, on a virtual clock."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from rs485bus import Bus, BusConfig, Zlac8015d, open_bus
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.values import ControlWord, Fault
from rs485bus.sim import Noise, SimZlac, VirtualClockLoop, VirtualLine
from rs485bus.sim.device import ILLEGAL_VALUE, Refusal
from rs485bus.wire.registers import Register

P = ParamSpec("P")
T = TypeVar("T")

QUIET = Noise()
CONTROL = "06200E00"


class WatchedZlac(SimZlac):
    """A virtual drive that keeps what it was asked, and loses just the frames it is told to lose."""

    def __init__(self, address: int = 1, **options: Any) -> None:
        super().__init__(address, **options)
        self.asked: list[tuple[float, str]] = []
        """When, and function and data in hexadecimal."""
        self._lost_replies: list[str] = []
        self._lost_requests: list[str] = []
        self._refused: list[str] = []
        self.dead = False
        """It hears nothing."""
        self.deaf_to_stops = False
        """It acknowledges stops and does not do them."""
        self.mute_run_bits = False
        """Its status word says of no wheel that it runs."""
        self.clears_in_position_mode_only = False
        """0x2005 does nothing in other modes."""
        self.ignored = "-"
        """It acknowledges what begins so, and does not do it."""
        self.lasting = Fault(0)
        """Errors of the right wheel that clearing does not clear."""

    def set(self, register: Register[T], value: T) -> None:
        """What it is set to, as if it had been saved."""
        for at, word in enumerate(_words(register.encode(value))):
            self._words[register.address + at] = self.eeprom[register.address + at] = word

    def lose_reply(self, start: str, times: int = 1) -> None:
        """Do the next requests that begin so, but do not answer them."""
        self._lost_replies += [start] * times

    def lose_request(self, start: str, times: int = 1) -> None:
        """Do not hear the next requests that begin so."""
        self._lost_requests += [start] * times

    def refuse(self, start: str) -> None:
        """Answer the next request that begins so with an exception."""
        self._refused.append(start)

    @property
    def all_lost(self) -> bool:
        """Whether everything was lost that was to be lost."""
        return not self._lost_replies and not self._lost_requests

    def value_writes(self, start: str) -> int:
        """How many writes began so."""
        return sum(pdu.startswith(start) for pdu in self.writes())

    async def lost_all(self) -> None:
        """Wait until everything was lost that was to be lost."""
        for _ in range(100_000):
            if self.all_lost:
                return
            await asyncio.sleep(0.001)
        raise AssertionError("it was not asked what it was to lose")

    def _report(self, now: float) -> dict[int, int]:
        words = super()._report(now)
        if self.mute_run_bits:
            words[r.STATUS.address] &= ~0x0101
        return words

    def writes(self, since: int = 0) -> list[str]:
        """The writes it was asked, from a number of requests on."""
        return [pdu for _, pdu in self.asked[since:] if pdu[:2] != "03"]

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        text = pdu.hex().upper()
        if self.dead or _take(self._lost_requests, text):
            return None
        if _take(self._refused, text):
            raise Refusal(ILLEGAL_VALUE)
        self.asked.append((now, text))
        stop = text in (word(ControlWord.EMERGENCY_STOP), "1020880002" + "0400000000")
        if self.clears_in_position_mode_only and not self.mode.is_position and text.startswith("062005"):
            return pdu
        ignored = text.startswith(self.ignored) or (stop and self.deaf_to_stops)
        reply = pdu[:5] if ignored else super().answer(pdu, now, broadcast=broadcast)
        self.right.faults |= self.lasting
        return None if _take(self._lost_replies, text) else reply


def _take(starts: list[str], text: str) -> bool:
    found = next((start for start in starts if text.startswith(start)), None)
    if found is not None:
        starts.remove(found)
    return found is not None


def _words(data: bytes) -> list[int]:
    return [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]


def word(control: ControlWord) -> str:
    """The write of a control word."""
    return f"{CONTROL}{control:02X}"


@dataclass
class Plant:
    """A drive on a line, and its facade."""

    bus: Bus
    base: Zlac8015d
    sim: WatchedZlac
    line: VirtualLine

    @property
    def now(self) -> float:
        return asyncio.get_running_loop().time()

    def shafts(self) -> tuple[float, float]:
        """Where the wheels really are, in turns."""
        left, right = self.sim.shafts(self.now)
        return round(left, 3), round(right, 3)

    def rpm(self) -> tuple[float, float]:
        """How fast they really turn."""
        left, right = self.sim.rpm(self.now)
        return round(left, 1), round(right, 1)

    async def standing_for(self, seconds: float) -> bool:
        """Whether both wheels stand, and go on doing so."""
        before = self.shafts()
        await asyncio.sleep(seconds)
        return self.rpm() == (0, 0) and self.shafts() == before


@asynccontextmanager
async def plant(
    sim: WatchedZlac | None = None,
    *,
    noise: Noise = QUIET,
    seed: int = 0,
    config: BusConfig | None = None,
    enabled: bool = True,
    **options: Any,
) -> AsyncIterator[Plant]:
    """A drive, enabled unless it is not to be."""
    sim = sim or WatchedZlac()
    line = VirtualLine(sim, noise=noise, seed=seed)
    async with open_bus(line, config=config or BusConfig()) as bus:
        base = Zlac8015d(bus, sim.address, **options)
        if enabled:
            await base.enable()
        yield Plant(bus, base, sim, line)


def on_virtual_clock(test: Callable[P, Awaitable[None]]) -> Callable[P, None]:
    """Run a test on an event loop on which nobody waits for real time."""

    @wraps(test)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        async def main() -> None:
            await test(*args, **kwargs)

        with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
            runner.run(main())

    return run
