"""Axes on virtual drives, on a virtual clock."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any, ParamSpec

import anyio

from rs485bus import BusConfig, MksServo, open_bus
from rs485bus.bus.bus import Bus
from rs485bus.bus.record import Record
from rs485bus.motion.move import Move, MoveState
from rs485bus.sim import SimMks, VirtualClockLoop, VirtualLine
from rs485bus.wire.registers import Block, Register

P = ParamSpec("P")


def on_virtual_clock(test: Callable[P, Coroutine[Any, Any, None]]) -> Callable[P, None]:
    """Run an async test on a loop whose time jumps."""

    @functools.wraps(test)
    def run(*args: P.args, **kwargs: P.kwargs) -> None:
        with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
            runner.run(test(*args, **kwargs))

    return run


class FlakyMks(SimMks):
    """A drive to which things happen with its next request of a kind, once each."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._deaf: list[int] = []
        self._mute: list[int] = []
        self._instead: dict[int, Callable[[float], None]] = {}

    def lose_request(self, what: Register[Any] | Block, times: int = 1) -> None:
        """It never sees the next such request."""
        self._deaf += times * [what.address]

    def lose_reply(self, what: Register[Any] | Block, times: int = 1) -> None:
        """It does what the next such request says, and its reply is lost."""
        self._mute += times * [what.address]

    def lose_nothing(self) -> None:
        """No request is lost any more."""
        self._deaf.clear()

    def instead(self, what: Register[Any] | Block, happen: Callable[[float], None]) -> None:
        """Something else happens when the next such request comes, which it never sees."""
        self._instead[what.address] = happen

    def receive(self, frame: bytes, now: float) -> bytes | None:
        register = int.from_bytes(frame[2:4], "big")
        if frame[0] != self.address:
            return super().receive(frame, now)
        if register in self._instead:
            self._instead.pop(register)(now)
            return None
        if register in self._deaf:
            self._deaf.remove(register)
            return None
        reply = super().receive(frame, now)
        if register in self._mute:
            self._mute.remove(register)
            return None
        return reply


class Bench:
    """A bus with one drive on it, or several."""

    def __init__(self, bus: Bus, line: VirtualLine, sims: tuple[SimMks, ...], options: dict[str, Any]) -> None:
        self.bus = bus
        self.line = line
        self.axes = [MksServo(bus, sim.address, model=sim.model, **options) for sim in sims]
        self.sims = sims
        self.records: list[Record] = []
        bus.subscribe(self.records.append)

    @property
    def axis(self) -> MksServo:
        return self.axes[0]

    @property
    def sim(self) -> SimMks:
        return self.sims[0]

    @property
    def shaft(self) -> float:
        """Where the shaft is, in turns."""
        return self.sim.shaft(self.bus.now())

    def sent(self, what: Register[Any] | Block) -> list[bytes]:
        """The requests that went out so far about one thing."""
        head = what.address.to_bytes(2, "big")
        return [record.request for record in self.records if record.request[2:4] == head]

    async def bus_is_alive(self) -> None:
        """Everybody still answers."""
        for axis in self.axes:
            await axis.version()
        assert self.line.pair.early_frames == 0


@asynccontextmanager
async def bench(
    *sims: SimMks, baudrate: int = 115200, config: BusConfig | None = None, enable: bool = True, **options: Any
) -> AsyncIterator[Bench]:
    """A bus with these drives on it, each with an enabled axis."""
    line = VirtualLine(*sims, baudrate=baudrate)
    async with open_bus(line, config=config or BusConfig()) as bus:
        on = Bench(bus, line, sims, options)
        if enable:
            for axis in on.axes:
                await axis.enable()
        yield on


async def under_way(move: Move, seconds: float) -> None:
    """Let a move be under way for so long."""
    await anyio.sleep(seconds)
    assert move.state is MoveState.MOVING
