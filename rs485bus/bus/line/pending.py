"""Which late replies may still arrive from one unit, and what must wait for them. Pure.

RTU has no transaction number: a reply that comes late looks like the answer to the next equal request. So every
attempt that was not answered is *owed*, until its reply arrives, until a later answer proves that it never will, or
until its time is over. What a device has accepted only (exception 05) is owed as well: the device may answer by itself
when it has done it, whatever it was asked meanwhile.

Where it is not clear whose reply a frame is, too much is taken to be owed rather than too little: a request waits then
that need not, but none is given the answer to another.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rs485bus.bus.line.answers_alike import AnswersAlike
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.units.motion import NEVER
from rs485bus.wire.exceptions import is_a_gateways, is_exception
from rs485bus.wire.frames import Request

_TIMES = 2
"""How many times as often as it takes at best something is asked to find out whether its answer is a late reply."""
_OUTLIVED = 12
"""Answers in a row, each to a request that was waited for, that cannot all have been late."""


@dataclass(slots=True)
class PendingReply:
    """A reply that may still arrive."""

    request: Request
    job: Job
    sent_at: float
    until: float
    accepted: bool = False
    """The device has said that it is at it: no later answer proves that this one will not come."""
    # Where replies may overtake each other, it may have answered a later request, whose own reply is late then:
    lives: float = 0.0
    """Seconds from sending within which a reply comes, or never does."""
    is_anothers: bool = False
    """A later request may have been for something else."""
    is_passed: bool = False
    """Something sent later had an unmistakable answer: none comes where replies keep their order."""
    outlived: int = 0
    """How many answers that look like it came after its own time was over."""

    @property
    def is_over(self) -> bool:
        """Whether none can come any more: each of so many replies would have been late, and been taken for the answer
        to the next request."""
        return self.is_passed and self.outlived >= _OUTLIVED and not self.accepted


@dataclass(slots=True)
class _Heard:
    """A frame that came while replies were owed. It may come a second time."""

    since: float
    """When the oldest request was sent that it may have answered."""
    until: float
    """When no copy of it is expected any more."""
    attempt: tuple[Job, float] | None
    """The attempt that was on the wire and that it left undecided, as job and time of sending."""
    came_again: bool = False
    """It has come a second time."""
    came_after: float = float("inf")
    """When the request was sent that was on the wire as it came; infinity where that is not known."""


class PendingReplies:
    """The replies one unit may still owe.

    Args:
        in_order: bytes come in the order in which they were asked for. Not so behind a TCP gateway.
    """

    __slots__ = ("_answers", "_heard", "in_order", "owed")

    def __init__(self, in_order: bool = True) -> None:
        self.in_order = in_order
        """Whether bytes come in the order in which they were asked for."""
        self.owed: list[PendingReply] = []
        self._heard: dict[bytes, _Heard] = {}
        self._answers: dict[bytes, AnswersAlike] = {}
        """What came while replies were owed that look like it, by how it begins. Where replies may overtake each
        other."""

    def __bool__(self) -> bool:
        return bool(self.owed)

    def __iter__(self) -> Iterator[PendingReply]:
        return iter(self.owed)

    def expire(self, now: float) -> None:
        """Forget what can arrive no more."""
        if self.owed:
            self.owed = [owed for owed in self.owed if owed.until > now]
            if not self.owed:
                self._answers.clear()
        if self._heard:
            self._heard = {frame: heard for frame, heard in self._heard.items() if heard.until > now}

    def prolong(self, until: float, most: float) -> None:
        """None came yet: they may arrive until the time given, but not longer than `most` after they were asked for."""
        for owed in self.owed:
            owed.until = max(owed.until, min(until, owed.sent_at + most))

    @property
    def are_settled_by_answers(self) -> bool:
        """Whether an answer to something sent later proves that some of them will never come."""
        return self.in_order and not all(owed.accepted for owed in self.owed)

    def unanswered(self, job: Job, until: float, *, accepted: bool = False) -> None:
        """The job's latest attempt got no reply, or was accepted only; one may arrive until the time given."""
        self.owed.append(PendingReply(job.request, job, job.sent_at, until, accepted, until - job.sent_at))
        if not self.in_order:
            self._is_asked(job.request)

    def must_wait(self, request: Request, job: Job | None = None) -> float:
        """Until when a request must wait lest it be answered by an older one's reply; 0 if it need not.

        A further attempt of the same job may be answered by either reply.
        """
        alike = (owed.until for owed in self.owed if owed.job is not job and owed.request.may_answer(request))
        return max(alike, default=0.0)

    def hides_refusal(self, job: Job) -> bool:
        """Whether a refusal inside a normal reply, that fits the job, may belong to an older request."""
        return any(owed.job is not job and owed.request.may_refuse(job.request) for owed in self.owed)

    def hides_exception(self, job: Job, frame: bytes = b"") -> bool:
        """Whether an exception that fits the job may belong to an older request: it carries only the function. What the
        device has accepted no gateway gives up."""
        alike = (owed for owed in self.owed if owed.request.function == job.request.function)
        return any(owed.job is not job and not (owed.accepted and is_a_gateways(frame)) for owed in alike)

    def answered(self, job: Job, until: float, frame: bytes = b"") -> float:
        """The job was answered, by `frame`. Returns when the oldest request was sent that this reply may answer.

        Where that is not the latest attempt, a reply is still owed, until the time given. What is older than the
        attempt answered will not arrive any more, where replies come in order.
        """
        if not self.owed:
            return job.sent_at
        if not self.in_order:
            return self._answered_in_any_order(job, until, frame)
        heard = self._heard.get(frame)
        if heard is not None and not heard.came_again:
            # There is one copy at most: of two that came after something was asked, one is its answer.
            heard.came_again = True
            self.unanswered(job, until)  # it may be a copy
            return heard.since
        alike = [owed for owed in self.owed if _may_give(owed.request, frame, job.request)]
        since = min((owed.sent_at for owed in alike), default=job.sent_at)
        self._no_copies_of_what_came_before(since)
        self._settle(alike, frame, job.request, job.sent_at)
        self._forget_before(since)
        if alike:
            self.unanswered(job, until)
        return since

    def _answered_in_any_order(self, job: Job, until: float, frame: bytes) -> float:
        """The same where replies may overtake each other; NEVER where it may be the reply to something else.

        As many replies are owed as before: if this was one of them, that to the job's latest attempt is.
        """
        alike = [owed for owed in self.owed if _may_give(owed.request, frame, job.request)]
        for owed in self.owed:
            owed.is_passed = owed.is_passed or (owed.sent_at < job.sent_at and owed not in alike)
        if not alike:
            return job.sent_at
        self._is_asked(job.request)
        self._heard[frame] = _Heard(min(owed.sent_at for owed in alike), until, None)
        answers = self._answers.setdefault(job.request.prefix, AnswersAlike(job.request))
        answers.came(frame, job.sent_at, len(alike))
        since = max(answers.since(), min(_asked_since(owed, job) for owed in alike))
        for owed in alike:
            owed.is_anothers = owed.is_anothers or owed.request.adu != job.request.adu
            owed.outlived += job.sent_at > owed.sent_at + owed.lives
            owed.until = max(owed.until, until)
        self.owed = [owed for owed in self.owed if not owed.is_over]
        if not all(_look_the_same(owed.request, job.request) for owed in alike):
            self.unanswered(job, until)  # its reply may be taken for the answer to what theirs cannot
        return since

    def _is_asked(self, request: Request) -> None:
        """Its answers may be taken for those to something else that was asked before: they are counted no further."""
        others = (one for one, answers in self._answers.items() if request.adu != answers.request.adu)
        for one in [one for one in others if request.may_answer(self._answers[one].request)]:
            del self._answers[one]

    def asked_in_turn(self, job: Job, since: float) -> float:
        """When a reply that differs from the one before was asked for, if it has overtaken none: so what moves is seen.
        That it stands, an answer must prove that came again. `since`: what `answered` has said.
        """
        answers = self._answers.get(job.request.prefix)
        if answers is None or since == NEVER or since == job.sent_at or not answers.is_news:
            return since
        return max(since, answers.in_turn(self.count(job.request, job.reply)))

    def may_be_decided(self, job: Job) -> bool:
        """Whether to ask a job again may show that its answer is no late reply. A look of the bus' own gives way where
        each answer is another one: what it looks at moves."""
        answers = self._answers.get(job.request.prefix)
        moves = answers is None or (answers.is_news and (job.weighed > 0 or job.answered_since > NEVER))
        needed = AnswersAlike.needed(self.count(job.request, job.reply))
        return not (moves and job.internal) and job.weighed < _TIMES * needed

    def count(self, request: Request, frame: bytes) -> int:
        """How many replies are owed that may be a frame which fits a request."""
        return sum(_may_give(owed.request, frame, request) for owed in self.owed)

    def latest(self, request: Request, frame: bytes) -> float:
        """When the latest one was sent that a late reply may answer; NEVER if there is none, and where a gateway may
        have kept it."""
        alike = (owed.sent_at for owed in self.owed if self.in_order and _may_give(owed.request, frame, request))
        return max(alike, default=NEVER)

    def arrived(self, request: Request, frame: bytes = b"") -> float | None:
        """A late reply to such a request arrived. Returns when the oldest one was sent that it may answer; None for
        a copy, or if there is none."""
        return self._came(frame, [owed for owed in self.owed if _may_give(owed.request, frame, request)])

    def waiting(self, request: Request, frame: bytes) -> Job | None:
        """The job that a late reply answers, where it can be no other's: it waits for a repetition, or for its time to
        be over. None if there is none, or for a copy."""
        if frame in self._heard or request.writes or not self.in_order:
            return None
        jobs = {owed.job for owed in self.owed if _may_give(owed.request, frame, request)}
        job = jobs.pop() if len(jobs) == 1 else None
        return job if job is not None and job.outcome is None and job.read_back is None else None

    def excepted(self, function: int, frame: bytes = b"") -> None:
        """A late exception arrived for a function."""
        if not is_a_gateways(frame):
            self._came(frame, [owed for owed in self.owed if owed.request.function == function])

    def leaves_undecided(self, job: Job, frame: bytes) -> bool:
        """Whether a refusal that fits the job on the wire may belong to something older, and so decides nothing.

        Where replies come in order, the oldest that it fits has then arrived with it, or never will.
        """
        heard = self._heard.get(frame)
        if heard is not None and heard.attempt == (job, job.sent_at):
            return True  # it may be a copy
        if not self.owed or not (self.hides_exception(job, frame) if is_exception(frame) else self.hides_refusal(job)):
            return False
        older = [owed for owed in self.owed if owed.request.answered_by(frame)]
        until = max((owed.until for owed in older), default=job.sent_at)
        if self.in_order and not is_a_gateways(frame):
            self._came(frame, older)
        self._heard[frame] = _Heard(job.sent_at, until, (job, job.sent_at))
        return True

    def _came(self, frame: bytes, alike: list[PendingReply]) -> float | None:
        if not alike or frame in self._heard:
            return None
        since = min(owed.sent_at for owed in alike)
        self._settle(alike, frame, alike[0].request)
        if self.in_order:
            self._forget_before(since)
        return since

    def _settle(
        self, alike: list[PendingReply], frame: bytes, request: Request, came_after: float = float("inf")
    ) -> None:
        """Strike out the oldest of some replies, one of which came.

        Where replies may overtake each other, the others tell as much as the oldest only if all look the same.
        """
        if not alike:
            return
        if frame:
            since, until = min(owed.sent_at for owed in alike), max(owed.until for owed in alike)
            self._heard[frame] = _Heard(since, until, None, came_after=came_after)
        if self.in_order or all(_look_the_same(owed.request, request) for owed in alike):
            oldest = min(alike, key=lambda owed: owed.sent_at)
            self.owed.remove(oldest)
            if not self.in_order:
                self._leave_as_old(oldest, [owed for owed in alike if owed is not oldest])

    def _leave_as_old(self, gone: PendingReply, others: list[PendingReply]) -> None:
        """One of some replies came, and it need not be the oldest: the others are as old."""
        for owed in others:
            owed.is_anothers = owed.is_anothers or gone.is_anothers or owed.request.adu != gone.request.adu
            owed.sent_at, owed.lives = gone.sent_at, owed.lives + owed.sent_at - gone.sent_at

    def _no_copies_of_what_came_before(self, sent_at: float) -> None:
        """What was sent at that time was answered: a copy of what came before would have come before that answer."""
        if self._heard:
            self._heard = {frame: heard for frame, heard in self._heard.items() if heard.came_after >= sent_at}

    def _forget_before(self, sent_at: float) -> None:
        self.owed = [owed for owed in self.owed if owed.accepted or owed.sent_at >= sent_at]


def _may_give(owed: Request, frame: bytes, request: Request) -> bool:
    """Whether a frame that fits `request` may be the reply to one that is owed."""
    return owed.answered_by(frame) if frame else owed.may_answer(request)


def _asked_since(owed: PendingReply, job: Job) -> float:
    """When, or later, the answer to a job was asked for that may be owed; NEVER if it may be one to something else."""
    if owed.is_anothers or owed.request.adu != job.request.adu:
        return NEVER
    return max(owed.sent_at, job.sent_at - owed.lives)


def _look_the_same(one: Request, other: Request) -> bool:
    """Whether two requests are answered by frames of the same looks."""
    return (one.prefix, one.length, one.refusal, one.function) == (
        other.prefix,
        other.length,
        other.refusal,
        other.function,
    )
