"""A plant file as it is read: pure data, checked as a whole. It opens nothing.

name = "cell"

[buses.main]
port = "/dev/ttyUSB0"
baudrate = 115200

[axes.x]
bus = "main"
family = "mks"
address = 1
units_per_turn = 8.0
limits = [0.0, 120.0]
watchdog = 1.0

[groups.xy]
axes = ["x", "y"]

[vehicle]
left = "left"
right = "right"
wheel_radius = 0.085
track = 0.42
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from rs485bus.bus.config import BusConfig
from rs485bus.plant.families import Family, families

_ENTRY = ConfigDict(extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True)


class BusEntry(BaseModel):
    """One pair: `[buses.NAME]`. What else stands in its table is given to `BusConfig`."""

    model_config = _ENTRY

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

    model_config = _ENTRY

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

    model_config = _ENTRY

    axes: tuple[str, ...]


class VehicleEntry(BaseModel):
    """A vehicle on the two wheels of one ZLAC8015D: `[vehicle]`."""

    model_config = _ENTRY

    left: str
    right: str
    """The axes that are its wheels."""
    wheel_radius: float
    """Metres."""
    track: float
    """Metres between the wheels."""
    acceleration: float | None = None
    """m/s² of a wheel; None for the wheels' own."""


class PlantFile(BaseModel):
    """A plant file, checked: every name in it means something."""

    model_config = _ENTRY

    name: str
    buses: dict[str, BusEntry]
    axes: dict[str, AxisEntry]
    groups: dict[str, GroupEntry] = Field(default_factory=dict)
    vehicle: VehicleEntry | None = None
    path: Path | None = Field(default=None, exclude=True)
    """Where it was read."""
    text: str = Field(default="", exclude=True)
    """As it stands there."""

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> PlantFile:
        """Read a plant file.

        Raises:
            PlantFileError: it cannot be read, or has mistakes; each is told with its line and field, and what to do.
        """
        from rs485bus.plant.reading import read_file

        return read_file(Path(path))

    @classmethod
    def loads(cls, text: str, path: str | os.PathLike[str] = "plant.toml") -> PlantFile:
        """Read the text of a plant file. `path` is what messages call it. Raises as `load`."""
        from rs485bus.plant.reading import read_text

        return read_text(text, Path(path))

    def drives(self, bus: str) -> Iterator[tuple[int, dict[str | None, tuple[str, AxisEntry]]]]:
        """The drives on a bus: of each its address, and its axes with their names, by side."""
        found: dict[int, dict[str | None, tuple[str, AxisEntry]]] = {}
        for name, axis in self.axes.items():
            if axis.bus == bus:
                found.setdefault(axis.address, {})[axis.side] = (name, axis)
        yield from found.items()

    @staticmethod
    def json_schema() -> Mapping[str, Any]:
        """The JSON schema (draft 2020-12) of plant files, for editors, with the options of each known family."""
        from rs485bus.plant.schema import plant_schema

        return plant_schema()
