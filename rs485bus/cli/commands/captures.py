"""`rs485bus explain`, `plot` and `pcap`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from rs485bus.cli.options import Json, Mks, Tlr, Zlac

Files = Annotated[
    list[str],
    typer.Argument(metavar="CAPTURE...", help="A capture file; all files of one that was written in several."),
]
File = Annotated[str, typer.Argument(metavar="CAPTURE", help="A capture file.")]
# typer reads Optional at run time.
Begin = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option("--from", metavar="SECONDS", help="Only from then on: seconds since the capture began."),
]
End = Annotated[
    Optional[float],  # noqa: UP045
    typer.Option("--to", metavar="SECONDS", help="Only until then."),
]
Units = Annotated[
    Optional[list[int]],  # noqa: UP045
    typer.Option("--unit", min=0, max=255, help="Only this address; once for each."),
]
Hexadecimal = Annotated[bool, typer.Option("--hex", help="Show the bytes, too.")]
Errors = Annotated[bool, typer.Option("--errors", help="Only what went wrong.")]
MaxMegabytes = Annotated[float, typer.Option("--max-mb", min=0.01, help="Begin another file after so many megabytes.")]
Keep = Annotated[int, typer.Option(min=0, max=1000, help="How many older files to keep.")]


def families(mks: list[int] | None, zlac: list[int] | None, tlr: list[int] | None) -> list[tuple[str, list[int]]]:
    """The drives that were named, by family."""
    return [("MKS", mks or []), ("ZLAC", zlac or []), ("TL-R", tlr or [])]


def explain(
    files: Files,
    begin: Begin = None,
    end: End = None,
    unit: Units = None,
    errors: Errors = False,
    hexadecimal: Hexadecimal = False,
    summary: Annotated[bool, typer.Option("--summary", help="Only the statistics.")] = False,
    mks: Mks = None,
    zlac: Zlac = None,
    tlr: Tlr = None,
    json: Json = False,
) -> None:
    """Say what a capture holds: each frame in words, errors marked, statistics."""
    from rs485bus.cli import captures as work
    from rs485bus.cli.process import console

    raise typer.Exit(
        work.explain(
            work.read(files, begin=begin, end=end, drives=families(mks, zlac, tlr)),
            console(),
            units=unit or [],
            errors_only=errors,
            hexadecimal=hexadecimal,
            frames=not summary,
            json=json,
        )
    )


def pcap(
    file: File,
    out: Annotated[Path, typer.Argument(metavar="OUT", help="The pcap file to write.")],
    begin: Begin = None,
    end: End = None,
) -> None:
    """Turn a capture into a file that Wireshark shows as Modbus RTU."""
    from rs485bus.cli import captures as work
    from rs485bus.cli.process import console

    raise typer.Exit(work.pcap(work.read([file], begin=begin, end=end), out, console()))


def plot(
    files: Files,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="The picture: .svg, .png, .pdf or .html.")
    ] = Path("capture.html"),
    begin: Begin = None,
    end: End = None,
    mks: Mks = None,
    zlac: Zlac = None,
    tlr: Tlr = None,
) -> None:
    """Draw a capture: a lane for each unit, latency, load, and what the axes did."""
    from rs485bus.cli import captures as work
    from rs485bus.cli.process import console

    raise typer.Exit(work.plot(work.read(files, drives=families(mks, zlac, tlr)), out, console(), begin=begin, end=end))
