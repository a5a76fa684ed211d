"""The tables of a plant file: a pair, an axis, a group, a vehicle. Pure data."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from rs485bus.bus.config import BusConfig
from rs485bus.plant.families import families
from rs485bus.plant.family import Family

ENTRY = ConfigDict(extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True)
"""Nothing else stands in a table, and nothing is changed or converted."""


class BusEntry(BaseModel):
    """One pair: `[buses.NAME]`. What else stands in its table is given to `BusConfig`."""

    model_config = ENTRY

    port: str
    baudrate: int | None = None
    """bit/s; a gateway needs none."""
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    backend: Literal["pyserial", "serialx"] | None = None
    native: bool = False
    config: BusConfig = Field(default_factory=BusConfig, exclude=True)

    @property
    def opening(self) -> dict[str, Any]:
        """The keywords of `open_bus`."""
        names = ("baudrate", "parity", "stopbits", "backend", "native", "config")
        return {name: getattr(self, name) for name in names}


class AxisEntry(BaseModel):
    """One axis: `[axes.NAME]`. What else stands in its table is given to the family's facade."""

    model_config = ENTRY

    bus: str
    """The name of its bus. It may be left out in a file with one bus."""
    family: str
    address: int
    side: str | None = None
    """Which of the axes at the address it is, where there are several: "left" or "right" of a ZLAC8015D."""
    unit: str = "turns"
    """What positions are called: "mm"."""
    watchdog: float | None = None
    """Seconds without a frame after which the drive stops by itself, while the plant is open; None for unguarded."""
    reply_timeout: float | None = None
    """Seconds for which its drive's answers are waited for; None for what the bus is set to."""
    options: dict[str, Any] = Field(default_factory=dict, exclude=True)
    """What the facade is given."""

    @property
    def facts(self) -> Family:
        """Its family."""
        return families()[self.family]


class GroupEntry(BaseModel):
    """Axes that move together: `[groups.NAME]`."""

    model_config = ENTRY

    axes: tuple[str, ...]


class VehicleEntry(BaseModel):
    """A vehicle on the two wheels of one ZLAC8015D: `[vehicle]`."""

    model_config = ENTRY

    left: str
    right: str
    """The axes that are its wheels."""
    wheel_radius: float
    """Metres."""
    track: float
    """Metres between the wheels."""
    acceleration: float | None = None
    """m/s² of a wheel; None for the wheels' own."""
