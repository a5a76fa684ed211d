"""From the entries of a plant file to facades on buses, and to virtual drives."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

from rs485bus.bus.bus import Bus
from rs485bus.bus.opening import open_bus
from rs485bus.devices.zlac import DifferentialDrive, Zlac8015d
from rs485bus.errors import BusError, NotSupported
from rs485bus.motion.group.axis_group import AxisGroup
from rs485bus.plant.entries import AxisEntry
from rs485bus.plant.file import PlantFile
from rs485bus.plant.problems import Problems
from rs485bus.plant.reading import blamed
from rs485bus.transport.interface import Transport


class Built:
    """What the entries have become."""

    def __init__(self) -> None:
        self.facades: dict[tuple[str, int], Any] = {}
        """By bus and address."""
        self.axes: dict[str, Any] = {}
        self.groups: dict[str, AxisGroup] = {}
        self.vehicle: DifferentialDrive | None = None


def build(file: PlantFile, buses: Mapping[str, Bus]) -> Built:
    """Make all facades of a plant. Nothing is sent.

    Raises:
        PlantFileError: a facade refuses one of its options.
    """
    problems = Problems(str(file.path or "plant"), file.text)
    built = Built()
    for bus in file.buses:
        for address, axes in file.drives(bus):
            _build_drive(built, buses[bus], address, axes, problems)
    problems.check()
    for name, group in file.groups.items():
        with problems.noted(["groups", name]):
            built.groups[name] = AxisGroup(**{axis: built.axes[axis] for axis in group.axes})
    if file.vehicle is not None:
        entry, wheel = file.vehicle, file.axes[file.vehicle.left]
        zlac = built.facades[wheel.bus, wheel.address]
        assert isinstance(zlac, Zlac8015d)
        with problems.noted(["vehicle"]):
            built.vehicle = DifferentialDrive(zlac, entry.wheel_radius, entry.track, acceleration=entry.acceleration)
    problems.check()
    return built


def _build_drive(
    built: Built, bus: Bus, address: int, axes: Mapping[str | None, tuple[str, AxisEntry]], problems: Problems
) -> None:
    name, entry = next(iter(axes.values()))
    family = entry.facts
    options: dict[str, Any] = {}
    for _, axis in axes.values():
        options |= axis.options
    for option in family.by_side & options.keys():
        sides = [axes[side][1].options.get(option, False) if side in axes else False for side in family.sides]
        options[option] = tuple(sides)
    facade = None
    while facade is None:
        try:
            facade = family.facade()(bus, address, **options)
        except (BusError, ValueError, TypeError) as error:
            field = blamed(["axes", name], options, error)
            problems.add(field, str(error))
            if field[-1] not in options:
                return
            del options[field[-1]]  # there may be more mistakes
    built.facades[entry.bus, address] = facade
    timeout = next((axis.reply_timeout for _, axis in axes.values() if axis.reply_timeout is not None), None)
    if timeout is not None:
        bus.unit(address, reply_timeout=timeout)
    for side, (axis_name, _) in axes.items():
        built.axes[axis_name] = facade if side is None else getattr(facade, side)


def virtual_lines(file: PlantFile) -> dict[str, Transport]:
    """A virtual line for each bus of a plant, with a virtual drive at each address.

    Raises:
        NotSupported: a family has no virtual drive.
    """
    from rs485bus.sim import VirtualLine  # the one place where the plant knows of the simulation

    lines: dict[str, Transport] = {}
    for name, bus in file.buses.items():
        devices = []
        baudrate = bus.baudrate or 115200
        for address, axes in file.drives(name):
            _, entry = next(iter(axes.values()))
            if entry.facts.simulate is None:
                raise NotSupported(f"The family {entry.family!r} has no virtual drive: it cannot be simulated.")
            device = entry.facts.simulate(address, entry.options)
            if hasattr(device, "baudrate"):
                device.baudrate = baudrate
            devices.append(device)
        lines[name] = VirtualLine(*devices, baudrate=baudrate, parity=bus.parity, stopbits=bus.stopbits)
    return lines


def try_out(file: PlantFile) -> None:
    """Make all facades of a plant on virtual lines, to see whether each takes its options. Not in an event loop.

    Raises:
        PlantFileError: one does not.
    """

    async def main() -> None:
        lines = virtual_lines(file.model_copy(update={"axes": {}}))
        buses = {name: await open_bus(line) for name, line in lines.items()}
        try:
            build(file, buses)
        finally:
            for bus in buses.values():
                await bus.aclose()

    asyncio.run(main())
