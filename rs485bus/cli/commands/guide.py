"""`rs485bus guide`."""

from __future__ import annotations

from typing import Annotated, Optional

import typer


def guide(
    topic: Annotated[
        Optional[str],  # noqa: UP045 - typer reads it
        typer.Argument(help="The page; without, the pages are listed."),
    ] = None,
) -> None:
    """Show a page of the guide, or list the pages."""
    from rs485bus.cli.guide import show_page, show_topics

    if topic is None:
        show_topics()
    else:
        show_page(topic)
