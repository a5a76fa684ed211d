"""Jobs that nobody answers, in their turnaround. Pure."""

from __future__ import annotations

from rs485bus.bus.schedule.job import Job, Outcome, Reason
from rs485bus.bus.schedule.repeating import End
from rs485bus.bus.schedule.timers import Timers


class OneWay:
    """The broadcasts that are being carried out.

    Args:
        timers: calls back.
        end: ends a job.
    """

    __slots__ = ("_end", "_jobs", "_timers", "ends_at")

    def __init__(self, timers: Timers, end: End) -> None:
        self._timers = timers
        self._end = end
        self._jobs: list[Job] = []
        self.ends_at = float("inf")
        """When the latest of them must have gone out; infinity where there is none."""

    def __contains__(self, job: Job) -> bool:
        return job in self._jobs

    def add(self, job: Job, until: float) -> None:
        """The job's frame goes out. It is done at the time given."""
        self._jobs.append(job)
        self.ends_at = until
        self._timers.at(until, lambda: self.ended(job))

    def ended(self, job: Job, outcome: Outcome = Outcome.REPLY, reason: Reason = Reason.NONE) -> None:
        """The job has ended, if it is one of these."""
        if job in self._jobs:
            self._jobs.remove(job)
            if not self._jobs:
                self.ends_at = float("inf")
            self._end(job, outcome, reason)

    def end_all(self, outcome: Outcome, reason: Reason) -> None:
        """They all end so."""
        for job in tuple(self._jobs):
            self.ended(job, outcome, reason)
