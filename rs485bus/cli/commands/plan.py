"""`rs485bus plan`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from rs485bus.cli.options import Json, PlantPath


def plan(
    plant: PlantPath,
    turnaround: Annotated[
        float, typer.Option(min=0.0, max=1000.0, metavar="MS", help="Milliseconds that drives take to begin a reply.")
    ] = 2.0,
    picture: Annotated[
        Optional[Path],  # noqa: UP045 - typer reads it
        typer.Option("--picture", "-o", metavar="FILE", help="Draw it: .svg, .png, .pdf or .html."),
    ] = None,
    check: Annotated[bool, typer.Option("--check", help="Compare the plan with the simulation.")] = False,
    json: Json = False,
) -> None:
    """Reckon what a plant asks of its pairs: rates, load, waits, margins, and what still fits."""
    from rs485bus.cli.plan import run_plan
    from rs485bus.cli.process import console

    raise typer.Exit(run_plan(plant, turnaround / 1000, picture, check, json, console()))
