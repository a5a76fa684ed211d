"""`rs485bus demo`: the main job, end to end, on a virtual plant or on real drives, of all families."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from typing import Any

from rich import box
from rich.console import Console
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from rs485bus import Bus, DifferentialDrive, Move
from rs485bus.bus.watchdog.guard import WatchReport
from rs485bus.cli.process import UNKNOWN, WrongUse
from rs485bus.cli.session import Where, open_line, open_plant
from rs485bus.plant import Plant, families
from rs485bus.sim import Machine, SimDevice, SimMks, VirtualLine

_COUNTDOWN = 3
_REFRESH = 0.1
_FAST, _SLOW, _RUN = 400.0, 150.0, 120.0
_RUNS_FOR = 1.5
_TURNS_OF_A_RUN = 5.0
_V, _OMEGA, _DRIVES_FOR = 0.15, 0.5, 3.0


@dataclass
class _Leg:
    """One move of the sequence and what came of it."""

    axis: str
    what: str
    move: Move
    units_per_turn: float
    unit: str
    reached: float = 0.0
    took: float = 0.0

    @property
    def error(self) -> float | None:
        """Degrees of the shaft between target and position."""
        return None if self.move.target is None else 360 * abs(self.reached - self.move.target) / self.units_per_turn


async def run_demo(where: Where, console: Console) -> int:
    """Home all at once, move to a position, by a distance and at a speed, and go back; a vehicle drives a curve.

    Returns the exit code.
    """
    async with _plant(where, console) as there:
        buses: Mapping[str, Bus] = {}
        real = not there.sim and there is where
        try:
            async with open_plant(there, watchdogs=False, tells=False) as plant:
                buses = plant.buses
                if real:
                    await _warn(plant, where, console)
                legs, reports = await _sequence(plant, console)
        except asyncio.CancelledError:
            _say_how_it_stopped(buses, console)
            raise
        return _summary(buses, legs, reports, console)


async def _sequence(plant: Plant, console: Console) -> tuple[list[_Leg], list[WatchReport]]:
    legs: list[_Leg] = []
    axes = dict(plant.axes)

    def leg(name: str, what: str, move: Move) -> _Leg:
        return _Leg(name, what, move, axes[name].units_per_turn, plant.file.axes[name].unit)

    def go(name: str, to: float) -> _Leg:
        return leg(name, f"to {to:g}", axes[name].move_to(to, rpm=min(_FAST, axes[name].member.highest_rpm)))

    async def together(some: list[_Leg]) -> None:
        if some:
            await _show(axes, some, console)
            legs.extend(some)

    async with plant.guard() as watchdogs:
        for axis in axes.values():
            axis.enable()
        for axis in axes.values():
            if not _can_home(axis):
                await axis.set_zero()  # a hub motor has no origin: where it stands will do
        await together([leg(name, "home", _home(axis)) for name, axis in axes.items() if _can_home(axis)])
        there = {name: _place(axis, 4.0 + at) for at, (name, axis) in enumerate(axes.items())}
        await together([go(name, to) for name, to in there.items()])
        ways = {name: _place(axis, 2.5 + at) - there[name] for at, (name, axis) in enumerate(axes.items())}
        slow = {name: min(_SLOW, axis.member.highest_rpm) for name, axis in axes.items()}
        await together(
            [leg(name, f"by {way:g}", axes[name].move_by(way, rpm=slow[name])) for name, way in ways.items()]
        )
        free = {name: axis for name, axis in axes.items() if _has_room(axis)}
        await together(
            [
                leg(name, f"{_RUN:g} rpm, {_RUNS_FOR:g} s", axis.run(_RUN, duration=_RUNS_FOR))
                for name, axis in free.items()
            ]
        )
        await together([go(name, _place(axis, 0)) for name, axis in axes.items()])
        if plant.vehicle is not None:
            await _drive(plant.vehicle, console)
        return legs, [report for watchdog in watchdogs for report in watchdog.report()]


def _can_home(axis: Any) -> bool:
    return hasattr(axis, "home")


def _home(axis: Any) -> Move:
    move: Move = axis.home()
    return move


def _place(axis: Any, turns: float) -> float:
    """Where so many turns are, in the axis' units; within its limits, if it has any."""
    units = float(turns * axis.units_per_turn)
    if axis.limits is None:
        return units
    low, high = axis.limits
    return float(min(max(units, low), high))


def _has_room(axis: Any) -> bool:
    """Whether a run at a speed cannot take it out of its limits."""
    return axis.limits is None or axis.limits[1] - _place(axis, 4.0) > _TURNS_OF_A_RUN * axis.units_per_turn


async def _drive(vehicle: DifferentialDrive, console: Console) -> None:
    """Drive a curve and stop."""
    await vehicle.reset()
    vehicle.drive(_V, _OMEGA)
    ends = vehicle.zlac.bus.now() + _DRIVES_FOR
    while vehicle.zlac.bus.now() < ends:
        await vehicle.update()
        await asyncio.sleep(_REFRESH)
    await vehicle.stop()
    pose = await vehicle.update()
    console.print(f"vehicle  a curve: x {pose.x:.3f} m, y {pose.y:.3f} m, heading {pose.heading:.2f} rad")


async def _show(axes: Mapping[str, Any], legs: list[_Leg], console: Console) -> None:
    """Show some moves until they are done: live on a terminal, a line each elsewhere."""
    loop = asyncio.get_running_loop()
    asked = loop.time()

    async def follow(leg: _Leg) -> None:
        leg.reached = await leg.move
        leg.took = loop.time() - (leg.move.started_at or asked)
        if not console.is_terminal:
            console.print(_line(leg))

    async with asyncio.TaskGroup() as group:
        for leg in legs:
            group.create_task(follow(leg))
        if console.is_terminal:
            group.create_task(_live(axes, legs, console))


async def _live(axes: Mapping[str, Any], legs: list[_Leg], console: Console) -> None:
    now = asyncio.get_running_loop().time
    with Live(console=console, refresh_per_second=10, transient=True) as live:
        while not all(leg.move.done() for leg in legs):
            positions = [await axes[leg.axis].position() for leg in legs]
            live.update(_picture(now(), legs, positions))
            await asyncio.sleep(_REFRESH)
    for leg in legs:
        console.print(_line(leg))


def _picture(now: float, legs: list[_Leg], positions: list[float]) -> Table:
    table = Table.grid(padding=(0, 2))
    for leg, position in zip(legs, positions, strict=True):
        move = leg.move
        part = 0.0
        if move.done():
            part = 1.0
        elif move.started_at is not None and move.eta is not None and move.eta > move.started_at:
            part = min(1.0, (now - move.started_at) / (move.eta - move.started_at))
        bar = ProgressBar(total=1.0, completed=part, width=30, pulse=move.eta is None and not move.done())
        table.add_row(leg.axis, leg.what, bar, Text(f"{position:9.3f}"), move.state.value)
    return table


def _line(leg: _Leg) -> str:
    error = "" if leg.error is None else f", {leg.error:.2f}° off"
    return f"{leg.axis:11} {leg.what:16} {leg.reached:8.3f} {leg.unit} after {leg.took:5.2f} s{error}"


def _summary(buses: Mapping[str, Bus], legs: list[_Leg], reports: list[WatchReport], console: Console) -> int:
    table = Table(box=box.SIMPLE_HEAD if console.is_terminal else box.ASCII2)
    for heading in ("axis", "move", "reached", "", "off by (°)", "took (s)", "planned (s)"):
        table.add_column(heading, justify="left" if heading in ("axis", "move", "") else "right")
    for leg in legs:
        move = leg.move
        planned = "" if move.eta is None or move.started_at is None else f"{move.eta - move.started_at:.2f}"
        error = "" if leg.error is None else f"{leg.error:.2f}"
        table.add_row(leg.axis, leg.what, f"{leg.reached:.3f}", leg.unit, error, f"{leg.took:.2f}", planned)
    console.print(table)
    worst = max((leg.error or 0.0 for leg in legs), default=0.0)
    units = [unit for bus in buses.values() for unit in bus.stats.units.values()]
    requests = sum(unit.requests for unit in units)
    retries, timeouts = sum(unit.retries for unit in units), sum(unit.timeouts for unit in units)
    standing = all(halted.standing for bus in buses.values() for halted in bus.stopped)
    load = ", ".join(f"{100 * bus.stats.load:.0f} %" for bus in buses.values())
    facts = {
        "moves": f"{len(legs)}, the worst {worst:.2f}° off",
        "requests": f"{requests}, {retries} repeated, {timeouts} unanswered",
        "bus load": f"{load} of the time",
        "watchdogs": _watchdogs(reports),
        "at the end": "every axis stands, every watchdog is off" if standing else "[red]NOT all stand[/red]",
    }
    for name, fact in facts.items():
        console.print(f"{name:12}{fact}")
    return 0 if standing else UNKNOWN


def _watchdogs(reports: list[WatchReport]) -> str:
    if not reports:
        return "none of these drives has one that was armed"
    unheard = max(report.longest for report in reports)
    feeds, saved = sum(report.feeds for report in reports), sum(report.saved for report in reports)
    return f"stayed fed: unheard for {unheard:.2f} s at most, {feeds} feeds sent, {saved} not needed"


def _say_how_it_stopped(buses: Mapping[str, Bus], console: Console) -> None:
    if not buses:
        return
    halted = [halted for bus in buses.values() for halted in bus.stopped]
    moving = [f"{one.family} {one.address}" for one in halted if not one.standing]
    if moving:
        console.print(f"[red]Interrupted. NOT seen standing: {', '.join(moving)}. Use the hard-wired stop.[/red]")
    else:
        console.print("Interrupted. Every axis was stopped and seen standing.")


async def _warn(plant: Plant, where: Where, console: Console) -> None:
    drives = ", ".join(
        f"{families()[family].title} {', '.join(map(str, addresses))}"
        for family, addresses in (where.drives or {}).items()
        if addresses
    ) or ", ".join(plant.axes)
    there = where.port or ", ".join(entry.port for entry in plant.file.buses.values())
    console.print(f"{drives} on {there} will home and turn some turns. Ctrl-C stops them at any time.")
    for left in range(_COUNTDOWN, 0, -1):
        console.print(f"{left} ...")
        await asyncio.sleep(1)


@asynccontextmanager
async def _plant(where: Where, console: Console) -> AsyncIterator[Where]:
    """The plant given, or a virtual one on a pseudo-terminal."""
    drives = {family: addresses for family, addresses in (where.drives or {}).items() if addresses}
    if where.port is not None and not drives:
        async with open_line(where):
            raise WrongUse(f"Say which drives on {where.port} may be moved: --mks 1, --tlr 2, --zlac 3. No other is.")
    if where.plant is not None or where.port is not None:
        yield where
        return
    baudrate = where.baudrate
    assert baudrate is not None
    sims = [_virtual(family, address, at) for family, some in drives.items() for at, address in enumerate(some)]
    said = "; ".join(f"{families()[family].title} {', '.join(map(str, some))}" for family, some in drives.items())
    line = VirtualLine(*sims, baudrate=baudrate)
    if os.name != "posix":
        console.print(f"A virtual plant: {said} at {baudrate} bit/s (in memory: no pseudo-terminals here).")
        yield replace(where, sim=True)
        return
    async with await line.serve_pty() as virtual:
        console.print(f"A virtual plant: {said} at {baudrate} bit/s on {virtual.path}.")
        yield replace(where, port=virtual.path)
        console.print(f"{line.pair.frames} frames on the pair, {line.pair.early_frames} of them before t3.5.")


def _virtual(family: str, address: int, at: int) -> SimDevice:
    """A virtual drive; those of one family begin and home at different places."""
    if family == "mks":
        return SimMks(address, shaft=0.4 * at, machine=Machine(home_switch=-1.0 - 0.3 * at))
    simulate = families()[family].simulate
    assert simulate is not None
    return simulate(address, {})
