"""The relative moves through this package: `await axis.move_by(...)`, shaft by shaft."""

from __future__ import annotations

import asyncio
import contextlib

from rs485bus import MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.errors import BusError
from rs485bus.motion.axis import Axis
from rs485bus.sim.campaigns.moves.plant import SHAFTS, Ledger, Plant, Tally, ways

_RPM = 600.0
_WHEEL_RPM = 200.0
_TRIES = 20


async def move(plant: Plant, moves: int, seed: int, tally: Tally) -> None:
    """Send each shaft so many times, all of them at once."""
    async with open_bus(plant.line) as bus:
        base = Zlac8015d(bus, 5, rpm=_WHEEL_RPM, acceleration=2000.0)
        axes: list[Axis] = [
            *(MksServo(bus, at, rpm=_RPM, acceleration=20_000.0) for at in (1, 2)),
            *(TlrStepper(bus, at, rpm=_RPM, acceleration=20_000.0) for at in (3, 4)),
            base.left,
            base.right,
        ]
        await asyncio.gather(*(_use(*each, plant, moves, seed, tally) for each in zip(SHAFTS, axes, strict=True)))


async def _use(name: str, axis: Axis, plant: Plant, moves: int, seed: int, tally: Tally) -> None:
    now = asyncio.get_running_loop().time
    await _ready(axis)
    zero = plant.turns(name, now()) - await _where(axis)
    ledger = Ledger(tally, lambda: plant.turns(name, now()) - zero)
    for way in ways(name, moves, seed):
        try:
            await axis.move_by(way)
        except BusError as error:
            ledger.failed(error)
            await _ready(axis)
            ledger.told(await _where(axis))
        else:
            ledger.acknowledged(way)
    ledger.close()


async def _ready(axis: Axis) -> None:
    for _ in range(_TRIES):
        with contextlib.suppress(BusError):
            await axis.stop()
            await axis.enable()
            return


async def _where(axis: Axis) -> float:
    for _ in range(_TRIES):
        with contextlib.suppress(BusError):
            return await axis.position()
    raise RuntimeError("the axis cannot be asked where it is")
