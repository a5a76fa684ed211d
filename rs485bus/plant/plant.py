"""A plant that is open: its buses, and its axes by their names."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from types import TracebackType
from typing import Any, Generic, TypeVar, get_type_hints

from rs485bus.arguments import flag
from rs485bus.bus.async_block import AsyncBlock
from rs485bus.bus.bus import Bus
from rs485bus.bus.opening import open_bus
from rs485bus.bus.record import Record
from rs485bus.bus.watchdog.guard import WatchdogGuard
from rs485bus.bus.watchdog.guarding import EmergencyReport
from rs485bus.devices.axis import Axis
from rs485bus.devices.zlac import DifferentialDrive
from rs485bus.errors import BusError
from rs485bus.motion.group.axis_group import AxisGroup
from rs485bus.plant.building import build, virtual_lines
from rs485bus.plant.file import PlantFile
from rs485bus.plant.problems import Problems, instead
from rs485bus.transport.interface import Transport

T = TypeVar("T")
P = TypeVar("P", bound="Plant")


class Named(Mapping[str, T], Generic[T]):
    """What has names: `plant.axes["x"]`, and `plant.axes.x`."""

    def __init__(self, what: str, items: Mapping[str, T]) -> None:
        self._what = what
        self._items = dict(items)

    def __getitem__(self, name: str) -> T:
        try:
            return self._items[name]
        except KeyError:
            raise KeyError(f"there is no {self._what} {name!r}{instead(name, self._items)}") from None

    def __getattr__(self, name: str) -> T:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self[name]
        except KeyError as error:
            raise AttributeError(error.args[0]) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._items]

    def __repr__(self) -> str:
        return f"<{', '.join(self._items) or 'none'}>"


class Plant(AsyncBlock):
    """The buses, axes, groups and the vehicle of a plant file, open while a block runs.

        async with Plant.load("plant.toml") as plant:
            await plant.x.home()

    Leaving the block does what leaving the block of `open_bus` does, for each bus. Axes whose entry has a `watchdog`
    are guarded meanwhile. For an editor that knows each axis by its name and its class, write the names down; they are
    compared with the file when it is loaded:

        class Cell(Plant):
            x: MksServo
            y: TlrStepper

        async with Cell.load("plant.toml") as cell:
            cell.x.move_to(120.0)

    Args:
        file: what it is.
        sim: put virtual drives on virtual lines instead of opening ports.
        watchdogs: guard the axes whose entries say so. False for what only looks.

    Raises:
        PlantFileError: a subclass names axes that the file does not have, or has of another class.
    """

    def __init__(self, file: PlantFile, *, sim: bool = False, watchdogs: bool = True) -> None:
        self.file = file
        self.lines: dict[str, Transport] = virtual_lines(file) if flag("sim", sim) else {}
        """The virtual lines, by the name of their bus; none where the ports are opened."""
        self._watchdogs = flag("watchdogs", watchdogs)
        self._open: AsyncExitStack | None = None
        self._observers: list[Callable[[str, Record], None]] = []
        self._facades: Mapping[tuple[str, int], Any] = {}
        self.buses: Named[Bus] = Named("bus", {})
        self.axes: Named[Axis] = Named("axis", {})
        self.groups: Named[AxisGroup] = Named("group", {})
        self.vehicle: DifferentialDrive | None = None
        self._check_annotations()

    @classmethod
    def load(cls: type[P], path: str | os.PathLike[str], *, sim: bool = False, watchdogs: bool = True) -> P:
        """Read a plant file. Arguments as for the class.

        Raises:
            PlantFileError: it has mistakes. The message says where, and what to do.
        """
        return cls(PlantFile.load(path), sim=sim, watchdogs=watchdogs)

    @property
    def name(self) -> str:
        """What the file calls it."""
        return self.file.name

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        for there in (self.axes, self.groups):
            if name in there:
                return there[name]
        if self._open is None and name in (*self.file.axes, *self.file.groups):
            raise AttributeError(
                f"{name} is there while the plant is open: in its block, `async with plant`, blocking `with plant`"
            )
        known = [*self.file.axes, *self.file.groups]
        raise AttributeError(f"the plant {self.name} has no axis and no group {name!r}{instead(name, known)}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.file.axes, *self.file.groups]

    def __repr__(self) -> str:
        return f"<plant {self.name}: {', '.join(self.file.axes)}>"

    def watch(self, observer: Callable[[str, Record], None]) -> None:
        """Have `observer` called with each transaction, and the name of its bus, from the opening on.

        To be said before the plant is opened. As for `Bus.subscribe`, it must be quick.
        """
        self._observers.append(observer)

    def drive(self, axis: str) -> Any:
        """The facade of the drive that an axis is on: the axis itself, or the `Zlac8015d` of a wheel."""
        entry = self.file.axes[axis]
        return self._facades[entry.bus, entry.address]

    def emergency_stop(self) -> Awaitable[dict[str, EmergencyReport]]:
        """Stop every drive on every bus at once. Awaiting it gives the reports, by the names of the buses.

        As `Bus.emergency_stop`: it happens whether it is awaited or not.
        """
        handles = {name: bus.emergency_stop() for name, bus in self.buses.items()}

        async def reports() -> dict[str, EmergencyReport]:
            return {name: await handle for name, handle in handles.items()}

        return asyncio.ensure_future(reports())

    async def __aenter__(self: P) -> P:
        """Open the buses.

        Raises:
            PortError: one cannot be opened.
            PlantFileError: an option is out of its range.
            WatchdogInfeasible: the watchdogs cannot be fed in time.
        """
        if self._open is not None:
            raise BusError("The plant is open already: one block at a time.")
        async with AsyncExitStack() as opening:
            buses: dict[str, Bus] = {}
            for name, entry in self.file.buses.items():
                if name in self.lines:
                    bus = open_bus(self.lines[name], config=entry.config)
                else:
                    bus = open_bus(entry.port, **entry.opening)
                buses[name] = await opening.enter_async_context(bus)
                for observer in self._observers:
                    buses[name].subscribe(partial(observer, name))
            built = build(self.file, buses)
            self._facades = built.facades
            self.buses, self.axes = Named("bus", buses), Named("axis", built.axes)
            self.groups, self.vehicle = Named("group", built.groups), built.vehicle
            if self._watchdogs:
                await opening.enter_async_context(self.guard())
            self._open = opening.pop_all()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        opened, self._open = self._open, None
        assert opened is not None
        return await opened.__aexit__(kind, error, trace)

    @asynccontextmanager
    async def guard(self) -> AsyncIterator[list[WatchdogGuard]]:
        """Guard the axes whose entries have a `watchdog` while a block runs; what is queued at its end is waited for.

        For a plant that was made with `watchdogs=False`.

        Raises:
            WatchdogInfeasible: the watchdogs cannot be fed in time.
        """
        async with AsyncExitStack() as guards:
            watchdogs = [
                await guards.enter_async_context(self.buses[bus].watchdog(*axes, timeout=timeout))
                for bus, timeout, axes in self._guarded()
            ]
            yield watchdogs
            for bus_open in self.buses.values():
                await bus_open.drain()

    def _guarded(self) -> Iterator[tuple[str, float, list[Axis]]]:
        """Which axes of a bus are to be guarded together: those of one time."""
        blocks: dict[tuple[str, float], list[Axis]] = {}
        for bus in self.file.buses:
            for _, axes in self.file.drives(bus):
                timeout = next((axis.watchdog for _, axis in axes.values() if axis.watchdog is not None), None)
                if timeout is not None:
                    name, _ = next(iter(axes.values()))
                    blocks.setdefault((bus, timeout), []).append(self.axes[name])
        for (bus, timeout), guarded in blocks.items():
            yield bus, timeout, guarded

    def _check_annotations(self) -> None:
        problems = Problems(str(self.file.path or "plant"), self.file.text)
        for base in type(self).__mro__:
            if base is Plant:
                break
            for name, kind in get_type_hints(base).items():
                if name in Plant.__annotations__ or not isinstance(kind, type) or name in self.file.groups:
                    continue
                entry = self.file.axes.get(name)
                if entry is None:
                    problems.add(["axes"], f"{base.__name__} has an axis {name}, and there is none here")
                elif not entry.facts.sides and not issubclass(entry.facts.facade(), kind):  # type: ignore[arg-type]
                    problems.add(["axes", name, "family"], f"{base.__name__} says that {name} is a {kind.__name__}")
        problems.check()
