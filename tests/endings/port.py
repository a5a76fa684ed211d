"""A transport of our own onto the pair of `cable.py`, under an event loop whose clock is virtual."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rs485bus.errors import PortNotFound
from rs485bus.transport.interface import Sink
from rs485bus.wire.timing import LineSettings
from tests.endings.cable import Cable


class PlainAlarm:
    """The loop's own timer."""

    lead = 0.0

    def __init__(self, callback: Callable[[], None]) -> None:
        self._callback = callback
        self._timer: asyncio.TimerHandle | None = None

    def learn(self, late: float) -> None:
        """Nothing to be learned from a virtual clock."""

    def set(self, when: float, *, likely: bool = True) -> None:
        """Call back then, instead of what was set before."""
        self.close()
        if when < float("inf"):
            self._timer = asyncio.get_running_loop().call_at(when, self._callback)

    def close(self) -> None:
        """Not any more."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class CablePort:
    """The transport. `vanish()` takes the port away, `back()` gives it back."""

    name = "/dev/cable"

    def __init__(self, cable: Cable, line: LineSettings, *, gateway: bool = False) -> None:
        self.cable, self.line, self.gateway = cable, line, gateway
        self.there = True
        self.is_open = False
        self.opened = 0
        self.written: list[tuple[float, bytes]] = []
        self.after_close: list[bytes] = []
        self.closed = False
        self._sink: Sink | None = None
        self._timer: asyncio.TimerHandle | None = None

    async def open(self, sink: Sink) -> None:
        await asyncio.sleep(0.001)
        if not self.there:
            raise PortNotFound("there is no cable: plug it in")
        self._sink, self.is_open = sink, True
        self.cable.plug()
        self.opened += 1
        self.pump()

    def write(self, data: bytes) -> None:
        now = asyncio.get_running_loop().time()
        if self.closed:
            self.after_close.append(data)
            return
        self.written.append((now, data))
        self.cable.transmit(data, now)
        self.pump()

    @property
    def unsent(self) -> int:
        return 0

    def abort(self) -> None:
        self.vanish(stays=True)

    async def close(self) -> None:
        await asyncio.sleep(0)
        self.closed, self.is_open, self._sink = True, False, None

    def alarm(self, callback: Callable[[], None]) -> PlainAlarm:
        return PlainAlarm(callback)

    def vanish(self, *, stays: bool = False) -> None:
        """The connection is gone; the port too, unless it stays."""
        self.there = stays
        if self.is_open and self._sink is not None:
            self.is_open = False
            self.cable.unplug()
            asyncio.get_running_loop().call_soon(self._sink.lost, OSError("gone"))

    def back(self) -> None:
        """It can be opened again."""
        self.there = True

    def pump(self) -> None:
        """Let the pair go on, and hand over what arrived."""
        loop = asyncio.get_running_loop()
        for piece in self.cable.advance(loop.time()):
            if self._sink is not None and self.is_open:
                self._sink.received(piece)
        if self._timer is not None:
            self._timer.cancel()
        self._timer = None
        if self.cable.next_at < float("inf"):
            self._timer = loop.call_at(max(loop.time(), self.cable.next_at), self.pump)
