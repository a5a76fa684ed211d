"""`rs485bus group`."""

from __future__ import annotations

from typing import Annotated, Optional

import typer

from rs485bus.cli.options import Json, Plant, Sim, where

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)

# typer reads these at run time.
Values = Annotated[
    Optional[list[float]],  # noqa: UP045
    typer.Argument(help="A position or a distance for each of its axes, in their order."),
]
Number = Optional[float]  # noqa: UP045


@app.command(context_settings={"ignore_unknown_options": True})
def group(
    name: Annotated[str, typer.Argument(help="As in the plant file.")],
    verb: Annotated[str, typer.Argument(help="status, enable, disable, home, move-to, move-by, stop or zero.")],
    values: Values = None,
    duration: Annotated[Number, typer.Option(help="Seconds that the move is to take.")] = None,
    rpm: Annotated[Number, typer.Option(help="The highest speed of any of them.")] = None,
    plant: Plant = None,
    sim: Sim = False,
    json: Json = False,
) -> None:
    """Have the axes of a group do one thing together: they start together and arrive together."""
    from rs485bus.cli.group import GroupOrder, run_group
    from rs485bus.cli.process import start

    order = GroupOrder(verb=verb, values=values or [], duration=duration, rpm=rpm)
    there = where(plant, None, None, None, None, None, sim)
    start(lambda: run_group(there, name, order, json))
