"""A pair of wires of our own, in virtual time: bytes with times, collisions, echoes, and an adapter that batches.

Nothing here comes from `rs485bus.sim`. Who tests with it sees the bus through another pair of eyes.
"""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

EPSILON = 1e-7


def _shifted(value: int) -> int:
    for _ in range(8):
        value = (value >> 1) ^ 0xA001 if value & 1 else value >> 1
    return value


_TABLE = [_shifted(byte) for byte in range(256)]


def crc16(data: bytes) -> bytes:
    """The CRC of Modbus RTU, low byte first (Modbus over Serial Line V1.02, 6.2.2)."""
    value = 0xFFFF
    for byte in data:
        value = (value >> 8) ^ _TABLE[(value ^ byte) & 0xFF]
    return value.to_bytes(2, "little")


def framed(body: bytes) -> bytes:
    """A body with its CRC."""
    return body + crc16(body)


@dataclass(eq=False, slots=True)
class Sent:
    """A frame that the master sent."""

    number: int
    frame: bytes
    start: float
    end: float
    heard: list[int] = field(default_factory=list)
    """The addresses of the slaves that understood it."""


@dataclass(slots=True)
class Reply:
    """What a slave says to a frame: bytes, seconds of delay, and how they arrive."""

    data: bytes
    delay: float = 0.002
    split: int = 0
    """The first so many bytes arrive as a piece of their own."""


class Station(Protocol):
    """What hangs on the pair."""

    address: int
    by_silence: bool
    """It knows the end of a frame by t3.5 of silence. Others find frames in any stream."""

    def hear(self, sent: Sent, now: float) -> list[Reply]:
        """It understood a frame."""


class Cable:
    """The pair.

    Args:
        character: seconds a byte takes.
        t35: seconds of silence between frames.
        stations: what hangs on it.
        echo: the adapter returns what is sent; "damaged" without its first byte, "split" in two pieces.
        latency: the adapter hands over what it received every so many seconds; 0 for at once.
        gateway: the other side frames by itself, queues requests, and may reorder replies.
    """

    def __init__(
        self,
        character: float,
        t35: float,
        stations: list[Station],
        *,
        echo: str = "",
        latency: float = 0.0,
        gateway: bool = False,
        latest: float = 0.5,
    ) -> None:
        self.latest = latest
        """Seconds after the end of a request beyond which nobody answers it any more."""
        self.character, self.t35 = character, t35
        self.stations = stations
        self.echo, self.latency, self.gateway = echo, latency, gateway
        self.sent: list[Sent] = []
        self.handed: deque[tuple[float, bytes]] = deque()
        self.quiet_since = float("-inf")
        """When the last byte was handed to the master, or its own last frame ended."""
        self.connected = True
        self._events: list[tuple[float, int, Callable[[float], None]]] = []
        self._number = itertools.count()
        self._bursts: deque[tuple[float, float, object]] = deque(maxlen=256)
        self._slave_until = float("-inf")
        self._ready: list[tuple[float, int, bytes]] = []

    @property
    def next_at(self) -> float:
        """When something happens next."""
        ready = self._ready[0][0] if self._ready else float("inf")
        return min(ready, self._events[0][0] if self._events else float("inf"))

    def at(self, when: float, happen: Callable[[float], None]) -> None:
        """Have something happen."""
        heapq.heappush(self._events, (when, next(self._number), happen))

    def advance(self, now: float) -> list[bytes]:
        """Let happen what is due; return what the master's port hands over."""
        while self._events and self._events[0][0] <= now + EPSILON:
            when, _, happen = heapq.heappop(self._events)
            happen(when)
        pieces: list[bytes] = []
        while self._ready and self._ready[0][0] <= now + EPSILON:
            pieces.append(heapq.heappop(self._ready)[2])
        return pieces

    def transmit(self, frame: bytes, now: float) -> Sent:
        """The master sends."""
        start = max(now, self.sent[-1].end if self.sent else now)
        sent = Sent(len(self.sent), frame, start, start + len(frame) * self.character)
        self.sent.append(sent)
        if not self.connected:
            return sent
        self._bursts.append((sent.start, sent.end, sent))
        if self.echo:
            data = frame[1:] if self.echo == "damaged" else frame
            if self.echo == "split":
                self._hand(data[:3], start + 3 * self.character)
                data = data[3:]
            self._hand(data, sent.end)
        self.at(sent.end + (0.002 if self.gateway else self.t35), lambda now: self._complete(sent, now))
        return sent

    def noise(self, data: bytes, now: float) -> None:
        """Somebody else's bytes, from now on."""
        end = now + len(data) * self.character
        self._bursts.append((now, end, None))
        self._hand(data, end)

    def unplug(self) -> None:
        """Nothing arrives any more, in either direction."""
        self.connected = False
        self._ready.clear()

    def plug(self) -> None:
        """The port is there again."""
        self.connected = True

    def _complete(self, sent: Sent, now: float) -> None:
        if not self.connected and not self.gateway:
            return
        for station in self.stations:
            if sent.frame[0] not in (0, station.address):
                continue
            if not self.gateway and self._disturbed(sent, self.t35 * 0.97 if station.by_silence else 0.0):
                continue
            sent.heard.append(station.address)
            for reply in station.hear(sent, now):
                self._answer(reply, sent, now)

    def _disturbed(self, sent: Sent, around: float) -> bool:
        return any(
            other is not sent and end > sent.start - around + EPSILON and start < sent.end + around - EPSILON
            for start, end, other in self._bursts
        )

    def _answer(self, reply: Reply, sent: Sent, now: float) -> None:
        start = now + reply.delay
        if not self.gateway:
            start = max(start, self._slave_until + self.t35)
        length = len(reply.data) * self.character
        if start + length + self.latency > sent.end + self.latest:
            return
        self._slave_until = max(self._slave_until, start + length)
        self.at(start, lambda now: self._begin(reply, now))

    def _begin(self, reply: Reply, now: float) -> None:
        end = now + len(reply.data) * self.character
        token = object()
        self._bursts.append((now, end, token))
        if reply.split:
            self.at(now + reply.split * self.character, lambda at: self._part(reply, now, end, token, 0, reply.split))
        self.at(end, lambda at: self._part(reply, now, end, token, reply.split, len(reply.data)))

    def _part(self, reply: Reply, start: float, end: float, token: object, first: int, last: int) -> None:
        data = reply.data[first:last]
        if not self.gateway and any(
            other is not token and until > start + EPSILON and begun < end - EPSILON
            for begun, until, other in self._bursts
        ):
            data = bytes(byte ^ 0x55 for byte in data)
        self._hand(data, start + last * self.character)

    def _hand(self, data: bytes, when: float) -> None:
        if not data:
            return
        if self.latency:
            when = (int(when / self.latency) + 1) * self.latency
        self.at(when, lambda now: self._ready_now(data, now))

    def _ready_now(self, data: bytes, now: float) -> None:
        if self.connected:
            heapq.heappush(self._ready, (now, next(self._number), data))
