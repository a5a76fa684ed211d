"""`rs485bus tune`: a plant's pairs measured, and what was found written into its file."""

from __future__ import annotations

import asyncio
from typing import Any

from rich.console import Console

from rs485bus.bench.plant_drive import write_found
from rs485bus.bench.scan import PortOf
from rs485bus.bench.tune import MARGIN, Tuned, Tuning
from rs485bus.cli.outputs import check_output
from rs485bus.cli.process import DONE, WrongUse, agrees, console
from rs485bus.cli.session import Where
from rs485bus.cli.virtual import BAUDRATE
from rs485bus.plant.building import virtual_lines
from rs485bus.plant.families import families
from rs485bus.plant.file import PlantFile
from rs485bus.sim import SimDevice, VirtualLine
from rs485bus.wire.timing import LineSettings


async def run_tune(where: Where, bus: str | None, rates: bool, write: bool, yes: bool) -> int:
    """Measure one bus of a plant, or all. Returns the exit code."""
    out = console()
    file = where.file()
    if bus is not None and bus not in file.buses:
        raise WrongUse(f"There is no bus {bus!r}. There is: {', '.join(file.buses)}.")
    check_output(file.path if write else None)
    for name in file.buses if bus is None else [bus]:
        await _tune(file, name, where.sim, rates, write, yes, out)
    return DONE


async def _tune(file: PlantFile, name: str, sim: bool, rates: bool, write: bool, yes: bool, out: Console) -> None:
    entry = file.buses[name]
    drives = {address: next(iter(sides.values()))[1].family for address, sides in file.drives(name)}
    devices: list[SimDevice] = []
    if sim:
        line = virtual_lines(file)[name]
        assert isinstance(line, VirtualLine)
        devices = list(line.pair.devices)
    present = LineSettings(baudrate=entry.baudrate or BAUDRATE, parity=entry.parity, stopbits=entry.stopbits)
    tuning = Tuning(
        port=_port(entry.port, devices),
        drives=drives,
        line=present,
        config=entry.config,
        tell=lambda text: out.print(f"  {text}"),
    )
    out.print(f"[bold]{name}[/bold]: {entry.port} at {present.baudrate} bit/s, {len(drives)} drives")
    higher = _rates(drives, present.baudrate) if rates else []

    async def power_cycle(text: str) -> bool:
        for device in devices:
            if hasattr(device, "power_cycle"):
                device.power_cycle(asyncio.get_running_loop().time())
        return bool(devices) or (not yes and agrees(f"{text} Is that done?"))

    tuned = await tuning.run(higher, power_cycle, lambda question: yes or agrees(question))
    _say(tuned, drives, out)
    found = _found(file, name, tuned)
    if write and file.path is not None:
        write_found(file.path, found, "tuned")
        out.print(f"  {file.path} has it now.")


def _port(port: str, devices: list[SimDevice]) -> PortOf:
    if not devices:
        return port
    return lambda line: VirtualLine(*devices, baudrate=line.baudrate, parity=line.parity, stopbits=line.stopbits)


def _rates(drives: dict[int, str], present: int) -> list[int]:
    """The rates above the present one that all drives can be set to."""
    common = set.intersection(*(set(families()[family].baudrates) for family in drives.values()))
    return sorted(rate for rate in common if rate > present)


def _say(tuned: Tuned, drives: dict[int, str], out: Console) -> None:
    for remark in tuned.remarks:
        out.print(f"  {remark}")
    for address, reply in tuned.replies.items():
        out.print(
            f"  {families()[drives[address]].title} {address} answers after {1000 * reply:.1f} ms at the longest; "
            f"it is waited for {1000 * tuned.reply_timeout(address):.0f} ms"
        )
    if tuned.shortest is not None:
        kept = tuned.silence
        said = f"{1000 * kept:.2f} ms are kept" if kept is not None else "the usual silence of Modbus is kept"
        out.print(f"  a silence of {1000 * tuned.shortest:.2f} ms lost nothing: {said}")
    out.print(f"  {tuned.line.baudrate} bit/s")


def _found(file: PlantFile, name: str, tuned: Tuned) -> dict[tuple[str, str], dict[str, Any]]:
    bus: dict[str, Any] = {}
    if tuned.line.baudrate != file.buses[name].baudrate:
        bus["baudrate"] = (tuned.line.baudrate, "; ".join(tuned.remarks) or "nothing was lost")
    if tuned.silence is not None and tuned.shortest is not None:
        bus["silence"] = (tuned.silence, f"{1000 * tuned.shortest:.2f} ms lost nothing, times {MARGIN:g}")
    tables: dict[tuple[str, str], dict[str, Any]] = {("buses", name): bus}
    for address, sides in file.drives(name):
        axis = next(iter(sides.values()))[0]
        longest = f"the longest answer began after {1000 * tuned.replies[address]:.1f} ms"
        tables["axes", axis] = {"reply_timeout": (tuned.reply_timeout(address), longest)}
    return tables
