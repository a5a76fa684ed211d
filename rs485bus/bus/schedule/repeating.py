"""What follows on an attempt that no normal reply answered: a repetition, a read-back, or the end. Pure.

A verified write and its read-backs are one job to whoever submitted it: they share its place in the queue, its epoch
and its time, so that nothing that keeps the write off the wire lets a read-back or a repetition pass. Whatever the
read-back says, the write's own outcome is told.
"""

from __future__ import annotations

from collections.abc import Callable

from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.schedule.queue import Queue
from rs485bus.bus.units.asking import pause
from rs485bus.bus.units.motion import NEVER
from rs485bus.wire.exceptions import Meaning, exception
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Repeat

_BUSY_PAUSE = 0.1
"""Seconds for which a device is left alone that says it is busy; twice as long after each further time."""
_LONGEST_PAUSE = 1.6
"""Seconds, at most."""

_CUTS = 20
"""Attempts cut short by stops that do not count: whoever is asked was not given its time."""

End = Callable[[Job, Outcome, Reason], None]


class Repeating:
    """The jobs that are sent again.

    Args:
        retries: how often a job is repeated that says nothing else.
        queue: what waits for the wire.
        end: ends a job.
    """

    __slots__ = ("_end", "_queue", "_retries", "flushed_at")

    def __init__(self, retries: int, queue: Queue, end: End) -> None:
        self._retries = retries
        self._queue = queue
        self._end = end
        self.flushed_at = NEVER
        """When all that waited was dropped: what is older is not sent again, be it on the wire at that time."""

    def after_silence(self, job: Job, now: float) -> bool:
        """The latest attempt was not answered. False if the job is neither repeated nor read back: it has ended."""
        if job.repeat is Repeat.SAFE:
            if not self._may_repeat(job, now):
                return False
            if job.backs_off:
                job.not_before = now + pause(job)
            elif job.attempts > self.retries_of(job) and not job.request.writes:
                job.not_before = min(now + 2 * pause(job), job.patient_until)  # the device may be busy
            self._queue.put(job, first=True)
            return True
        return self._read_back(job, now)

    def after_doubt(self, job: Job, read: Request, ended: Callable[[Reason], None], now: float) -> bool:
        """What came back may be the request, returned by the adapter. What answers a read shows whether it does that.

        False if that is not asked: a stop is looked at anyway, and what waits with others cannot wait for it.
        """
        if job.slot is not None or job.urgency is Urgency.STOP or not self._is_wanted(job, now):
            return False

        def was_asked(back: Job) -> None:
            job.read_back = None
            ended(back.reason)

        self._ask(job, read, was_asked, now)
        return True

    def after_exception(self, job: Job, meaning: Meaning, now: float) -> None:
        """The device said no, or that it could not do it."""
        if meaning is Meaning.BUSY and job.repeat is not Repeat.NEVER and self._may_repeat(job, now):
            job.not_before = now + pause_of(_attempts(job))
            self._queue.put(job, first=True)
        elif meaning is Meaning.OPEN and job.request.writes:
            if not self._read_back(job, now):
                self._end(job, Outcome.UNKNOWN, Reason.NONE)
        else:
            # An unanswered attempt before this one may have done what this one was refused.
            unknown = job.unanswered and job.request.writes
            self._end(job, Outcome.UNKNOWN if unknown else Outcome.REFUSED, Reason.NONE)

    def once_more(self, job: Job, now: float) -> bool:
        """The answer to the latest attempt may be a late reply. False if nothing more is to be sent for the job."""
        if not self._is_wanted(job, now):
            return False
        self._queue.put(job, first=True)
        return True

    def _may_repeat(self, job: Job, now: float) -> bool:
        retries = self.retries_of(job)
        more = (_attempts(job) if retries else job.attempts) <= retries or now < job.patient_until
        return more and job.slot is None and self._is_wanted(job, now)

    def _read_back(self, job: Job, now: float) -> bool:
        """See whether a verified write was carried out. False if that is not asked for, or not any more."""
        verify = job.verify
        if job.repeat is not Repeat.VERIFY or verify is None or job.slot is not None or not self._is_wanted(job, now):
            return False
        job.read_backs += 1
        back = self._ask(job, verify.read, lambda back: self._was_read_back(job, back), now)
        if _was_begun(job):
            back.not_before = now + pause_of(job.read_backs)  # it may be at it still
        return True

    def _ask(self, job: Job, read: Request, on_end: Callable[[Job], None], now: float) -> Job:
        """Ask a job's unit something that tells what became of the job."""
        back = Job(
            read,
            urgency=job.urgency,
            moves=job.moves,  # it goes where the write may go, and no further
            motion=job.motion,
            reply_timeout=job.reply_timeout,
            pause=job.pause,
            expires_at=job.expires_at,
            internal=job.internal,
            retries=job.retries,
            on_end=on_end,
        )
        back.epoch = job.epoch
        back.queued_at = now
        job.read_back = back
        self._queue.put(back, first=True)
        return back

    def _was_read_back(self, job: Job, back: Job) -> None:
        job.read_back = None
        verify, now = job.verify, back.ended_at
        assert verify is not None
        if back.outcome is not Outcome.REPLY:
            self._end(job, Outcome.UNKNOWN, back.reason)
        elif verify.shows(back.reply):
            job.answered_since = job.queued_at
            self._end(job, Outcome.REPLY, Reason.NONE)
        elif _was_begun(job):
            # What it has begun may be seen later, and would be done twice if it were repeated.
            if job.read_backs > self.retries_of(job) or not self._read_back(job, now):
                self._end(job, Outcome.UNKNOWN, Reason.NONE)
        elif self._may_repeat(job, now):
            self._queue.put(job, first=True)
        else:
            self._end(job, Outcome.UNKNOWN, Reason.NONE)

    def _is_wanted(self, job: Job, now: float) -> bool:
        """Whether anything more is to be sent for it."""
        if job.queued_at <= self.flushed_at and not job.internal and job.urgency is not Urgency.STOP:
            return False
        return not job.caller_cancelled and (job.expires_at is None or job.expires_at > now)

    def retries_of(self, job: Job) -> int:
        return self._retries if job.retries is None else job.retries


def _was_begun(job: Job) -> bool:
    """Whether the device said of its latest attempt that it has begun it, or did not say that it has not."""
    return job.code is not None and exception(job.code).meaning is Meaning.OPEN


def _attempts(job: Job) -> int:
    """How often it was sent and given its time."""
    return job.attempts - min(job.cuts, _CUTS) - max(job.weighed, 0)


def pause_of(times: int) -> float:
    """Seconds for which a device is left alone that has said so often that it is busy."""
    return min(_LONGEST_PAUSE, _BUSY_PAUSE * 2.0 ** (times - 1))
