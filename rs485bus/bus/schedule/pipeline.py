"""Reads of plain units that are out at the same time, where each answer tells which request it is to. Pure.

Only what moves nothing, and changes nothing, is sent so. Everything else goes alone: it waits until these have ended.
A stop does not.
"""

from __future__ import annotations

from collections.abc import Callable

from rs485bus.bus.schedule.job import Job, Urgency
from rs485bus.bus.schedule.queue import READY
from rs485bus.bus.schedule.timers import Timer, Timers
from rs485bus.bus.units.unit_states import UnitStates
from rs485bus.bus.watchdog.feeding import Feeding

_FOREVER = float("inf")
_PLAIN = (Urgency.COMMAND, Urgency.POLL)


class Pipeline:
    """The requests that are out beside each other.

    Args:
        size: how many may be, at the most. With 1 none is.
        native: the device itself answers, so that it may be asked several things at once. A gateway could give the late
            answer of a slave to the wrong one of them: there one request a unit is out.
        units: what is known of each address.
        feeding: the armed watchdogs. While there are any, everything goes alone.
        timers: calls back.
        unanswered: told of a job that was not answered in its time.
    """

    __slots__ = ("_ebbs", "_feeding", "_native", "_timers", "_unanswered", "_units", "out", "size")

    def __init__(
        self,
        size: int,
        native: bool,
        units: UnitStates,
        feeding: Feeding,
        timers: Timers,
        unanswered: Callable[[Job], None],
    ) -> None:
        self.size = size
        self._native = native
        self._units = units
        self._feeding = feeding
        self._timers = timers
        self._unanswered = unanswered
        self.out: dict[Job, Timer] = {}
        """Those that are out, and when they will have been for too long."""
        self._ebbs = False
        """Something waits until none of these is out."""

    def is_out(self, job: Job) -> bool:
        """Whether a job is one of these."""
        return job in self.out

    def takes(self, job: Job) -> bool:
        """Whether a job is one that may be out beside others, where any may."""
        return (
            not (job.request.writes or job.internal or job.moves or self._feeding.armed)
            and job.urgency in _PLAIN
            and job.expects_reply
            and self._units[job.address].attached is None
        )

    def wait(self, job: Job) -> float:
        """Until when a job must wait for these that could go otherwise; READY if it need not. What goes alone lets no
        others pass."""
        if not self.out or job.urgency is Urgency.STOP:
            return READY
        if not self.takes(job):
            self._ebbs = True
        if self._ebbs or len(self.out) >= self.size:
            return _FOREVER
        if not self._native and any(out.address == job.address for out in self.out):
            return _FOREVER
        return READY

    def add(self, job: Job, until: float) -> None:
        """The job's frame goes out. It may be answered until the time given."""
        self._ebbs = False
        self.out[job] = self._timers.at(until, lambda: self._over(job))

    def leaves(self, job: Job) -> bool:
        """The job's attempt has ended. False if it is none of these."""
        timer = self.out.pop(job, None)
        if timer is None:
            return False
        self._timers.cancel(timer)
        return True

    def end_all(self) -> list[Job]:
        """No answer can come any more."""
        jobs = list(self.out)
        for job in jobs:
            self.leaves(job)
        return jobs

    def _over(self, job: Job) -> None:
        if self.out.pop(job, None) is not None:
            self._unanswered(job)
