"""rs485bus, with serialx instead of pyserial-asyncio."""

from __future__ import annotations

from benchmarks.clients import ours
from rs485bus import BusConfig, open_bus


class Client(ours.Client):
    async def open(self, port: str, baudrate: int, timeout: float) -> None:
        config = BusConfig(reply_timeout=timeout)
        self._bus = await open_bus(port, baudrate=baudrate, config=config, backend="serialx")
