"""What every transport does, and what it is told."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

from rs485bus.transport.alarm import Alarm
from rs485bus.wire.timing import LineSettings


class Sink(Protocol):
    """Who is told what the transport receives.

    A bus has `answered(frame, asked)`, too: an RTU frame came in that answers what was sent by `ask(..., asked)`.
    """

    def received(self, data: bytes) -> None:
        """Bytes came in."""

    def lost(self, error: Exception | None) -> None:
        """The port is gone. Told once after each `open`, unless it was closed."""


class Transport(Protocol):
    """A way to one pair of wires. Everything is called in the event loop's thread.

    What a transport may have besides: `receive_latency`, seconds for which received bytes are held back; `numbered`,
    with `ask(data, asked)` instead of `write(data)`, where an answer tells what it answers, and `native` where that is
    certain; `readers()`, which programs read along (called in a thread); and for messages `diagnosis`, `silent_hint`
    and `hang_up_hint`.
    """

    name: str
    """What people call it: the port's path, say."""
    line: LineSettings
    gateway: bool
    """The other end does the framing, and replies may overtake each other."""

    async def open(self, sink: Sink) -> None:
        """Open it; it may have been open before. Raises `PortError`."""

    def write(self, data: bytes) -> None:
        """Send at once, without waiting."""

    @property
    def unsent(self) -> int:
        """Bytes written that have not left this machine."""

    def abort(self) -> None:
        """Drop what is unsent and the connection with it; `lost` is told."""

    async def close(self) -> None:
        """Close it without draining; `lost` is not told."""

    def alarm(self, callback: Callable[[], None]) -> Alarm:
        """What wakes the bus, on the clock that the transport lives by."""


class SinkProtocol(asyncio.Protocol):
    """Hands what an asyncio transport receives to a sink."""

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self._closed: asyncio.Future[None] | None = None

    def data_received(self, data: bytes) -> None:
        self._sink.received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._closed is None:
            self._sink.lost(exc)
        elif not self._closed.done():
            self._closed.set_result(None)

    async def close(self, transport: asyncio.WriteTransport) -> None:
        """Drop the connection without draining it, and without telling the sink."""
        if not transport.is_closing():
            self._closed = asyncio.get_running_loop().create_future()
            transport.abort()
            await self._closed
