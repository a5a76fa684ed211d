"""`rs485bus sniff`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from rs485bus.cli.commands.captures import Errors, Hexadecimal, Keep, MaxMegabytes, families
from rs485bus.cli.options import Baudrate, Json, Mks, Sim, Tlr, Zlac


def sniff(
    port: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it
        typer.Argument(metavar="PORT", help="A serial port of its own on the pair."),
    ] = None,
    baudrate: Baudrate = 115200,
    parity: Annotated[str, typer.Option(help="N, E or O.")] = "N",
    stopbits: Annotated[int, typer.Option(min=1, max=2, help="1 or 2.")] = 1,
    record: Annotated[
        Optional[Path],  # noqa: UP045 - typer reads it
        typer.Option("--record", "-o", metavar="CAPTURE", help="Write a capture file, too."),
    ] = None,
    max_megabytes: MaxMegabytes = 20.0,
    keep: Keep = 4,
    seconds: Annotated[
        Optional[float],  # noqa: UP045 - typer reads it
        typer.Option(min=0.1, help="End after so long; else by Ctrl-C."),
    ] = None,
    hexadecimal: Hexadecimal = False,
    errors: Errors = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Only the statistics at the end.")] = False,
    mks: Mks = None,
    zlac: Zlac = None,
    tlr: Tlr = None,
    sim: Sim = False,
    json: Json = False,
) -> None:
    """Listen to a pair that another master owns: frames in words, drives recognised, errors marked."""
    from rs485bus.cli import sniff as work
    from rs485bus.cli.outputs import check_output
    from rs485bus.cli.process import console, start

    if (port is None) != sim:
        raise typer.BadParameter("name a port to listen on, or --sim to listen to virtual drives: one of the two")
    check_output(record)
    known = {address: family for family, addresses in families(mks, zlac, tlr) for address in addresses}
    start(
        lambda: work.sniff(
            port,
            baudrate,
            parity,  # type: ignore[arg-type] # checked there, with a message
            stopbits,
            console(),
            record=record,
            max_bytes=round(max_megabytes * 1e6),
            keep=keep,
            seconds=seconds,
            hexadecimal=hexadecimal,
            errors_only=errors,
            quiet=quiet,
            json=json,
            drives=known,
        ),
        suspends=True,
    )
