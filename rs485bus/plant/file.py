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
from typing import Any

from pydantic import BaseModel, Field

from rs485bus.plant.entries import ENTRY, AxisEntry, BusEntry, GroupEntry, VehicleEntry
from rs485bus.plant.reading import read_file, read_text
from rs485bus.plant.schema import plant_schema


class PlantFile(BaseModel):
    """A plant file, checked: every name in it means something."""

    model_config = ENTRY

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
        return cls.loads(read_file(Path(path)), path)

    @classmethod
    def loads(cls, text: str, path: str | os.PathLike[str] = "plant.toml") -> PlantFile:
        """Read the text of a plant file. `path` is what messages call it. Raises as `load`."""
        return cls(**read_text(text, Path(path)), path=Path(path), text=text)

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
        return plant_schema()
