"""Quiet before a request to a unit that wants more of it than others do. Pure.

Others go first for a while, for the pair may fall quiet by itself. A request that has waited for one pause has the pair
kept quiet for it: nothing but stops goes before it then. So it goes after two pauses and a transaction, and a unit
that wants quiet takes no more than half of the time from its neighbours.
"""

from __future__ import annotations

from rs485bus.bus.line.serial_line import SerialLine
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.schedule.queue import READY


class PauseKeeper:
    """Who waits for quiet.

    Args:
        pair: the pair, which knows since when it is quiet.
    """

    __slots__ = ("_pair", "held", "until")

    def __init__(self, pair: SerialLine) -> None:
        self._pair = pair
        self.held: Job | None = None
        """The job that the pair is kept quiet for."""
        self.until = 0.0
        """When the latest job that was asked about may go."""

    def wait(self, job: Job, pause: float, now: float) -> float:
        """Until when a job must wait for quiet; READY if it need not."""
        self.until = self.quiet_for(pause)
        if self.until <= now:
            job.wants_quiet_since = None
            return READY
        if job.wants_quiet_since is None:
            job.wants_quiet_since = now
        if self.held is None and now >= job.wants_quiet_since + pause:
            self.held = job
        return self.until

    def quiet_for(self, pause: float) -> float:
        """When the pair will have been quiet for so many seconds, if nothing is sent until then."""
        return self._pair.quiet_at - self._pair.silence + pause
