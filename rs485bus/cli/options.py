"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

if TYPE_CHECKING:
    from rs485bus.cli.session import Where

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
AxisBaudrate = Annotated[
    Optional[int],  # noqa: UP045
    typer.Option("--baudrate", "-b", min=300, max=4_000_000, help="bit/s of the port."),
]
Plant = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option("--plant", "-p", help="The plant file. Without --plant and --port: plant.toml in this folder."),
]
DrivePort = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option(help="Instead of a plant file: a serial port or gateway, with --baudrate, --mks, --tlr, --zlac."),
]
Watchdog = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option(min=0, help="Seconds, for the drives named here while they may move; 0 for none. Without, 1."),
]
Sim = Annotated[bool, typer.Option("--sim", help="Use virtual drives instead of a port.")]
BrokerUrl = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option("--broker", help="Use a plant that is served: mqtt://host. Then --plant is its name."),
]
BrokerUser = Annotated[
    Optional[str],  # noqa: UP045
    typer.Option("--user", help="As whom the broker is used."),
]
PasswordFile = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option("--password-file", help="A file with the password for the broker."),
]
CaFile = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option("--ca", help="The certificate of who signs for the broker, with mqtts://."),
]
Yes = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask.")]
PlantPath = Annotated[Path, typer.Argument(metavar="PLANT.TOML", help="The plant file.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")]


def check_once(addresses: list[int]) -> None:
    """Refuse an address that is given twice."""
    if len(set(addresses)) < len(addresses):
        raise typer.BadParameter(f"An address is given twice: {', '.join(map(str, addresses))}.")


def where(
    plant: Path | None,
    port: str | None,
    baudrate: int | None,
    mks: list[int] | None,
    tlr: list[int] | None,
    zlac: list[int] | None,
    sim: bool,
    watchdog: float | None = None,
) -> Where:
    """The plant that the options name."""
    from rs485bus.cli.session import Where

    drives = {"mks": mks or [], "tlr": tlr or [], "zlac": zlac or []}
    check_once([address for addresses in drives.values() for address in addresses])
    return Where(plant=plant, port=port, baudrate=baudrate, drives=drives, sim=sim, watchdog=watchdog)
