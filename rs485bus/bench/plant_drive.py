"""One drive of a plant file, opened without the others; and what was found out about it, written into the file."""

from __future__ import annotations

import datetime
from collections.abc import AsyncIterator, Iterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomlkit

from rs485bus.bus.bus import Bus
from rs485bus.bus.opening import Opening, open_bus
from rs485bus.plant.building import build
from rs485bus.plant.entries import AxisEntry
from rs485bus.plant.family import Family
from rs485bus.plant.file import PlantFile
from rs485bus.plant.options import typed_options
from rs485bus.plant.reading import read_file
from rs485bus.transport.interface import Transport


@dataclass(frozen=True, slots=True)
class PlantDrive:
    """A drive of a plant."""

    file: PlantFile
    bus: str
    address: int
    axes: Mapping[str, AxisEntry]
    """Its axes, by name."""
    line: Transport | None = None
    """The virtual line that it is on instead of a port."""

    @property
    def family(self) -> Family:
        """Its family."""
        return next(iter(self.axes.values())).facts

    @property
    def title(self) -> str:
        """What people call it: "MKS SERVO 5 (x)"."""
        return f"{self.family.title} {self.address} ({', '.join(self.axes)})"

    @asynccontextmanager
    async def opened(self, options: Mapping[str, Any], bare: bool = False) -> AsyncIterator[Any]:
        """Open it alone: its facade with some options more, as they stand in a plant file; or bare, as a `Unit`."""
        async with self.on_bus() as bus:
            yield bus.unit(self.address) if bare else self.facade(bus, options)

    def on_bus(self) -> Opening:
        """Open its bus, without its facade."""
        entry = self.file.buses[self.bus]
        return open_bus(entry.port, **entry.opening) if self.line is None else open_bus(self.line)

    def facade(self, bus: Bus, options: Mapping[str, Any]) -> Any:
        """Its facade on an open bus."""
        more = typed_options(self.family.facade(), options)
        axes = {name: axis.model_copy(update={"options": {**axis.options, **more}}) for name, axis in self.axes.items()}
        alone = self.file.model_copy(update={"axes": axes, "groups": {}, "vehicle": None})
        return build(alone, {self.bus: bus}).facades[self.bus, self.address]


def drives_of(file: PlantFile, lines: Mapping[str, Transport], names: list[str] | None = None) -> Iterator[PlantDrive]:
    """The drives of a plant, or those of some axes."""
    for bus in file.buses:
        for address, sides in file.drives(bus):
            axes = dict(sides.values())
            if not names or any(name in axes for name in names):
                yield PlantDrive(file, bus, address, axes, lines.get(bus))


def write_found(path: Path, tables: Mapping[tuple[str, str], Mapping[str, Any]], what: str) -> None:
    """Write what was found out into the tables of a plant file, each value with a comment. All else stays as it is.

    Args:
        path: the file.
        tables: by section and name, ("axes", "x"), what to set; a value and its comment may be a pair.
        what: how it was found: "verified".
    """
    document: Any = tomlkit.parse(read_file(path))
    today = datetime.datetime.now().astimezone().date().isoformat()
    for (section, name), values in tables.items():
        table = document[section][name]
        for key, value in values.items():
            said, comment = value if isinstance(value, tuple) else (value, "")
            item = tomlkit.item(said)
            item.comment(f"{what} {today}{': ' + comment if comment else ''}")
            table[key] = item
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
