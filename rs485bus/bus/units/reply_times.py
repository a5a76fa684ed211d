"""How long one unit takes to answer, learned from its answers. Pure.

The way of TCP's retransmission timer (RFC 6298): a mean and a deviation. Karn's rule: an answer that may belong to an
older attempt teaches nothing. A request that was missed waits longer from then on, until an answer to it is
unmistakable again. All times are seconds from the end of a request's airtime to the begin of the reply.
"""

from __future__ import annotations

import enum
from collections import OrderedDict

from rs485bus.bus.schedule.job import FEED, Job

MARGIN = 0.0015
"""What is added to every learned time."""
_ENOUGH = (1, 3, 3)
"""Answers after which a learned time counts, by kind: a read that is repeated for nothing costs one transaction."""
_GAIN = 1 / 8
_DEVIATION_GAIN = 1 / 4
_DEVIATIONS = 4
_BACKOFF = 1.25
_CHANCE = 0.15
"""Attempts in a row that the line loses more often than that are no sign that the unit takes longer."""
_LONGEST = 10.0
_UNKNOWN = float("inf")
_SLOW_REQUESTS = 32
"""How many requests are remembered that take longer than the others."""


class RequestKind(enum.IntEnum):
    """Requests of one kind take a unit about the same time."""

    READ = 0
    WRITE = 1
    FEED = 2


_READS, _WRITES, _FEEDS = RequestKind


class _Estimate:
    """A mean and a mean deviation."""

    __slots__ = ("_enough", "deviation", "mean", "samples", "wait")

    def __init__(self, enough: int) -> None:
        self._enough = enough
        self.mean = 0.0
        self.deviation = 0.0
        self.samples = 0
        self.wait = _UNKNOWN
        """How long a reply is waited for."""

    def learn(self, took: float) -> None:
        if not self.samples:
            self.mean, self.deviation = took, took / 4
        else:
            error = took - self.mean
            self.mean += _GAIN * error
            self.deviation += _DEVIATION_GAIN * (abs(error) - self.deviation)
        self.samples += 1
        if self.samples >= self._enough:
            self.wait = self.mean + _DEVIATIONS * self.deviation + MARGIN

    @property
    def latest(self) -> float:
        """Within how many seconds a reply should begin; 0 where that is not known."""
        if self.wait < _UNKNOWN:
            return self.wait
        return 1.5 * self.mean + MARGIN if self.samples else 0.0


class ReplyTimes:
    """The reply times of one unit.

    A request is told apart from others of its kind only where it was missed: a register that the unit takes long for
    does not slow the others down.
    """

    __slots__ = ("_kinds", "_slow")

    def __init__(self) -> None:
        self._kinds = tuple(_Estimate(enough) for enough in _ENOUGH)
        self._slow: OrderedDict[bytes, float] = OrderedDict()
        """How long requests are waited for that were missed, by their frames."""

    def wait(self, job: Job, longest: float) -> float:
        """How long the begin of the reply to the job's next attempt is waited for before others are served.

        Args:
            job: what is asked. It may have been missed before.
            longest: the longest time the unit may take.
        """
        kind = _kind(job)
        wait = self._kinds[kind].wait
        if kind is _READS and wait < (fed := self._kinds[_FEEDS].wait) < _UNKNOWN:
            wait = fed  # feeds are reads, too, and wait for whatever comes: they find out that the unit has become slow
        if self._slow and wait < _UNKNOWN:
            wait = max(wait, self._slow.get(job.request.adu, 0.0))
        return wait if wait < longest else longest

    def answered(self, job: Job, took: float) -> None:
        """A job was answered, unmistakably, after so many seconds."""
        estimate = self._kinds[_kind(job)]
        if self._slow and (key := job.request.adu) in self._slow:
            if took + MARGIN > estimate.wait:
                self._slow[key] = 1.5 * took + MARGIN
                return
            del self._slow[key]
        estimate.learn(took if took > 0.0 else 0.0)

    def missed(self, job: Job, lost: float = 0.0) -> None:
        """The job's latest attempt was not answered within the time it was waited for, on a line that loses a share."""
        estimate, key = self._kinds[_kind(job)], job.request.adu
        if estimate.wait == _UNKNOWN or job.backs_off:
            return  # a question that backs off waits between its repetitions, not for each
        if lost ** max(1, job.unanswered) > _CHANCE:
            return
        self._slow[key] = min(_LONGEST, _BACKOFF * max(estimate.wait, self._slow.get(key, 0.0)))
        self._slow.move_to_end(key)
        if len(self._slow) > _SLOW_REQUESTS:
            self._slow.popitem(last=False)

    def waits(self) -> dict[str, float]:
        """How long requests of each kind are waited for, in seconds, where that is known."""
        learned = ((kind.name.lower(), self.learned(kind)) for kind in RequestKind)
        return {name: wait for name, wait in learned if wait is not None}

    def expected(self, job: Job) -> tuple[float, float]:
        """The earliest and the latest time at which the reply to a job should begin; 0 where that is not known."""
        for kind in (self._kinds[_kind(job)], *self._kinds):
            if kind.samples:
                return 2 * kind.mean - kind.latest, kind.latest
        return 0.0, 0.0

    @property
    def usual(self) -> float:
        """After how many seconds it usually begins to answer a read; 0 where that is not known."""
        estimates = (self._kinds[kind] for kind in (RequestKind.READ, RequestKind.FEED, RequestKind.WRITE))
        return next((estimate.mean for estimate in estimates if estimate.samples), 0.0)

    @property
    def longest(self) -> float:
        """Within how many seconds the reply to any request should begin; 0 where that is not known."""
        return max(estimate.latest for estimate in self._kinds)

    def learned(self, kind: RequestKind) -> float | None:
        """How long such a request is waited for; None while that is not known."""
        wait = self._kinds[kind].wait
        return wait if wait < _UNKNOWN else None


def _kind(job: Job) -> RequestKind:
    if job.request.writes:
        return _WRITES
    return _FEEDS if job.urgency is FEED else _READS
