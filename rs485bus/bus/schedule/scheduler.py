"""The procedures that the owner drives: they wait for jobs, times, halts and each other. Pure."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

from rs485bus.bus.clock import Clock
from rs485bus.bus.schedule.endings import Endings
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.schedule.timers import Timers
from rs485bus.bus.stopping.halt import Halt, Procedure

T = TypeVar("T")

_log = logging.getLogger("rs485bus")

_ROUNDS = 100
"""How often a procedure that waits for a time is resumed at the end, before it is taken for one that never ends."""


Failed = Callable[[Exception], None]


def unheeded(error: Exception) -> None:
    """Nobody waits for a procedure: that it failed is logged."""


class _End(NamedTuple, Generic[T]):
    """Who is to be told the end of a procedure: its result, or what it raised."""

    done: Callable[[T], None]
    failed: Failed


def _tell(listener: Callable[[T], None], told: T) -> None:
    try:
        listener(told)
    except Exception:
        _log.exception("who was to be told how something ended failed")


class Scheduler:
    """What the owner drives: procedures.

    Args:
        submit: takes a job that a procedure waits for.
        timers: call back a procedure that waits for a time.
        clock: the time.
    """

    __slots__ = ("_asleep", "_clock", "_submit", "_timers")

    def __init__(self, submit: Callable[[Job], None], timers: Timers, clock: Clock) -> None:
        self._submit = submit
        self._timers = timers
        self._asleep: dict[Procedure[Any], Callable[[], None]] = {}
        """The procedures that wait for a time, and what resumes each."""
        self._clock = clock

    def start(self, procedure: Procedure[T], done: Callable[[T], None], failed: Failed = unheeded) -> None:
        """Drive a procedure to its end, whatever becomes of who started it. One that raises has `failed`."""
        self._resume(procedure, _End(done, failed), None)

    def end_all(self) -> None:
        """The bus is closed: no time is waited for any more. What waits for a job or a halt is resumed by that."""
        for _ in range(_ROUNDS):
            if not self._asleep:
                return
            asleep, self._asleep = self._asleep, {}
            for resume in asleep.values():
                resume()
        _log.error("procedures that do not end were left at closing: %s", list(self._asleep))

    def _resume(self, procedure: Procedure[T], end: _End[T], value: Any) -> None:
        try:
            wanted = procedure.send(value)
            while isinstance(wanted, Halt | Endings) and wanted.told is not None:
                wanted = procedure.send(wanted.told)
        except StopIteration as over:
            _tell(end.done, over.value)
            return
        except Exception as error:
            _log.exception("a procedure of the bus failed")
            _tell(end.failed, error)
            return
        if isinstance(wanted, Job):
            wanted.on_end = lambda job: self._resume(procedure, end, job.ended_at)
            self._submit(wanted)
        elif isinstance(wanted, Halt | Endings):
            wanted.listen(lambda told: self._resume(procedure, end, told))
        else:
            self._sleep(procedure, wanted, lambda: self._resume(procedure, end, self._clock.now))

    def _sleep(self, procedure: Procedure[Any], until: float, resume: Callable[[], None]) -> None:
        def wake() -> None:
            if self._asleep.pop(procedure, None) is not None:
                resume()

        self._asleep[procedure] = resume
        self._timers.at(until, wake)
