"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

# typer reads these at run time: Optional, for Python 3.11 and all versions of typer.
Port = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option(help="A serial port, or a gateway: socket://host:port, tcp://host. Without, a virtual plant."),
]
Baudrate = Annotated[int, typer.Option("--baudrate", "-b", min=300, max=4_000_000, help="bit/s")]
Mks = Annotated[
    Optional[list[int]],  # noqa: UP045
    typer.Option("--mks", min=1, max=247, help="The address of an MKS drive; once for each."),
]
Zlac = Annotated[
    Optional[list[int]],  # noqa: UP045
    typer.Option("--zlac", min=1, max=127, help="The address of a ZLAC8015D; once for each."),
]
Tlr = Annotated[
    Optional[list[int]],  # noqa: UP045
    typer.Option("--tlr", min=1, max=247, help="The station of a TL-R stepper; once for each."),
]
Sim = Annotated[bool, typer.Option("--sim", help="Use virtual drives instead of a port.")]
Yes = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]
PlantPath = Annotated[Path, typer.Argument(metavar="PLANT.TOML", help="The plant file.")]


def check_once(addresses: list[int]) -> None:
    """Refuse an address that is given twice."""
    if len(set(addresses)) < len(addresses):
        raise typer.BadParameter(f"An address is given twice: {', '.join(map(str, addresses))}.")
