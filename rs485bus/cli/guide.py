"""Pages of the guide on a terminal."""

from __future__ import annotations

import difflib

import typer
from rich.markdown import Markdown
from rich.table import Table

from rs485bus.cli.process import console
from rs485bus.guide import page, topics


def show_topics() -> None:
    """List the pages, each with what it is about."""
    table = Table.grid(padding=(0, 2))
    for topic, about in topics().items():
        table.add_row(topic, about)
    out = console()
    out.print(table)
    out.print("rs485bus guide TOPIC shows one.")


def show_page(topic: str) -> None:
    """Show a page. Any beginning of its name will do."""
    known = topics()
    found = [name for name in known if name.startswith(topic)]
    if len(found) != 1 and topic not in known:
        near = found or difflib.get_close_matches(topic, known, 1)
        instead = f"did you mean {' or '.join(near)}?" if near else "rs485bus guide lists them."
        raise typer.BadParameter(f"there is no page {topic!r}; {instead}")
    out = console()
    text = page(topic if topic in known else found[0])
    out.print(Markdown(text) if out.is_terminal else text, soft_wrap=not out.is_terminal, markup=False)
