"""`rs485bus jog`."""

from __future__ import annotations

from typing import Annotated

import typer

from rs485bus.cli.options import AxisBaudrate, DrivePort, Mks, Plant, Sim, Tlr, Watchdog, Zlac, where


def jog(
    name: Annotated[str, typer.Argument(help="As in the plant file; with --port: mks5, tlr4, zlac3.left.")],
    rpm: Annotated[float, typer.Option(min=1, help="The speed while a key is held.")] = 30.0,
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    watchdog: Watchdog = None,
    sim: Sim = False,
) -> None:
    """Turn an axis while a key is held: arrows or a and d turn it, up and down change the speed, q ends it."""
    from rs485bus.cli.jog import run_jog
    from rs485bus.cli.process import start

    there = where(plant, port, baudrate, mks, tlr, zlac, sim, watchdog)
    start(lambda: run_jog(there, name, rpm))
