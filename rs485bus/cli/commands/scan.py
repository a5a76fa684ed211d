"""`rs485bus scan`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from rs485bus.cli.options import Json, Sim

# typer reads these at run time.
Rates = Annotated[
    Optional[list[int]],  # noqa: UP045
    typer.Option("--baudrate", "-b", min=300, max=4_000_000, help="bit/s; once for each. Without, all usual ones."),
]
Formats = Annotated[
    Optional[list[str]],  # noqa: UP045
    typer.Option("--format", help="8N1, 8E1, 8O1 or 8N2; once for each. Without, 8N1."),
]
Expect = Annotated[
    Optional[int],  # noqa: UP045
    typer.Option(min=1, help="Stop as soon as so many are found."),
]
Write = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option(help="Write a plant file of what is found."),
]
Port = Annotated[
    Optional[str],  # noqa: UP045
    typer.Argument(help="A serial port, or a gateway: socket://host:port, tcp://host."),
]


def scan(
    port: Port = None,
    baudrate: Rates = None,
    form: Formats = None,
    addresses: Annotated[str, typer.Option(help="Which, like 1-20,32.")] = "1-247",
    expect: Expect = None,
    write: Write = None,
    force: Annotated[bool, typer.Option(help="Replace a plant file that is there.")] = False,
    json: Json = False,
    sim: Sim = False,
) -> None:
    """Find the drives on a pair: at which addresses and rates somebody answers, and of which family."""
    from rs485bus.cli.find import check_target, run_scan
    from rs485bus.cli.process import start

    check_target(write, force)
    virtual = sim and port is None
    start(lambda: run_scan(port, baudrate, form, addresses, expect, write, json, sim), virtual=virtual, suspends=True)
