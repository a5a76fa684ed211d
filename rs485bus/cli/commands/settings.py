"""`rs485bus settings`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from rs485bus.cli.options import AxisBaudrate, DrivePort, Json, Mks, Plant, Sim, Tlr, Yes, Zlac, where

app = typer.Typer(
    help="Read, write, save, load and compare what a drive is set to.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

Name = Annotated[str, typer.Argument(help="An axis of the drive: as in the plant file, or mks5, tlr4, zlac3.left.")]
File = Annotated[Path, typer.Argument(metavar="FILE.TOML", help="A settings file.")]
Setting = Annotated[
    Optional[str],  # noqa: UP045 - typer reads it
    typer.Argument(help="One of them; without, all."),
]


@app.command()
def read(
    name: Name,
    setting: Setting = None,
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    sim: Sim = False,
    json: Json = False,
) -> None:
    """Print what a drive is set to."""
    from rs485bus.cli.drive_settings import show
    from rs485bus.cli.process import start

    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: show(there, name, setting, json), virtual=sim)


@app.command()
def write(
    name: Name,
    setting: Annotated[str, typer.Argument(help="Which.")],
    value: Annotated[str, typer.Argument(help="As in TOML: 16, true, SR_VFOC.")],
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    yes: Yes = False,
    sim: Sim = False,
) -> None:
    """Change one setting, which the drive then keeps."""
    from rs485bus.cli.drive_settings import write_one
    from rs485bus.cli.process import start

    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: write_one(there, name, setting, value, yes), virtual=sim)


@app.command()
def save(
    name: Name,
    file: File,
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    sim: Sim = False,
) -> None:
    """Write what a drive is set to into a file."""
    from rs485bus.cli.drive_settings import save as save_them
    from rs485bus.cli.process import start

    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: save_them(there, name, file), virtual=sim)


@app.command()
def diff(
    name: Name,
    file: File,
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    sim: Sim = False,
    json: Json = False,
) -> None:
    """Say where a drive differs from a file; the exit code is 1 then."""
    from rs485bus.cli.drive_settings import diff as compare
    from rs485bus.cli.process import start

    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: compare(there, name, file, json), virtual=sim)


@app.command()
def load(
    name: Name,
    file: File,
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    yes: Yes = False,
    sim: Sim = False,
) -> None:
    """Set a drive as a file says, which it then keeps."""
    from rs485bus.cli.drive_settings import load as set_them
    from rs485bus.cli.process import start

    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: set_them(there, name, file, yes), virtual=sim)
