"""How much of the wire stops may take to devices that do not answer, while others are guarded by watchdogs. Pure.

Whoever answers is stopped at once. A device that missed its last two attempts is hardly there, and each further stop
takes a whole reply timeout: said again and again it would keep the others from being fed, and trip them.
"""

from __future__ import annotations

SHARE = 0.2
"""The part of all time."""


class StopRation:
    """The account of the time spent on stopping devices that do not answer."""

    __slots__ = ("free_at",)

    def __init__(self) -> None:
        self.free_at = float("-inf")
        """When the next attempt may be made."""

    def spend(self, seconds: float, now: float) -> None:
        """So many seconds, until now, were spent in vain."""
        self.free_at = max(self.free_at, now - seconds) + seconds / SHARE
