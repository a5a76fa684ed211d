"""rs485bus, with the shortest silence that it takes: 1.5 characters, where libraries that keep no t3.5 leave none."""

from __future__ import annotations

from benchmarks.clients import ours
from rs485bus import BusConfig, open_bus
from rs485bus.wire.timing import LineSettings


class Client(ours.Client):
    async def open(self, port: str, baudrate: int, timeout: float) -> None:
        silence = LineSettings(baudrate=baudrate).shortest_silence
        config = BusConfig(reply_timeout=timeout, silence=silence)
        self._bus = await open_bus(port, baudrate=baudrate, config=config)
