"""What a notebook shows of an axis."""

from __future__ import annotations

import enum
from dataclasses import fields, is_dataclass
from html import escape
from typing import Any

from rs485bus.blocking.interrupts import in_kernel
from rs485bus.errors import BusError


def show_status(self: Any) -> str:
    """A table of what the drive reports, for notebooks."""
    try:
        status = self.status()
    except BusError as error:
        rows = {type(error).__name__: str(error)}
    else:
        rows = (
            {field.name: _text(getattr(status, field.name)) for field in fields(status)} if is_dataclass(status) else {}
        )
    return table(repr(self).strip("<>"), rows)


def table(title: str, rows: dict[str, str]) -> str:
    """Names and values as a table."""
    cells = (
        f"<th style='text-align: left'>{escape(name)}</th><td>{escape(value)}</td>" for name, value in rows.items()
    )
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return f"<table><caption>{escape(title)}</caption>{body}</table>"


def show_figures() -> None:
    """Have a notebook show a figure that is the last line of a cell."""
    if in_kernel():
        from IPython.core.getipython import get_ipython
        from IPython.core.pylabtools import select_figure_formats

        select_figure_formats(get_ipython(), {"png"})  # type: ignore[no-untyped-call] # IPython leaves it untyped


def _text(value: object) -> str:
    if isinstance(value, enum.Enum):
        return value.name.lower().replace("_", " ") if value.name else str(value)
    if isinstance(value, float):
        return f"{value:.3f}"
    return str(value)
