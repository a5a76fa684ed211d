"""Reading a plant file: TOML, then its tables, then what they say of each other. All mistakes are told at once."""

from __future__ import annotations

import keyword
import re
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from rs485bus.bus.config import BusConfig
from rs485bus.bus.opening import open_bus
from rs485bus.errors import BusError, PlantFileError
from rs485bus.plant.entries import AxisEntry, BusEntry, GroupEntry, VehicleEntry
from rs485bus.plant.families import families
from rs485bus.plant.family import Family
from rs485bus.plant.options import options_of, validated
from rs485bus.plant.problems import Problems, instead

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_RESERVED = frozenset(
    {"axes", "axis", "buses", "groups", "vehicle", "file", "name", "load", "lines", "drive", "watch", "guard"}
) | {
    "emergency_stop",
    "duration",
    "rpm",
    "all",
}
"""Names that a plant or a group uses itself."""
_SECTIONS = ("name", "buses", "axes", "groups", "vehicle")


class _Axis(BaseModel):
    """What every axis' table may hold."""

    model_config = ConfigDict(extra="forbid", strict=True)

    bus: str = ""
    family: str
    address: int
    side: str | None = None
    unit: str = "turns"
    watchdog: float | None = Field(default=None, gt=0)
    reply_timeout: float | None = Field(default=None, ge=0.001, le=10)


class _Vehicle(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    left: str = ""
    right: str = ""
    wheel_radius: float = Field(gt=0, le=5)
    track: float = Field(gt=0, le=50)
    acceleration: float | None = Field(default=None, gt=0)


def read_file(path: Path) -> str:
    """The text of a plant file.

    Raises:
        PlantFileError: it cannot be read.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        raise PlantFileError(
            f"There is no plant file {path}. rs485bus scan PORT --write {path} makes one of the drives that it finds."
        ) from None
    except IsADirectoryError:
        raise PlantFileError(f"{path} is a folder: name a plant file in it.") from None
    except OSError as error:
        raise PlantFileError(f"The plant file {path} cannot be read: {error.strerror}.") from None
    try:
        text = content.decode("utf-8-sig")  # editors on Windows begin with a mark
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        if b"\0" not in content:
            raise PlantFileError(f"{path}, line {line}: this is no UTF-8: save the file as UTF-8.") from None
        raise PlantFileError(f"{path} is no text in UTF-8. If an editor has written it, save it as UTF-8.") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_text(text: str, path: Path) -> dict[str, Any]:
    """The name and the tables of a plant file, checked. `path` is what messages call it.

    Raises:
        PlantFileError: it has mistakes; each is told with its line and field, and what to do.
    """
    problems = Problems(str(path), text)
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        said = str(error).replace("Cannot overwrite a value", "This key was given already")
        raise PlantFileError(
            f"{path} is no TOML: {said}. Texts stand in quotes; a table begins with [axes.x]."
        ) from None
    return _Reader(content, problems).plant(path.stem)


class _Reader:
    """Takes the tables of one file apart."""

    def __init__(self, content: Mapping[str, Any], problems: Problems) -> None:
        self._content = content
        self._problems = problems

    def plant(self, otherwise: str) -> dict[str, Any]:
        """Its parts. It is called `otherwise` if it has no name."""
        name = self._content.get("name", otherwise)
        if not isinstance(name, str) or not name:
            self._problems.add(["name"], f'must be a text in quotes, like name = "cell", not {name!r}')
        for key in self._content.keys() - set(_SECTIONS):
            self._problems.add([key], f"there is no such section{instead(key, _SECTIONS)}")
        buses = {name: bus for name, table in self._tables("buses") if (bus := self._bus(name, table))}
        axes = {name: axis for name, table in self._tables("axes") if (axis := self._axis(name, table))}
        groups = {name: group for name, table in self._tables("groups") if (group := self._group(name, table))}
        for needed, example in (("buses", "[buses.main]"), ("axes", "[axes.x]")):
            if not self._content.get(needed):
                self._problems.add([], f"there are no {needed}; add a table {example}")
        self._check_addresses(axes)
        self._check_ports(buses)
        vehicle = self._vehicle(axes)
        self._problems.check()
        return {"name": name, "buses": buses, "axes": axes, "groups": groups, "vehicle": vehicle}

    def _tables(self, section: str) -> list[tuple[str, dict[str, Any]]]:
        tables = self._content.get(section, {})
        if not isinstance(tables, dict):
            self._problems.add([section], f"must be tables, each with a name: [{section}.main]")
            return []
        found = []
        for name, table in tables.items():
            at = [section, name]
            if not isinstance(table, dict):
                self._problems.add(at, f"must be a table: [{section}.{name}]. Here, {section} is taken for one.")
            elif not _NAME.fullmatch(name) or keyword.iskeyword(name):
                self._problems.add(
                    at, "a name is made of letters, digits and _, begins with a letter, and is no Python word"
                )
            elif name in _RESERVED:
                self._problems.add(at, f'the name "{name}" is used by the plant itself; take another one')
            elif section == "groups" and name in (self._content.get("axes") or {}):
                self._problems.add(at, f'there is an axis "{name}" already; take another name')
            else:
                found.append((name, table))
        return found

    def _bus(self, name: str, table: dict[str, Any]) -> BusEntry | None:
        at = ["buses", name]
        own = {key: value for key, value in table.items() if key in BusEntry.model_fields and key != "config"}
        rest = {key: value for key, value in table.items() if key not in own}
        model = options_of(BusConfig)
        entry = validated(BusEntry, own, at, self._problems)
        known = [key for key in BusEntry.model_fields if key != "config"]
        options = validated(model, rest, at, self._problems, known)
        if not isinstance(entry, BusEntry) or options is None:
            return None
        try:
            entry = entry.model_copy(update={"config": BusConfig(**_given(options))})
            open_bus(entry.port, **entry.opening)
        except (ValueError, TypeError, BusError) as error:
            self._problems.add(blamed(at, table, error), str(error))
            return None
        return entry

    def _axis(self, name: str, table: dict[str, Any]) -> AxisEntry | None:
        at = ["axes", name]
        family = families().get(table["family"]) if isinstance(table.get("family"), str) else None
        if family is None and isinstance(table.get("family"), str):
            self._problems.add(
                [*at, "family"], f'there is no family "{table["family"]}"{instead(table["family"], families())}'
            )
        own = {key: value for key, value in table.items() if family is None or key in _Axis.model_fields}
        if family is None:
            own = {key: value for key, value in own.items() if key in _Axis.model_fields}
            for key in get_close_matches("family", table.keys() - own.keys()):  # what else it takes, its family says
                self._problems.add([*at, key], f"there is no such key{instead(key, ['family'])}")
        entry = validated(_Axis, own, at, self._problems)
        bus = self._bus_of(own.get("bus", ""), at)
        options: BaseModel | None = None
        if family is not None:
            rest = {key: value for key, value in table.items() if key not in own}
            known = [key for key in _Axis.model_fields if key != "side" or family.sides]
            options = validated(options_of(family.facade(), family.by_side), rest, at, self._problems, known)
        if not isinstance(entry, _Axis) or options is None or family is None:
            return None
        if not self._check_family(entry, family, at):
            return None
        return AxisEntry(**entry.model_dump(exclude={"bus"}), bus=bus, options=_given(options))

    def _bus_of(self, bus: object, at: list[str]) -> str:
        """The name of the bus of an axis, of which `bus` is what its table says."""
        buses = self._content.get("buses")
        names = list(buses) if isinstance(buses, dict) else []
        if not isinstance(bus, str) or bus in names or not names:
            return str(bus)
        if bus:
            self._problems.add([*at, "bus"], f'there is no bus "{bus}"{instead(bus, names)}')
        elif len(names) > 1:
            self._problems.add([*at, "bus"], f"it is missing; there are several buses: {', '.join(names)}")
        return bus or names[0]

    def _check_family(self, entry: _Axis, family: Family, at: list[str]) -> bool:
        """Whether its family can have such an axis."""
        before = len(self._problems)
        low, high = family.addresses
        if not low <= entry.address <= high:
            self._problems.add(
                [*at, "address"], f"{entry.address} is outside {low}..{high}, what {family.title} can have"
            )
        sides = " or ".join(f'side = "{side}"' for side in family.sides)
        if family.sides and entry.side not in family.sides:
            given = "it is missing" if entry.side is None else f'"{entry.side}" is no side'
            self._problems.add([*at, "side"], f"{given}: an axis of {family.title} is one of its two; say {sides}")
        if entry.side is not None and not family.sides:
            self._problems.add([*at, "side"], f"{family.title} has one axis at each address; take this line out")
        if entry.watchdog is not None:
            if family.watchdog is None:
                self._problems.add(
                    [*at, "watchdog"],
                    f"{family.title} drives have no watchdog: take this line out, and have a safety relay cut their "
                    "power that something else watches",
                )
            elif not family.watchdog[0] <= entry.watchdog <= family.watchdog[1]:
                low_time, high_time = family.watchdog
                self._problems.add([*at, "watchdog"], f"{entry.watchdog:g} s is outside {low_time:g}..{high_time:g} s")
        return len(self._problems) == before

    def _group(self, name: str, table: dict[str, Any]) -> GroupEntry | None:
        at = ["groups", name]
        entry = validated(GroupEntry, table, at, self._problems)
        if not isinstance(entry, GroupEntry):
            return None
        axes = self._content.get("axes")
        names = list(axes) if isinstance(axes, dict) else []
        for axis in entry.axes:
            if axis not in names:
                self._problems.add([*at, "axes"], f'there is no axis "{axis}"{instead(axis, names)}')
        if len(set(entry.axes)) < len(entry.axes):
            self._problems.add([*at, "axes"], "an axis is named twice; name each once")
        if not entry.axes:
            self._problems.add([*at, "axes"], 'a group has axes: axes = ["x", "y"]')
        return entry

    def _vehicle(self, axes: Mapping[str, AxisEntry]) -> VehicleEntry | None:
        table = self._content.get("vehicle")
        if table is None:
            return None
        at = ["vehicle"]
        if not isinstance(table, dict):
            self._problems.add(at, "must be a table: [vehicle]")
            return None
        entry = validated(_Vehicle, table, at, self._problems)
        if not isinstance(entry, _Vehicle) or len(axes) < len(self._content.get("axes", ())):
            return None  # an axis that has a mistake may be one of its wheels
        wheels: dict[str, str] = {}
        for side in ("left", "right"):
            of_side = [name for name, axis in axes.items() if axis.family == "zlac" and axis.side == side]
            named = getattr(entry, side)
            if named and named not in of_side:
                self._problems.add(
                    [*at, side], f'"{named}" is no axis of family "zlac" with side = "{side}"{instead(named, of_side)}'
                )
            elif not named and len(of_side) != 1:
                self._problems.add(
                    [*at, side], f'it is missing: name the axis that is its {side} wheel ({side} = "...")'
                )
            else:
                wheels[side] = named or of_side[0]
        if len(wheels) < 2:
            return None
        left, right = (axes[wheel] for wheel in wheels.values())
        if (left.bus, left.address) != (right.bus, right.address):
            self._problems.add(at, "its two wheels must be of one drive: the same bus and address")
        return VehicleEntry(**{**entry.model_dump(), **wheels})

    def _check_addresses(self, axes: Mapping[str, AxisEntry]) -> None:
        """Two axes share an address only as the sides of one drive, and then what concerns both is said alike."""
        taken: dict[tuple[str, int], dict[str | None, str]] = {}
        for name, axis in axes.items():
            others = taken.setdefault((axis.bus, axis.address), {})
            for other_name in others.values():
                other = axes[other_name]
                if other.family != axis.family or axis.side == other.side or axis.side is None:
                    self._problems.add(
                        ["axes", name, "address"],
                        f"{axis.address} is the address of {other_name}, too. Each drive on a pair needs its own: give "
                        "one another address (rs485bus setup), and say it here",
                    )
                else:
                    self._check_alike(name, axis, other_name, other)
            others[axis.side] = name

    def _check_alike(self, name: str, axis: AxisEntry, other_name: str, other: AxisEntry) -> None:
        both = {**axis.options, "watchdog": axis.watchdog}, {**other.options, "watchdog": other.watchdog}
        for key in sorted((both[0].keys() & both[1].keys()) - axis.facts.by_side):
            if both[0][key] != both[1][key] and None not in (both[0][key], both[1][key]):
                self._problems.add(
                    ["axes", name, key],
                    f"it is another one than that of {other_name}, which is on the same drive; there is one for both",
                )

    def _check_ports(self, buses: Mapping[str, BusEntry]) -> None:
        ports: dict[str, str] = {}
        for name, bus in buses.items():
            other = ports.setdefault(bus.port, name)
            if other != name:
                self._problems.add(["buses", name, "port"], f"{bus.port} is the port of {other}, too; each has its own")


def _given(options: BaseModel) -> dict[str, Any]:
    """What was said, not what is left as it is."""
    return {name: getattr(options, name) for name in options.model_fields_set}


def blamed(at: list[str], table: Mapping[str, Any], error: Exception) -> list[str]:
    """The field that an error's message names, where it names one; else the whole table."""
    words = set(re.findall(r"\w+", str(error)))
    named = [key for key in table if key in words]
    return [*at, named[0]] if len(named) == 1 else at
