"""`rs485bus sim`."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from rs485bus.cli.options import Baudrate, Mks, Tlr, Zlac, check_once

_USUAL = [1, 2, 3]


def sim(
    baudrate: Baudrate = 38400,
    mks: Mks = None,
    zlac: Zlac = None,
    tlr: Tlr = None,
    link: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it
        typer.Option(help="Make a symbolic link to the pseudo-terminal here."),
    ] = None,
    tap: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it
        typer.Option(help="Make a symbolic link to a second one, on which `rs485bus sniff` can listen."),
    ] = None,
) -> None:
    """Put virtual drives on a pseudo-terminal, for any Modbus master, until interrupted."""
    from rs485bus.cli.process import console, start
    from rs485bus.cli.serve import serve

    if not (zlac or tlr):
        mks = mks or _USUAL
    drives = {"MKS": mks or [], "ZLAC": zlac or [], "TL-R": tlr or []}
    check_once([address for addresses in drives.values() for address in addresses])
    start(lambda: serve(baudrate, drives, link, console(), tap), suspends=True)
