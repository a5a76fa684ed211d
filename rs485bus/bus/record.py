"""One record a transaction, counters, and the flight recorder. Pure."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from rs485bus.bus.schedule.job import Urgency
from rs485bus.wire.timing import LineSettings

_log = logging.getLogger("rs485bus")

FLIGHT_RECORDER = 256
"""How many transactions the flight recorder keeps."""
_LATENCIES = 1024


class Record(NamedTuple):
    """One attempt on the wire. Times are seconds on the bus' clock (the event loop's)."""

    address: int
    urgency: Urgency
    attempt: int
    """1 for the first time the request was sent."""
    request: bytes
    reply: bytes
    """The frame that ended it; empty if none did."""
    skipped: int
    """Bytes received during it that belonged to nothing waited for."""
    queued_at: float
    sent_at: float
    first_byte_at: float | None
    ended_at: float
    outcome: str
    """"reply", "refused", "no reply", "cut" (a stop did not wait for the rest of its time), "lost", "broadcast", or
    "sent" (a device that does not answer such a request)."""

    @property
    def latency(self) -> float:
        """Seconds from the start of sending to the end."""
        return self.ended_at - self.sent_at

    def turnaround(self, line: LineSettings) -> float:
        """Seconds that the device took before it began to answer."""
        return max(0.0, self.latency - line.airtime(len(self.request) + len(self.reply)))

    def __str__(self) -> str:
        took = 1000 * self.latency
        reply = self.reply.hex(" ").upper() or "-"
        sent = self.request.hex(" ").upper()
        return f"{self.sent_at:.4f} unit {self.address} #{self.attempt} {sent} -> {reply} {self.outcome} {took:.1f} ms"


@dataclass(slots=True)
class UnitStats:
    """What one unit was asked and how it answered. `latencies` are those of the latest replies, in seconds."""

    requests: int = 0
    replies: int = 0
    retries: int = 0
    timeouts: int = 0
    refusals: int = 0
    crc_errors: int = 0
    stray_bytes: int = 0
    late_replies: int = 0
    waits: dict[str, float] = field(default_factory=dict)
    """Seconds for which the begin of a reply is waited for before others are served, for "read", "write" and "feed", as
    its answers have taught. What is not there yet waits for the reply timeout."""
    latencies: deque[float] = field(default_factory=lambda: deque(maxlen=_LATENCIES), repr=False)

    def latency(self, quantile: float) -> float:
        """The latency, in seconds, that a share of the latest replies did not exceed: 0 (min), 0.5, 0.99, 1 (max)."""
        if not self.latencies:
            return 0.0
        ordered = sorted(self.latencies)
        return ordered[min(len(ordered) - 1, round(quantile * (len(ordered) - 1)))]


@dataclass(slots=True)
class BusStats:
    """What happened on the bus since it was opened."""

    units: dict[int, UnitStats] = field(default_factory=dict)
    transactions: int = 0
    airtime: float = 0.0
    """Seconds in which bytes were on the pair."""
    elapsed: float = 0.0
    """Seconds since the bus was opened."""
    silence: float = 0.0
    """Seconds of silence kept between frames."""
    echo: bool | None = None
    """Whether the adapter returns what is sent; None while that is not known."""

    @property
    def answers(self) -> int:
        """How often any unit has answered."""
        return sum(unit.replies + unit.refusals for unit in self.units.values())

    @property
    def load(self) -> float:
        """The share of all time in which bytes were on the pair."""
        return self.airtime / self.elapsed if self.elapsed else 0.0


Observer = Callable[[Record], None]


class Journal:
    """Takes the records and hands them on."""

    __slots__ = ("_observers", "flight", "missed", "stats")

    def __init__(self) -> None:
        self.flight: deque[Record] = deque(maxlen=FLIGHT_RECORDER)
        self.stats = BusStats()
        self.missed: Callable[[], None] = lambda: None
        """Told of each attempt that was not answered, and of what could not be sent on a line that is never quiet."""
        self._observers: tuple[Observer, ...] = ()

    def unit(self, address: int) -> UnitStats:
        stats = self.stats.units.get(address)
        if stats is None:
            stats = self.stats.units[address] = UnitStats()
        return stats

    def add(self, record: Record, crc_errors: int = 0) -> None:
        self.flight.append(record)
        stats, outcome = self.stats, record.outcome
        stats.transactions += 1
        unit = stats.units.get(record.address) or self.unit(record.address)
        unit.stray_bytes += record.skipped
        unit.crc_errors += crc_errors
        if record.attempt == 1:
            unit.requests += 1
        else:
            unit.retries += 1
        if outcome == "reply":
            unit.replies += 1
            unit.latencies.append(record.ended_at - record.sent_at)
        elif outcome == "refused":
            unit.refusals += 1
        elif outcome not in ("broadcast", "sent"):
            unit.timeouts += 1
            self.missed()
        for observer in self._observers:
            try:
                observer(record)
            except Exception:
                _log.exception("an observer of the bus failed")

    def subscribe(self, observer: Observer) -> Callable[[], None]:
        """Call `observer` with every record from now on. Returns what ends that.

        Raises:
            TypeError: it cannot be called.
        """
        if not callable(observer):
            raise TypeError(f"an observer must be a function that takes a record, not {observer!r}")
        self._observers = (*self._observers, observer)

        def unsubscribe() -> None:
            self._observers = tuple(other for other in self._observers if other is not observer)

        return unsubscribe
