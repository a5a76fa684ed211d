"""A call of an application, when it began and how it ended."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

LONGEST = 75.0
"""Seconds that a call without a timeout may take here at most: 30 for the port, the rest for what is before it."""
REPLY_TIMEOUT = 0.03


class Boom(Exception):
    """What the application raises."""


@dataclass(eq=False)
class Call:
    """A call of the application."""

    what: str
    begun: float
    timeout: float | None = None
    ended: float | None = None
    how: str = ""


def leaves(error: BaseException) -> Iterator[BaseException]:
    """The errors in a group, however deep."""
    if isinstance(error, BaseExceptionGroup):
        for inner in error.exceptions:
            yield from leaves(inner)
    else:
        yield error
