"""Which late replies may still arrive from one unit, and what must wait for them. Pure.

RTU has no transaction number: a reply that comes late looks like the answer to the next equal request. So every
attempt that was not answered is *owed*, until its reply arrives, until a later answer proves that it never will, or
until its time is over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rs485bus.bus.schedule.job import Job
from rs485bus.wire.frames import Request


@dataclass(slots=True)
class PendingReply:
    """A reply that may still arrive."""

    request: Request
    job: Job
    sent_at: float
    until: float


class PendingReplies:
    """The replies one unit may still owe.

    Args:
        in_order: bytes come in the order in which they were asked for. Not so behind a TCP gateway.
    """

    __slots__ = ("_in_order", "_owed")

    def __init__(self, in_order: bool = True) -> None:
        self._in_order = in_order
        self._owed: list[PendingReply] = []

    def __bool__(self) -> bool:
        return bool(self._owed)

    def expire(self, now: float) -> None:
        """Forget what can arrive no more."""
        if self._owed:
            self._owed = [owed for owed in self._owed if owed.until > now]

    def unanswered(self, job: Job, until: float) -> None:
        """The job's latest attempt got no reply; one may arrive until the time given."""
        self._owed.append(PendingReply(job.request, job, job.sent_at, until))

    def must_wait(self, request: Request, job: Job | None = None) -> float:
        """Until when a request must wait lest it be answered by an older one's reply; 0 if it need not.

        A further attempt of the same job may be answered by either reply.
        """
        alike = (owed.until for owed in self._owed if owed.job is not job and owed.request.may_answer(request))
        return max(alike, default=0.0)

    def hides_refusal(self, job: Job) -> bool:
        """Whether a refusal inside a normal reply, that fits the job, may belong to an older request."""
        return any(owed.job is not job and owed.request.may_refuse(job.request) for owed in self._owed)

    def hides_exception(self, job: Job) -> bool:
        """Whether an exception that fits the job may belong to an older request: it carries only the function."""
        return any(owed.job is not job and owed.request.function == job.request.function for owed in self._owed)

    def answered(self, job: Job, until: float) -> float:
        """The job was answered. Returns when the oldest attempt was sent that this reply may answer.

        Where that is not the latest one, a reply is still owed, until the time given. What is older than the attempt
        answered will not arrive any more.
        """
        if not self._owed:
            return job.sent_at
        alike = [owed for owed in self._owed if owed.request.may_answer(job.request)]
        since = min((owed.sent_at for owed in alike), default=job.sent_at)
        self._forget_before(since)
        if alike:
            self._owed.remove(min(alike, key=lambda owed: owed.sent_at))
            self.unanswered(job, until)
        return since

    def arrived(self, request: Request) -> float | None:
        """A late reply to such a request arrived: the oldest one's. Returns when that was sent."""
        return self._settle([owed for owed in self._owed if owed.request.may_answer(request)])

    def excepted(self, function: int) -> None:
        """A late exception arrived for a function: the oldest request's."""
        self._settle([owed for owed in self._owed if owed.request.function == function])

    def __iter__(self) -> Iterator[PendingReply]:
        return iter(self._owed)

    def _settle(self, alike: list[PendingReply]) -> float | None:
        if not alike:
            return None
        oldest = min(alike, key=lambda owed: owed.sent_at)
        self._owed.remove(oldest)
        self._forget_before(oldest.sent_at)
        return oldest.sent_at

    def _forget_before(self, sent_at: float) -> None:
        if self._in_order:
            self._owed = [owed for owed in self._owed if owed.sent_at >= sent_at]
