"""Doing something every so many seconds, however long it takes itself. Pure."""

from __future__ import annotations


class Pace:
    """Says how long to wait for the next turn. What takes longer than a turn is followed at once, and not caught up on.

    Args:
        every: seconds from one turn to the next.
        now: when the first one begins.
    """

    def __init__(self, every: float, now: float) -> None:
        self._every = every
        self._next = now

    def left(self, now: float) -> float:
        """Seconds until the next turn begins."""
        self._next = max(self._next + self._every, now)
        return self._next - now
