"""The commands and their options."""

from __future__ import annotations

import logging
from collections.abc import Callable, Coroutine
from typing import Annotated, Any, Optional

import typer
from rich.console import Console

from rs485bus import __version__
from rs485bus.cli.demo import run_demo
from rs485bus.cli.process import Output, run
from rs485bus.cli.serve import serve
from rs485bus.cli.verify import question, verify

app = typer.Typer(
    name="rs485bus",
    help="Motor drives that share one RS-485 pair.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
_console = Output(highlight=False)
_errors = Console(stderr=True, highlight=False)

_USUAL = [1, 2, 3]

Port = Annotated[
    Optional[str],  # noqa: UP045 - typer reads it
    typer.Option(help="A serial port, or a gateway: socket://host:port, tcp://host. Without, a virtual plant."),
]
Baudrate = Annotated[int, typer.Option(min=300, max=4_000_000, help="bit/s")]
Mks = Annotated[
    Optional[list[int]],  # noqa: UP045 - typer reads it
    typer.Option("--mks", min=1, max=247, help="The address of an MKS drive; once for each."),
]


@app.callback(invoke_without_command=True)
def _options(
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say what the bus notices.")] = False,
) -> None:
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.ERROR, format="%(levelname)s %(message)s", force=True
    )
    logging.getLogger("asyncio").setLevel(logging.WARNING)
    logging.getLogger("pymodbus").setLevel(logging.WARNING)
    if version:
        print(__version__)
        raise typer.Exit


@app.command()
def demo(
    port: Port = None,
    baudrate: Baudrate = 38400,
    mks: Mks = None,
) -> None:
    """Home some drives, move them, watch them, stop: on a virtual plant, or on real drives."""
    addresses = mks or _USUAL
    _check_once(addresses)
    _run(lambda: run_demo(port, baudrate, addresses, _console))


@app.command()
def sim(
    baudrate: Baudrate = 38400,
    mks: Mks = None,
    zlac: Annotated[
        Optional[list[int]],  # noqa: UP045 - typer reads it
        typer.Option("--zlac", min=1, max=127, help="The address of a ZLAC8015D; once for each."),
    ] = None,
    tlr: Annotated[
        Optional[list[int]],  # noqa: UP045 - typer reads it
        typer.Option("--tlr", min=1, max=247, help="The station of a TL-R stepper; once for each."),
    ] = None,
    link: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it
        typer.Option(help="Make a symbolic link to the pseudo-terminal here."),
    ] = None,
) -> None:
    """Put virtual drives on a pseudo-terminal, for any Modbus master, until interrupted."""
    if not (zlac or tlr):
        mks = mks or _USUAL
    drives = {"MKS": mks or [], "ZLAC": zlac or [], "TL-R": tlr or []}
    _check_once([address for addresses in drives.values() for address in addresses])
    _run(lambda: serve(baudrate, drives, link, _console))


@app.command("verify-watchdog")
def verify_watchdog(
    port: Port = None,
    baudrate: Baudrate = 38400,
    mks: Annotated[int, typer.Option("--mks", min=1, max=247, help="The address of the MKS drive.")] = 1,
    timeout: Annotated[float, typer.Option(min=0.2, max=60, help="The watchdog's time in the test, in seconds.")] = 1.0,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before the motor moves.")] = False,
) -> None:
    """Find out on the bench what feeds a drive's watchdog, and whether a trip latches. It turns the motor."""
    if not yes and not typer.confirm(question(port, mks, timeout)):
        _console.print("Nothing was moved.")
        raise typer.Exit(1)
    _run(lambda: verify(port, baudrate, mks, timeout, _console), virtual=port is None)


def _check_once(addresses: list[int]) -> None:
    if len(set(addresses)) < len(addresses):
        _errors.print(f"[red]An address is given twice: {', '.join(map(str, addresses))}.[/red]")
        raise typer.Exit(2)


def _run(make: Callable[[], Coroutine[Any, Any, int]], *, virtual: bool = False) -> None:
    raise typer.Exit(run(make, _errors, virtual=virtual))
