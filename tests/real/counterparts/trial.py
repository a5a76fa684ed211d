"""One slave, tried to the end."""

from __future__ import annotations

from pathlib import Path

from rs485bus import BusConfig, open_bus
from tests.real.counterparts.exercise import Result, exercise
from tests.real.counterparts.slaves import Missing, Slave, reached

_CONFIG = BusConfig(reply_timeout=0.3, retries=2, reopen_min=0.05, reopen_max=0.5)


async def trial(slave: Slave, folder: Path, requests: int, restarts: int) -> Result:
    """Open a bus on a slave and exercise it. Raises `Missing` where something is not installed."""
    async with reached(slave, folder) as (url, program):
        try:
            opening = open_bus(url, baudrate=115200, config=_CONFIG)
        except ValueError as error:
            raise Missing(str(error)) from error
        async with opening as bus:
            return await exercise(bus, slave.functions, requests, restarts, program.restart)
