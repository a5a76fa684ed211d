"""What the owner does later: timers, and procedures that wait for jobs, times and halts. Pure."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable
from typing import Any, TypeVar

from rs485bus.bus.schedule.job import Job
from rs485bus.bus.stopping.halt import Halt, Procedure

T = TypeVar("T")


class Scheduler:
    """Timers and procedures.

    Args:
        submit: takes a job that a procedure waits for.
    """

    __slots__ = ("_number", "_submit", "_timers", "now")

    def __init__(self, submit: Callable[[Job], None], now: float) -> None:
        self._submit = submit
        self._timers: list[tuple[float, int, Callable[[], None]]] = []
        self._number = itertools.count()
        self.now = now

    @property
    def next_at(self) -> float:
        """When the next timer is due."""
        return self._timers[0][0] if self._timers else float("inf")

    def at(self, when: float, callback: Callable[[], None]) -> None:
        """Call back when the time has come."""
        heapq.heappush(self._timers, (when, next(self._number), callback))

    def run(self, now: float) -> None:
        """Call what is due."""
        self.now = now
        while self._timers and self._timers[0][0] <= now:
            heapq.heappop(self._timers)[2]()

    def clear(self) -> None:
        """Forget all timers, and with them the procedures that wait for a time."""
        self._timers.clear()

    def start(self, procedure: Procedure[T], done: Callable[[T], None]) -> None:
        """Drive a procedure to its end, whatever becomes of who started it."""
        self._resume(procedure, done, None)

    def _resume(self, procedure: Procedure[T], done: Callable[[T], None], value: Any) -> None:
        try:
            wanted = procedure.send(value)
            while isinstance(wanted, Halt) and wanted.told is not None:
                wanted = procedure.send(wanted.told)
        except StopIteration as end:
            done(end.value)
            return
        if isinstance(wanted, Job):
            wanted.on_end = lambda job: self._resume(procedure, done, job.ended_at)
            self._submit(wanted)
        elif isinstance(wanted, Halt):
            wanted.listen(lambda halted: self._resume(procedure, done, halted))
        else:
            self.at(wanted, lambda: self._resume(procedure, done, self.now))
