"""`rs485bus demo`: the main job, end to end, on a virtual plant or on real drives."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from rich import box
from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from rs485bus import Bus, MksServo, Move, open_bus
from rs485bus.bus.watchdog.guard import WatchReport
from rs485bus.sim import Machine, SimMks, VirtualLine
from rs485bus.transport.interface import Transport

_WATCHDOG = 1.0
_COUNTDOWN = 3
_REFRESH = 0.1


@dataclass
class _Leg:
    """One move of the sequence and what came of it."""

    axis: str
    what: str
    move: Move
    reached: float = 0.0
    took: float = 0.0

    @property
    def error(self) -> float | None:
        """Degrees of the shaft between target and position."""
        return None if self.move.target is None else 360 * abs(self.reached - self.move.target)


async def run_demo(port: str | None, baudrate: int, addresses: list[int], console: Console) -> int:
    """Home all at once, move to a position, by a distance and at a speed, and go back. Returns the exit code."""
    async with _plant(port, baudrate, addresses, console) as where:
        bus: Bus | None = None
        try:
            async with open_bus(where, baudrate=baudrate) as bus:
                if port is not None:
                    await _warn(port, addresses, console)
                axes = [MksServo(bus, address, rpm=300, acceleration=1500) for address in addresses]
                legs, reports = await _sequence(bus, axes, console)
        except asyncio.CancelledError:
            _say_how_it_stopped(bus, console)
            raise
        _summary(bus, legs, reports, console)
    return 0


async def _sequence(bus: Bus, axes: list[MksServo], console: Console) -> tuple[list[_Leg], list[WatchReport]]:
    legs: list[_Leg] = []
    async with bus.watchdog(*axes, timeout=_WATCHDOG) as watchdog:
        for axis in axes:
            axis.enable()
        homes = [_Leg(axis.name, "home", axis.home()) for axis in axes]
        await _show(bus, axes, homes, console)
        legs += homes
        there = [_Leg(axis.name, f"to {4 + at:g}", axis.move_to(4.0 + at)) for at, axis in enumerate(axes)]
        await _show(bus, axes, there, console)
        legs += there
        back = [_Leg(axis.name, "by -1.5", axis.move_by(-1.5, rpm=150)) for axis in axes]
        await _show(bus, axes, back, console)
        legs += back
        runs = [_Leg(axis.name, "120 rpm, 1.5 s", axis.run(120, duration=1.5)) for axis in axes]
        await _show(bus, axes, runs, console)
        legs += runs
        ends = [_Leg(axis.name, "to 0", axis.move_to(0.0, rpm=400)) for axis in axes]
        await _show(bus, axes, ends, console)
        legs += ends
        return legs, watchdog.report()


async def _show(bus: Bus, axes: list[MksServo], legs: list[_Leg], console: Console) -> None:
    """Show some moves until they are done: live on a terminal, a line each elsewhere."""
    asked = bus.now()

    async def follow(leg: _Leg) -> None:
        leg.reached = await leg.move
        leg.took = bus.now() - (leg.move.started_at or asked)
        if not console.is_terminal:
            console.print(_line(leg))

    async with asyncio.TaskGroup() as group:
        for leg in legs:
            group.create_task(follow(leg))
        if console.is_terminal:
            group.create_task(_live(bus, axes, legs, console))


async def _live(bus: Bus, axes: list[MksServo], legs: list[_Leg], console: Console) -> None:
    with Live(console=console, refresh_per_second=10, transient=True) as live:
        while not all(leg.move.done() for leg in legs):
            positions = [await axis.position() for axis in axes]
            live.update(_picture(bus, legs, positions))
            await asyncio.sleep(_REFRESH)
    for leg in legs:
        console.print(_line(leg))


def _picture(bus: Bus, legs: list[_Leg], positions: list[float]) -> Table:
    table = Table.grid(padding=(0, 2))
    for leg, position in zip(legs, positions, strict=True):
        move = leg.move
        part = 0.0
        if move.done():
            part = 1.0
        elif move.started_at is not None and move.eta is not None and move.eta > move.started_at:
            part = min(1.0, (bus.now() - move.started_at) / (move.eta - move.started_at))
        bar = ProgressBar(total=1.0, completed=part, width=30, pulse=move.eta is None and not move.done())
        table.add_row(leg.axis, leg.what, bar, Text(f"{position:9.3f}"), move.state.value)
    return table


def _line(leg: _Leg) -> str:
    error = "" if leg.error is None else f", {leg.error:.2f}° off"
    return f"{leg.axis:8} {leg.what:16} {leg.reached:8.3f} turns after {leg.took:5.2f} s{error}"


def _summary(bus: Bus, legs: list[_Leg], reports: list[WatchReport], console: Console) -> None:
    table = Table(box=box.SIMPLE_HEAD if console.is_terminal else box.ASCII2)
    for heading in ("axis", "move", "reached (turns)", "off by (°)", "took (s)", "planned (s)"):
        table.add_column(heading, justify="left" if heading in ("axis", "move") else "right")
    for leg in legs:
        move = leg.move
        planned = "" if move.eta is None or move.started_at is None else f"{move.eta - move.started_at:.2f}"
        error = "" if leg.error is None else f"{leg.error:.2f}"
        table.add_row(leg.axis, leg.what, f"{leg.reached:.3f}", error, f"{leg.took:.2f}", planned)
    console.print(table)
    stats = bus.stats
    units = stats.units.values()
    worst = max((leg.error or 0.0 for leg in legs), default=0.0)
    unheard = max((report.longest for report in reports), default=0.0)
    feeds, saved = sum(report.feeds for report in reports), sum(report.saved for report in reports)
    requests = sum(unit.requests for unit in units)
    retries, timeouts = sum(unit.retries for unit in units), sum(unit.timeouts for unit in units)
    standing = all(halted.standing for halted in bus.stopped)
    facts = {
        "moves": f"{len(legs)}, the worst {worst:.2f}° off",
        "requests": f"{requests}, {retries} repeated, {timeouts} unanswered",
        "bus load": f"{100 * stats.load:.0f} % of the time",
        "watchdogs": f"stayed fed: unheard for {unheard:.2f} s of {_WATCHDOG:g} s at most, "
        f"{feeds} feeds sent, {saved} not needed",
        "at the end": "every axis stands, every watchdog is off" if standing else "[red]NOT all stand[/red]",
    }
    for name, fact in facts.items():
        console.print(f"{name:12}{fact}", soft_wrap=True)


def _say_how_it_stopped(bus: Bus | None, console: Console) -> None:
    if bus is None:
        return
    moving = [f"{halted.family} {halted.address}" for halted in bus.stopped if not halted.standing]
    if moving:
        console.print(f"[red]Interrupted. NOT seen standing: {', '.join(moving)}. Use the hard-wired stop.[/red]")
    else:
        console.print("Interrupted. Every axis was stopped and seen standing.")


async def _warn(port: str, addresses: list[int], console: Console) -> None:
    drives = ", ".join(map(str, addresses))
    console.print(f"MKS {drives} on {port} will home and turn some turns. Ctrl-C stops them at any time.")
    for left in range(_COUNTDOWN, 0, -1):
        console.print(f"{left} ...")
        await asyncio.sleep(1)


@asynccontextmanager
async def _plant(
    port: str | None, baudrate: int, addresses: list[int], console: Console
) -> AsyncIterator[str | Transport]:
    """The port given, or a virtual plant on a pseudo-terminal."""
    if port is not None:
        yield port
        return
    sims = [
        SimMks(address, shaft=0.4 * at, machine=Machine(home_switch=-1.0 - 0.3 * at))
        for at, address in enumerate(addresses)
    ]
    line = VirtualLine(*sims, baudrate=baudrate)
    drives = ", ".join(map(str, addresses))
    if os.name != "posix":
        console.print(f"A virtual plant: MKS {drives} at {baudrate} bit/s (in memory: no pseudo-terminals here).")
        yield line
        return
    async with await line.serve_pty() as virtual:
        console.print(f"A virtual plant: MKS {drives} at {baudrate} bit/s on {virtual.path}.")
        yield virtual.path
        console.print(f"{line.pair.frames} frames on the pair, {line.pair.early_frames} of them before t3.5.")
