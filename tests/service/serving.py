"""A plant of virtual drives, served in this event loop."""

from __future__ import annotations

import asyncio
import contextlib
import uuid
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from rs485bus import remote
from rs485bus.plant import Plant
from rs485bus.service.broker import Broker
from rs485bus.service.ledger import Ledger
from rs485bus.service.service import Service

CELL = """
name = "{name}"

[buses.main]
port = "{port}"
baudrate = 115200

[axes.x]
bus = "main"
family = "mks"
address = 1
rpm = 1000
acceleration = 10000

[axes.y]
bus = "main"
family = "mks"
address = 2
rpm = 1000
acceleration = 10000

[groups.xy]
axes = ["x", "y"]
"""


def connect(url: str, **options: Any) -> Any:
    """A client with a lease and verbs that outlast the pauses of a busy machine."""
    return remote.connect(url, **{"lease": 10.0, "life": 20.0, **options})


def unlike_any_other() -> str:
    """A name of a plant: tests that run side by side may share a broker."""
    return f"cell-{uuid.uuid4().hex[:8]}"


@contextlib.asynccontextmanager
async def serving(
    folder: Path, broker: str | Broker, text: str = CELL, name: str = "", **options: Any
) -> AsyncIterator[tuple[Plant, Service]]:
    """A plant of virtual drives, and the service that serves it."""
    name = name or unlike_any_other()
    file = folder / f"{name}.toml"
    file.write_text(text.format(name=name, port="/dev/null"))
    ledger = await asyncio.to_thread(Ledger, folder / f"{name}.sqlite")  # a disk may be slow
    try:
        async with Plant.load(file, sim=True) as plant:
            service = Service(plant, broker if isinstance(broker, Broker) else Broker.at(broker), ledger, **options)
            running = asyncio.create_task(service.run())
            try:
                ready = asyncio.create_task(service.online.wait())
                await asyncio.wait((running, ready), return_when=asyncio.FIRST_COMPLETED)
                ready.cancel()
                if running.done():
                    running.result()
                yield plant, service
            finally:
                running.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await running
    finally:
        ledger.close()
