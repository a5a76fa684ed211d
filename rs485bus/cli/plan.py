"""`rs485bus plan`: what a plant will ask of its pairs, before a wire is laid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from rs485bus.cli.outputs import check_output
from rs485bus.cli.process import DONE, FAILED
from rs485bus.cli.telling import print_json
from rs485bus.planning.checking import check
from rs485bus.planning.plan import BAUDRATES, PairPlan, at_baudrate, most_drives, plan, with_drives
from rs485bus.plant import PlantFile


def run_plan(path: Path, turnaround: float, picture: Path | None, compare: bool, json: bool, console: Console) -> int:
    """Plan a plant, and say whether it fits. Returns the exit code."""
    if picture is not None:
        from rs485bus.capture.figures import check_format, save

        check_format(picture)
        check_output(picture)
    file = PlantFile.load(path)
    pairs = plan(file, turnaround=turnaround)
    told: list[dict[str, Any]] = []
    agrees = True
    for pair in pairs:
        rates = [at_baudrate(pair, file, baudrate) for baudrate in BAUDRATES]
        most = most_drives(pair, file)
        compared = check(pair, file) if compare else []
        agrees = agrees and all(one.agrees for one in compared)
        if json:
            told.append(_as_json(pair, rates, most, compared))
        else:
            _tell(pair, rates, most, compared, console)
        if picture is not None:
            from rs485bus.planning.picture import picture as draw

            counts = [
                with_drives(pair, file, count) for count in sorted({1, 2, 4, 8, 12, 16, 24, 31, len(pair.drives)})
            ]
            title = f"{file.name}, {pair.bus}: {len(pair.drives)} drives at {pair.line.baudrate} bit/s"
            out = picture.with_stem(f"{picture.stem}.{pair.bus}") if len(pairs) > 1 else picture
            save(draw(pair, rates, counts, title), out)
            if not json:
                console.print(f"{out} is drawn.", markup=False)
    if json:
        print_json({"fits": all(pair.fits for pair in pairs), "buses": told})
    return DONE if all(pair.fits for pair in pairs) and agrees else FAILED


def _tell(pair: PairPlan, rates: list[PairPlan], most: int, compared: list[Any], console: Console) -> None:
    line = pair.line
    console.print(
        f"\n[bold]{pair.bus}[/bold]: {len(pair.drives)} drives at {line.baudrate} bit/s 8{line.parity}{line.stopbits}, "
        f"replies begin after {1000 * pair.answers_after:.2f} ms",
        soft_wrap=True,
    )
    drives = _table("drive", "family", "watchdog", "left of it", "position takes", "stop takes")
    for drive in pair.drives:
        margin = pair.margin(drive)
        drives.add_row(
            f"{drive.address} {'+'.join(drive.axes)}",
            drive.family,
            "-" if drive.watchdog is None else f"{1000 * drive.watchdog:.0f} ms",
            "-" if margin is None else f"{1000 * margin:.0f} ms",
            f"{1000 * sum(map(pair.takes, drive.positions)):.1f} ms",
            f"{1000 * sum(map(pair.takes, drive.stops)):.1f} ms",
        )
    console.print(drives)
    facts = {
        "all positions": f"{pair.poll_rate:.0f} times a second, if nothing else is asked ({1000 * pair.cycle:.1f} ms)",
        "standing, fed": f"{pair.load_standing:.1%} load; the pair is taken {pair.busy_standing:.0%} of the time",
        "all moving": f"{pair.load_moving:.1%} load; the pair is taken {pair.busy_moving:.0%} of the time",
        "a stop waits": f"{1000 * pair.stop_wait:.1f} ms at the most, {1000 * pair.stop_wait_silent:.1f} ms behind a "
        f"drive that is silent; all are stopped {1000 * pair.stop_all:.0f} ms later",
        "set-points": f"{pair.set_point_rate:.0f} times a second to each axis, where all are streamed at once"
        if pair.set_point_rate
        else "all axes cannot be streamed at once",
        "it fits": "yes" if pair.fits else f"NO: {pair.problem}",
        "drives": f"up to {most} of these kinds fit at this rate",
    }
    for name, fact in facts.items():
        console.print(f"{name:14}{fact}", soft_wrap=True, markup=False)
    table = _table("bit/s", "fits", "positions/s", "set-points/s", "moving", "stop waits")
    for other in rates:
        table.add_row(
            f"{other.line.baudrate}",
            "yes" if other.fits else "NO",
            f"{other.poll_rate:.0f}",
            f"{other.set_point_rate:.0f}" if other.set_point_rate else "-",
            f"{other.busy_moving:.0%}",
            f"{1000 * other.stop_wait:.1f} ms",
        )
    console.print(table)
    for one in compared:
        verdict = "agrees" if one.agrees else "DIFFERS"
        console.print(
            f"{one.name}: planned {one.planned:.5g}, simulated {one.measured:.5g}: {verdict} ({one.off:.2%})",
            markup=False,
        )


def _table(*headings: str) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for at, heading in enumerate(headings):
        table.add_column(heading, justify="left" if at == 0 else "right")
    return table


def _as_json(pair: PairPlan, rates: list[PairPlan], most: int, compared: list[Any]) -> dict[str, Any]:
    return {
        "bus": pair.bus,
        "baudrate": pair.line.baudrate,
        "fits": pair.fits,
        "problem": pair.problem,
        "position_rate": pair.poll_rate,
        "load_standing": pair.load_standing,
        "load_moving": pair.load_moving,
        "busy_moving": pair.busy_moving,
        "stop_wait": pair.stop_wait,
        "stop_wait_silent": pair.stop_wait_silent,
        "stop_all": pair.stop_all,
        "set_point_rate": pair.set_point_rate,
        "most_drives": most,
        "drives": [
            {
                "address": drive.address,
                "family": drive.family,
                "axes": drive.axes,
                "watchdog": drive.watchdog,
                "margin": pair.margin(drive),
            }
            for drive in pair.drives
        ],
        "baudrates": [{"baudrate": other.line.baudrate, "fits": other.fits} for other in rates],
        "simulation": [{"what": one.name, "planned": one.planned, "simulated": one.measured} for one in compared],
    }
