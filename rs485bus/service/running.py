"""From a plant file to a plant that is served."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from pathlib import Path

from rs485bus.plant import Plant
from rs485bus.service.broker import Broker
from rs485bus.service.ledger import Ledger
from rs485bus.service.service import Service
from rs485bus.service.topics import PREFIX, level


async def serve_plant(
    file: str | os.PathLike[str],
    broker: Broker,
    *,
    prefix: str = PREFIX,
    ledger: str | os.PathLike[str] | None = None,
    rate: float = 5.0,
    home_assistant: bool = False,
    sim: bool = False,
    online: Callable[[str], None] = lambda name: None,
) -> None:
    """Open a plant and serve it until cancelled.

    Args:
        file: the plant file.
        broker: where it is served.
        prefix: what the topics begin with.
        ledger: the file in which requests are remembered; None for one in the state directory of the user.
        rate: how often the state of what moves is published, in Hz.
        home_assistant: have Home Assistant find the states and stops.
        sim: use virtual drives.
        online: told the plant's name once it is served for the first time.

    Raises:
        PlantFileError, PortError: the plant cannot be opened.
        BrokerError: the broker cannot be reached at first, or refuses; or the plant is served already.
        BusError: another service of this plant runs on this computer, or nothing can be remembered.
    """
    plant = Plant.load(file, sim=sim)
    remembered = Ledger(_usual_place(plant.name) if ledger is None else os.fspath(ledger))
    try:
        async with plant:
            service = Service(plant, broker, remembered, prefix=prefix, rate=rate, home_assistant=home_assistant)
            telling = asyncio.create_task(_tell(service, plant.name, online))
            try:
                await service.run()
            finally:
                telling.cancel()
    finally:
        remembered.close()


async def _tell(service: Service, name: str, online: Callable[[str], None]) -> None:
    await service.online.wait()
    online(name)


def _usual_place(plant: str) -> Path:
    """Where a service that systemd starts keeps its state, else where a user's programs do."""
    systemd = os.environ.get("STATE_DIRECTORY")
    if systemd:
        folder = Path(systemd.split(":")[0])
    else:
        folder = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "rs485bus"
    return folder / f"{level('the name', plant)}.sqlite"
