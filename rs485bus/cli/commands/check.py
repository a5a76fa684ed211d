"""`rs485bus check`."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from rs485bus.cli.options import Json

PlantFiles = Annotated[
    Optional[list[str]],  # noqa: UP045 - typer reads it
    typer.Argument(metavar="PLANT.TOML...", help="The plant files. Without, plant.toml in this folder."),
]


def check(
    files: PlantFiles = None,
    schema: Annotated[
        bool, typer.Option("--schema", help="Print the JSON schema of plant files, for editors.")
    ] = False,
    json: Json = False,
) -> None:
    """Say whether a plant file is right, and what to mend."""
    from rs485bus.cli.check import check_files, print_schema

    if schema:
        print_schema()
    else:
        raise typer.Exit(check_files(files or ["plant.toml"], json))
