"""The procedures that the owner drives: they wait for jobs, times, halts and each other. Pure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from rs485bus.bus.schedule.endings import Endings
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.schedule.timers import Timers
from rs485bus.bus.stopping.halt import Halt, Procedure

T = TypeVar("T")


class Scheduler:
    """What the owner drives: procedures.

    Args:
        submit: takes a job that a procedure waits for.
        timers: call back a procedure that waits for a time.
    """

    __slots__ = ("_submit", "_timers", "now")

    def __init__(self, submit: Callable[[Job], None], timers: Timers, now: float) -> None:
        self._submit = submit
        self._timers = timers
        self.now = now

    def start(self, procedure: Procedure[T], done: Callable[[T], None]) -> None:
        """Drive a procedure to its end, whatever becomes of who started it."""
        self._resume(procedure, done, None)

    def _resume(self, procedure: Procedure[T], done: Callable[[T], None], value: Any) -> None:
        try:
            wanted = procedure.send(value)
            while isinstance(wanted, Halt | Endings) and wanted.told is not None:
                wanted = procedure.send(wanted.told)
        except StopIteration as end:
            done(end.value)
            return
        if isinstance(wanted, Job):
            wanted.on_end = lambda job: self._resume(procedure, done, job.ended_at)
            self._submit(wanted)
        elif isinstance(wanted, Halt | Endings):
            wanted.listen(lambda told: self._resume(procedure, done, told))
        else:
            self._timers.at(wanted, lambda: self._resume(procedure, done, self.now))
