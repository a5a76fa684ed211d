"""What is to be called at a time. Pure.

A timer that was cancelled holds nothing, and its place is given back before long: a million requests that were
answered long before their time was over leave nothing behind.
"""

from __future__ import annotations

import heapq
import itertools
import logging
from collections.abc import Callable

_log = logging.getLogger("rs485bus")

_FOREVER = float("inf")
_SAME = 1e-4
"""Seconds that make no difference."""
_FEW = 64
"""Cancelled timers that are not worth being tidied up."""


class Timer:
    """One call to come."""

    __slots__ = ("callback",)

    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback: Callable[[], None] | None = callback
        """None once it was called or cancelled."""


class Timers:
    """The calls to come, the earliest first."""

    __slots__ = ("_cancelled", "_heap", "_number", "next_at")

    def __init__(self) -> None:
        self._heap: list[tuple[float, int, Timer]] = []
        self._number = itertools.count()
        self._cancelled = 0
        """How many of those in the heap were cancelled."""
        self.next_at = _FOREVER
        """When the next one is due, in seconds; infinity where there is none."""

    def __len__(self) -> int:
        return len(self._heap)

    def at(self, when: float, callback: Callable[[], None]) -> Timer:
        """Call back when the time has come."""
        timer = Timer(callback)
        heapq.heappush(self._heap, (when, next(self._number), timer))
        if when < self.next_at:
            self.next_at = when
        return timer

    def cancel(self, timer: Timer) -> None:
        """Do not call back, if that has not happened yet."""
        if timer.callback is None:
            return
        timer.callback = None
        self._cancelled += 1
        heap = self._heap
        if self._cancelled > _FEW and 2 * self._cancelled > len(heap):
            self._heap = heap = [entry for entry in heap if entry[2].callback is not None]
            heapq.heapify(heap)
            self._cancelled = 0
        while heap and heap[0][2].callback is None:
            heapq.heappop(heap)
            self._cancelled -= 1
        self._look()

    def run(self, now: float) -> None:
        """Call what is due."""
        while self.next_at <= now:
            timer = heapq.heappop(self._heap)[2]
            self._look()
            callback, timer.callback = timer.callback, None
            if callback is None:
                self._cancelled -= 1
            else:
                try:
                    callback()
                except Exception:
                    _log.exception("what was to be called at a time failed")

    def clear(self) -> None:
        """Call nothing of all that."""
        for _, _, timer in self._heap:
            timer.callback = None
        self._heap = []
        self._cancelled = 0
        self._look()

    def _look(self) -> None:
        """See when the next one is due."""
        self.next_at = self._heap[0][0] if self._heap else _FOREVER


class Wake:
    """Calls back, once, at the earliest of the times that were asked for since it last did.

    Args:
        call_at: calls back at a time.
        callback: what is called.
    """

    __slots__ = ("_at", "_call_at", "_callback")

    def __init__(self, call_at: Callable[[float, Callable[[], None]], object], callback: Callable[[], None]) -> None:
        self._call_at = call_at
        self._callback = callback
        self._at = _FOREVER

    def at(self, when: float) -> None:
        """Call back at this time, if not sooner. Infinity is never."""
        if when < self._at - _SAME and when < _FOREVER:
            self._at = when
            self._call_at(when, self._go_off)

    def _go_off(self) -> None:
        self._at = _FOREVER
        self._callback()
