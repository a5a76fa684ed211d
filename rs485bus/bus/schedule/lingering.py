"""Jobs whose last attempt may be answered still, while others are served. Pure."""

from __future__ import annotations

from collections.abc import Callable

from rs485bus.bus.schedule.job import Job
from rs485bus.bus.schedule.timers import Timer, Timers


class Lingering:
    """The jobs that were waited for as long as their unit usually takes, and not as long as it may take.

    Args:
        timers: calls back.
        over: told of a job whose time is over.
    """

    __slots__ = ("_jobs", "_over", "_timers")

    def __init__(self, timers: Timers, over: Callable[[Job], None]) -> None:
        self._timers = timers
        self._over = over
        self._jobs: dict[Job, Timer] = {}

    def add(self, job: Job, until: float) -> None:
        """The job may be answered until the time given."""
        self._jobs[job] = self._timers.at(until, lambda: self._end(job))

    def leaves(self, job: Job) -> bool:
        """The job has ended. False if it is none of these."""
        timer = self._jobs.pop(job, None)
        if timer is None:
            return False
        self._timers.cancel(timer)
        return True

    def end_all(self) -> list[Job]:
        """No answer can come any more."""
        jobs = list(self._jobs)
        for job in jobs:
            self.leaves(job)
        return jobs

    def _end(self, job: Job) -> None:
        if self._jobs.pop(job, None) is not None:
            self._over(job)
