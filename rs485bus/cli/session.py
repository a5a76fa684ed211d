"""The plant that a command works on: of a plant file, or of drives named on the command line; real or virtual."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from rs485bus.bench.scan import Format, recognise
from rs485bus.bus.bus import Bus
from rs485bus.bus.config import BusConfig
from rs485bus.bus.opening import open_bus
from rs485bus.cli.process import WrongUse
from rs485bus.cli.settings import settings
from rs485bus.cli.virtual import BAUDRATE, USUAL, VIRTUAL, virtual_drives
from rs485bus.errors import BusError, DeviceOffline, DeviceRefused, NoReply, OutcomeUnknown, RequestFailed
from rs485bus.plant import AxisEntry, BusEntry, Plant, PlantFile, families
from rs485bus.plant.building import virtual_lines
from rs485bus.plant.problems import instead
from rs485bus.sim import VirtualLine
from rs485bus.transport.interface import Transport

_log = logging.getLogger("rs485bus")

USUAL_FILE = Path("plant.toml")
WATCHDOG = 1.0
"""Seconds for drives that are named on the command line and may move."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Where:
    """Which plant, as the options say."""

    plant: Path | None = None
    port: str | None = None
    baudrate: int | None = None
    drives: Mapping[str, list[int]] | None = None
    """Addresses, by family."""
    sim: bool = False
    watchdog: float | None = None
    """Seconds, for the drives named here; 0 for none."""

    def file(self) -> PlantFile:
        """What it is.

        Raises:
            PlantFileError: the file has mistakes.
            WrongUse: the options do not say which plant.
        """
        named = {family: found for family, found in (self.drives or {}).items() if found}
        if self.port == "":
            raise WrongUse("--port is empty: is a variable of the shell unset? rs485bus ports lists the ports.")
        if self.plant is not None and (named or self.port is not None):
            raise WrongUse("--plant names the port and the drives already: give either --plant, or --port and drives.")
        if self.plant is not None or (not named and self.port is None and not self.sim and USUAL_FILE.exists()):
            return PlantFile.load(self.plant or USUAL_FILE)
        if self.port is None and not self.sim:
            raise WrongUse(
                "Say which drives: --plant plant.toml, or --port /dev/ttyUSB0 --baudrate 115200 --mks 1, or --sim for "
                "virtual ones. (Without, plant.toml in this folder is taken, and there is none.)"
            )
        if self.port is not None and not named:
            raise WrongUse(f"Say which drives are on {self.port}: --mks 1, --tlr 2, --zlac 3. rs485bus scan finds out.")
        return self._named(named or {family: list(some) for family, some in USUAL.items()})

    def line(self, bus_name: str | None) -> tuple[BusEntry, Transport | None]:
        """One bus, and its virtual line if it is to be virtual. Raises as `file`."""
        if self.port is not None:
            return BusEntry(port=self.port, baudrate=self.baudrate), None
        if self.sim and self.plant is None:
            return BusEntry(port=VIRTUAL, baudrate=BAUDRATE), VirtualLine(*virtual_drives(), baudrate=BAUDRATE)
        file = self.file()
        if bus_name is None and len(file.buses) > 1:
            raise WrongUse(f"Say which bus: --bus {' or --bus '.join(file.buses)}.")
        name = bus_name or next(iter(file.buses))
        if name not in file.buses:
            raise WrongUse(f"There is no bus {name!r}{instead(name, file.buses)}")
        return file.buses[name], virtual_lines(file)[name] if self.sim else None

    def _named(self, drives: Mapping[str, list[int]]) -> PlantFile:
        """A plant of the drives named: mks5, tlr4, zlac3.left."""
        axes: dict[str, AxisEntry] = {}
        for name, addresses in drives.items():
            family = families()[name]
            for address in addresses:
                guarded = self.watchdog if self.watchdog is not None else WATCHDOG
                for side in family.sides or (None,):
                    axes[f"{name}{address}" + (f".{side}" if side else "")] = AxisEntry(
                        bus="main",
                        family=name,
                        address=address,
                        side=side,
                        watchdog=guarded or None if family.watchdog else None,
                    )
        taken: dict[int, str] = {}
        for axis in axes.values():
            if taken.setdefault(axis.address, axis.family) != axis.family:
                raise WrongUse(f"Address {axis.address} is given to two families. Each drive on a pair has its own.")
        baudrate = self.baudrate or (BAUDRATE if self.port is None else None)
        bus = BusEntry(port=self.port or VIRTUAL, baudrate=baudrate, config=BusConfig())
        return PlantFile(name="command line", buses={"main": bus}, axes=axes)


@asynccontextmanager
async def open_plant(where: Where, *, watchdogs: bool = True, tells: bool = True) -> AsyncIterator[Plant]:
    """Open it. What fails because of a wrong address, rate or family says so.

    Args:
        where: which plant.
        watchdogs: guard its axes.
        tells: an interruption carries a note of where the axes were seen to stand.

    Raises:
        PlantFileError, WrongUse: as `Where.file`.
        PortError: a port cannot be opened.
    """
    plant = Plant(where.file(), sim=where.sim, watchdogs=False)
    if settings.frames:
        plant.watch(lambda bus, record: _log.debug("%s: %s", bus, record))
    try:
        async with plant:
            try:
                async with plant.guard() if watchdogs else nullcontext():
                    yield plant
            except Exception as error:
                await _add_advice(plant, error)
                raise
    except asyncio.CancelledError as cancelled:
        if tells:
            cancelled.add_note(_interrupted(plant))
        raise


@asynccontextmanager
async def open_line(where: Where, bus_name: str | None = None) -> AsyncIterator[Bus]:
    """Open one bus, without its axes.

    Raises:
        PlantFileError, WrongUse: the options do not say which.
        PortError: the port cannot be opened.
    """
    entry, line = where.line(bus_name)
    opening = open_bus(entry.port, **entry.opening) if line is None else open_bus(line, config=entry.config)
    async with opening as bus:
        if settings.frames:
            bus.subscribe(lambda record: _log.debug("%s", record))
        yield bus


def axis_named(file: PlantFile, name: str) -> str:
    """The axis that somebody means.

    Raises:
        WrongUse: there is none of that name.
    """
    if name in file.axes:
        return name
    raise WrongUse(f"There is no axis {name!r}{instead(name, file.axes)}")


def _interrupted(plant: Plant) -> str:
    """Where the axes of a plant stand that was interrupted and closed. Those that were not seen to are not named."""
    stand = [
        f"{name} stands at {axis.sample.position:.6g} {plant.file.axes[name].unit}"
        for name, axis in plant.axes.items()
        if axis.sample.moving is False and axis.sample.position is not None
    ]
    return f"Interrupted. {', '.join(stand)}." if stand else "Interrupted."


async def _add_advice(plant: Plant, error: Exception) -> None:
    """Look at the pair for what may be the cause of a failed request, and add it to the error."""
    if isinstance(error, ExceptionGroup):
        for inner in error.exceptions:
            await _add_advice(plant, inner)
        return
    cause = error if isinstance(error, RequestFailed) else error.__cause__
    if not isinstance(cause, NoReply | DeviceRefused | DeviceOffline | OutcomeUnknown):
        return
    for name, bus in plant.buses.items():
        expected = {axis.address: axis.family for axis in plant.file.axes.values() if axis.bus == name}
        if cause.address in expected and bus.connected:
            advice = await _advice(bus, plant.file.buses[name], cause.address, expected[cause.address])
            if advice:
                error.add_note(advice)
            return


async def _advice(bus: Bus, entry: BusEntry, address: int, family: str) -> str:
    try:
        found = await recognise(bus, address, entry.baudrate or BAUDRATE, Format(entry.parity, entry.stopbits))
    except (BusError, OSError):
        return ""
    if found.family is not None and found.family != family:
        return (
            f"What answers at address {address} is a {found.title} (family {found.family}), not a "
            f"{families()[family].title} (family {family}): name the right family."
        )
    if found.twins:
        return f"Address {address}: {found.note}."
    if not bus.stats.answers:
        return (
            f"Nobody has answered on {entry.port} at {entry.baudrate} bit/s. Look at the power, at A and B (they may "
            "be swapped), at the baud rate and the address; an MKS drive must have MB_RTU on in its menu. "
            f"rs485bus scan {entry.port} tries all rates and addresses."
        )
    if found.family is None and found.reply_ms is None:
        return f"Others answer on {entry.port}, but nobody at address {address}. rs485bus scan finds it."
    return ""
