"""What is entered by `async with` says so to whoever enters it by `with`."""

from __future__ import annotations

from typing import TYPE_CHECKING


class AsyncBlock:
    """The base of asynchronous context managers."""

    if not TYPE_CHECKING:  # type checkers find the mistake by themselves

        def __enter__(self):
            raise TypeError("this block is entered by `async with`; without async, that of rs485bus.blocking by `with`")

        def __exit__(self, *error):
            """Never called: it could not be entered."""
