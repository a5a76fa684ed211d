"""`rs485bus monitor` and `rs485bus record`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from rs485bus.cli.commands.captures import Keep, MaxMegabytes
from rs485bus.cli.options import (
    AxisBaudrate,
    BrokerUrl,
    BrokerUser,
    CaFile,
    DrivePort,
    Mks,
    PasswordFile,
    Plant,
    Sim,
    Tlr,
    Zlac,
    where,
)


def monitor(
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    sim: Sim = False,
    record: Annotated[
        Optional[Path],  # noqa: UP045 - typer reads it
        typer.Option("--record", "-o", metavar="CAPTURE", help="Write a capture file, too."),
    ] = None,
    broker: BrokerUrl = None,
    user: BrokerUser = None,
    password_file: PasswordFile = None,
    ca: CaFile = None,
) -> None:
    """Show axes and bus live, with keys to stop one, to stop all, and to hold the view."""
    if broker is not None:
        from rs485bus.cli import over_broker, watch_over_broker

        served = over_broker.Served(broker, plant, user, password_file, ca)
        raise typer.Exit(watch_over_broker.run_monitor(served, record))
    from rs485bus.cli.watch import run_monitor

    raise typer.Exit(run_monitor(where(plant, port, baudrate, mks, tlr, zlac, sim), record))


def record(
    out: Annotated[Path, typer.Argument(metavar="CAPTURE", help="The capture file to write.")],
    plant: Plant = None,
    port: DrivePort = None,
    baudrate: AxisBaudrate = None,
    mks: Mks = None,
    tlr: Tlr = None,
    zlac: Zlac = None,
    sim: Sim = False,
    every: Annotated[float, typer.Option(min=0.01, help="Seconds after which each axis is asked anew.")] = 0.1,
    seconds: Annotated[
        Optional[float],  # noqa: UP045 - typer reads it
        typer.Option(min=0.1, help="End after so long; else by Ctrl-C."),
    ] = None,
    max_megabytes: MaxMegabytes = 20.0,
    keep: Keep = 4,
    broker: BrokerUrl = None,
    user: BrokerUser = None,
    password_file: PasswordFile = None,
    ca: CaFile = None,
) -> None:
    """Ask the axes again and again, and keep what happens on the pair in a capture file."""
    from rs485bus.cli.process import start
    from rs485bus.cli.watch import run_record

    size = round(max_megabytes * 1e6)
    if broker is not None:
        from rs485bus.cli import over_broker, watch_over_broker

        served = over_broker.Served(broker, plant, user, password_file, ca)
        start(
            lambda: watch_over_broker.run_record(served, out, every=every, seconds=seconds, max_bytes=size, keep=keep)
        )
    there = where(plant, port, baudrate, mks, tlr, zlac, sim)
    start(lambda: run_record(there, out, every=every, seconds=seconds, max_bytes=size, keep=keep), suspends=True)
