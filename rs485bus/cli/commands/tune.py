"""`rs485bus tune`."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from rs485bus.cli.options import AxisBaudrate, DrivePort, Mks, Plant, Sim, Tlr, Yes, Zlac, where


def tune(
    bus: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it
        typer.Option(help="One bus of the plant; without, all."),
    ] = None,
    rates: Annotated[bool, typer.Option("--rates/--no-rates", help="Try higher baud rates, too.")] = True,
    write: Annotated[bool, typer.Option("--write/--no-write", help="Write what is found into the plant file.")] = True,
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    yes: Yes = False,
    sim: Sim = False,
) -> None:
    """Find each drive's reply time, the shortest silence and the highest rate at which nothing is lost.

    Only harmless reads are sent, but for new baud rates, which are asked for. All drives must stand.
    """
    from rs485bus.cli.process import start
    from rs485bus.cli.tune import run_tune

    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: run_tune(there, bus, rates, write, yes), virtual=sim)
