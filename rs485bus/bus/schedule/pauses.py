"""Quiet before a request to a unit that wants more of it than others do. Pure.

Others go first for a while, for the pair may fall quiet by itself. A request that has waited for one pause has the pair
kept quiet for it: nothing but stops goes before it then. So it goes after two pauses and a transaction, and a unit
that wants quiet takes no more than half of the time from its neighbours. Where a stop or noise breaks the quiet, the
others go on, and it is tried again later; in the end it is given up. What the bus itself asks, to feed a watchdog or to
see a motor stand, goes out then all the same.
"""

from __future__ import annotations

from rs485bus.bus.line.serial_line import SerialLine
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.schedule.queue import READY

_TRIES = 8
"""How often the pair is kept quiet for one request until it is given up: it is noise that breaks it."""
_NOT_YET = float("-inf")


class Wish:
    """The wish of one job for quiet."""

    __slots__ = ("hold_from", "tries")

    def __init__(self, hold_from: float) -> None:
        self.hold_from = hold_from
        """When the pair may be kept quiet for it."""
        self.tries = 0
        """How often it was, in vain."""


class PauseKeeper:
    """Who waits for quiet.

    Args:
        pair: the pair, which knows since when it is quiet.
    """

    __slots__ = ("_feed", "_feed_over", "_pair", "_until", "_wishes", "held", "until")

    def __init__(self, pair: SerialLine) -> None:
        self._pair = pair
        self._wishes: dict[Job, Wish] = {}
        self.held: Job | None = None
        """The job that the pair is kept quiet for."""
        self._until = _NOT_YET
        """When that quiet will have lasted for long enough, unless it is broken."""
        self.until = 0.0
        """When the latest job that was asked about may go."""
        self._feed = 0
        self._feed_over = 0.0

    def wait(self, job: Job, pause: float, now: float) -> float:
        """Until when a job must wait for quiet; READY if it need not."""
        self.until = self.quiet_for(pause)
        wish = self._wishes.get(job)
        if self.until <= now or (wish is not None and wish.tries and job.internal):
            self._wishes.pop(job, None)
            return READY
        if wish is None:
            self._forget_the_ended()
            wish = self._wishes[job] = Wish(now + pause)
        if self.held is None and now >= wish.hold_from:
            self.held, self._until = job, _NOT_YET  # whoever is chosen in the same moment goes first yet
        return self.until

    def is_hopeless(self, job: Job, now: float) -> bool:
        """The pair was kept quiet for the job that waits yet: release it where that was in vain.

        True where it was so often in vain that the job is to be given up.
        """
        if self._until == _NOT_YET:
            self._until = self.until
        wish = self._wishes.get(job)
        if wish is None or self.until <= self._until:
            return False
        wish.tries += 1
        wish.hold_from = now + self.until - self._until
        self.held = None
        return wish.tries >= _TRIES

    def wait_to_feed(self, address: int, pause: float, now: float) -> float:
        """Until when a feed must wait for quiet; READY if it need not. It waits for no more than two pauses."""
        until = self.quiet_for(pause)
        if self._feed != address:
            self._feed, self._feed_over = address, now + 2 * pause
        if min(until, self._feed_over) <= now:
            self._feed = 0
            return READY
        return min(until, self._feed_over)

    def quiet_for(self, pause: float) -> float:
        """When the pair will have been quiet for so many seconds, if nothing is sent until then."""
        return self._pair.quiet_at - self._pair.silence + pause

    def _forget_the_ended(self) -> None:
        self._wishes = {job: wish for job, wish in self._wishes.items() if job.outcome is None}
