"""The time, as the parts of one bus agree on it. Pure."""

from __future__ import annotations


class Clock:
    """Holds the time of the latest call, in seconds on one steady clock. Only the owner sets it."""

    __slots__ = ("now",)

    def __init__(self, now: float) -> None:
        self.now = now
