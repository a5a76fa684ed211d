"""How much of the wire stops may take to devices that do not answer, while others are guarded by watchdogs. Pure.

Whoever answers is stopped at once. A device that missed its last two attempts is hardly there, and each further stop
takes a whole reply timeout: said again and again it would keep the others from being fed, and trip them.
"""

from __future__ import annotations

SHARE = 0.2
"""The part of all time."""
SILENT = 2
"""Attempts in a row without an answer after which stops to a device are rationed."""


class StopRation:
    """The account of the time spent on stopping devices that do not answer."""

    __slots__ = ("_free_at",)

    def __init__(self) -> None:
        self._free_at = float("-inf")

    def spend(self, seconds: float, now: float) -> None:
        """So many seconds, until now, were spent in vain."""
        self._free_at = max(self._free_at, now - seconds) + seconds / SHARE

    def free_at(self) -> float:
        """When the next attempt may be made."""
        return self._free_at
