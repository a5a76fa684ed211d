"""The event loop's clock; and how long the computer was suspended: it stands still then, and the drives do not."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable
from functools import partial

NOTICED = 0.1
"""Seconds from which on a suspension is one."""


def clock_of(loop: asyncio.AbstractEventLoop) -> Callable[[], float]:
    """`loop.time`, or what it calls and nothing else, which costs half as much. Virtual loops have their own."""
    plain = type(loop).time is asyncio.BaseEventLoop.time and "time" not in vars(loop)
    return time.monotonic if plain else loop.time


class Suspensions:
    """Notices that the computer was suspended: `clock() - now` is greater than `limit` then.

    The clock is to be asked before the time, so that what happens between the two is no suspension.

    Args:
        loop: the event loop, whose clock is `now`.
    """

    __slots__ = ("clock", "limit")

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        now = loop.time()
        clock = _running_on(now)
        self.clock: Callable[[], float] = clock or float
        """Goes on while the computer is suspended."""
        self.limit = float("inf") if clock is None else clock() - now + NOTICED

    def take(self, ahead: float) -> float:
        """Seconds for which the computer was suspended, where `ahead` is greater than the limit."""
        suspended = ahead - self.limit + NOTICED
        self.limit += suspended
        return suspended


def _running_on(now: float) -> Callable[[], float] | None:
    """A clock that goes on while the computer is suspended; None where the loop's own does, or is a virtual one."""
    if abs(now - time.monotonic()) > 0.1:
        return None
    # Windows counts the time of a suspension in.
    name = {"linux": "CLOCK_BOOTTIME", "darwin": "CLOCK_MONOTONIC_RAW"}.get(sys.platform, "")
    return partial(time.clock_gettime, getattr(time, name)) if name else None
