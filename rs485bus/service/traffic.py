"""What happens on the pairs, for who reads along: the lines of a capture, as long as somebody asks for them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from rs485bus.bus.bus import Bus
from rs485bus.bus.capture_lines import entry_line, exchange_of
from rs485bus.bus.record import Record
from rs485bus.service.clock import Clock
from rs485bus.service.schema import TrafficReport
from rs485bus.service.topics import Topics

_EVERY = 0.1
"""Seconds between two messages."""
_BACKLOG = 2_000
"""Exchanges of one bus that wait to be told; of more the newest are lost."""


class Traffic:
    """Of one plant.

    Args:
        buses: by name.
        clock: the service's.
        topics: the plant's.
        publish: publishes a message.
    """

    def __init__(self, buses: Mapping[str, Bus], clock: Clock, topics: Topics, publish: Callable[..., None]) -> None:
        self._clock = clock
        self._topics = topics
        self._publish = publish
        self._buses = buses
        self._wanted: dict[str, float] = {}
        """Until when each client reads along."""
        self._pairs: dict[str, _Pair] = {}

    def want(self, client: str, seconds: float) -> list[str]:
        """A client reads along for so many seconds. Returns the names of the buses."""
        self._wanted[client] = self._clock.now() + seconds
        if not self._pairs:
            since = asyncio.get_running_loop().time() - self._clock.now()
            self._pairs = {name: _Pair(bus, since) for name, bus in self._buses.items()}
        return list(self._buses)

    async def run(self) -> None:
        """Tell, until cancelled."""
        try:
            while True:
                await asyncio.sleep(_EVERY)
                for name, pair in self._pairs.items():
                    if pair.lines:
                        self._publish(self._topics.traffic(name), pair.take())
                now = self._clock.now()
                self._wanted = {client: until for client, until in self._wanted.items() if until > now}
                if not self._wanted:
                    self._leave()
        finally:
            self._leave()

    def _leave(self) -> None:
        for pair in self._pairs.values():
            pair.leave()
        self._pairs = {}


class _Pair:
    """One bus that is read along.

    Args:
        bus: the bus.
        since: how far its clock is ahead of the service's.
    """

    def __init__(self, bus: Bus, since: float) -> None:
        self.lines: list[str] = []
        self._since = since
        self._before = 0
        self._count = 0
        self.leave = bus.subscribe(self._see)

    def take(self) -> TrafficReport:
        """What has happened since this was asked for last."""
        report = TrafficReport(before=self._before, lines=self.lines)
        self._before, self.lines = self._count, []
        return report

    def _see(self, record: Record) -> None:
        self._count += 1
        if len(self.lines) < _BACKLOG:
            self.lines.append(entry_line(exchange_of(record, self._since)).rstrip("\n"))
