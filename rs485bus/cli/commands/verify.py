"""`rs485bus verify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from rs485bus.cli.options import AxisBaudrate, DrivePort, Mks, Plant, Sim, Tlr, Yes, Zlac, where

# typer reads these at run time.
Names = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Argument(help="Axes of the drives to ask; without, all of the plant."),
]
Only = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option("--only", help="One question, like watchdog; once for each. Without, all."),
]
Report = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option(help="Write a report that can be sent in."),
]


def verify(
    names: Names = None,
    only: Only = None,
    report: Report = None,
    write: Annotated[bool, typer.Option("--write/--no-write", help="Write the options into the plant file.")] = True,
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    yes: Yes = False,
    sim: Sim = False,
) -> None:
    """Try on real drives what their manuals leave open: the answers as options, and as a report. It turns motors.

    What it does to each drive is said, and asked for, before anything moves. Drives stand between the questions.
    """
    from rs485bus.cli.process import start
    from rs485bus.cli.verify_plant import run_verify

    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: run_verify(there, names or [], only or [], report, write, yes), virtual=sim)
