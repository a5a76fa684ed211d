"""The bursts that wait for one pair: which of their frames goes next. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rs485bus.bus.line.serial_line import SerialLine
from rs485bus.bus.record import Record
from rs485bus.bus.schedule.admission import AdmissionControl
from rs485bus.bus.schedule.burst import Burst, takes
from rs485bus.bus.schedule.job import Job, Outcome, Reason
from rs485bus.bus.schedule.queue import Queue
from rs485bus.bus.watchdog.feeding import Feeding
from rs485bus.wire.frames import Request

_LOOK_EVERY = 0.01
"""Seconds after which a burst that waits for another pair is looked at again."""


class BurstScheduler:
    """One pair's part in bursts.

    Args:
        pair: the pair.
        queue: what waits for it.
        gate: who may go onto it.
        feeding: the watchdogs, which say for how long the wire may be taken at once.
        free_at: from when on the next frame may be handed out, if none is out.
        give_up: ends a job that was taken out of the queue.
    """

    def __init__(
        self,
        pair: SerialLine,
        queue: Queue,
        gate: AdmissionControl,
        feeding: Feeding,
        free_at: Callable[[], float],
        give_up: Callable[[Job, Reason], None],
    ) -> None:
        self.poke: Callable[[], None] = lambda: None
        """Called where something may go out that had to wait."""
        self._pair = pair
        self._queue = queue
        self._gate = gate
        self._feeding = feeding
        self._free_at = free_at
        self._give_up = give_up
        self.waiting: dict[Burst, dict[int, Job]] = {}
        """The jobs of each burst that were not sent yet, by place."""

    def __bool__(self) -> bool:
        """Whether any waits."""
        return bool(self.waiting)

    def join(self, job: Job) -> Reason:
        """A job waits for its turn; or the reason why that does not come."""
        assert job.slot is not None
        burst = job.slot.burst
        if burst.broken:
            return Reason.BROKEN_OFF
        self.waiting.setdefault(burst, {})[job.slot.place] = job
        burst.join(self)
        return Reason.NONE

    def ended(self, job: Job) -> None:
        """A job has ended. One that was not done ends the burst."""
        assert job.slot is not None
        self._leave(job)
        if job.outcome in (Outcome.NOT_SENT, Outcome.REFUSED):
            job.slot.burst.break_off()

    def next(self, now: float) -> tuple[Job | None, float, bool]:
        """The frame that goes next; else when to ask again, and whether the wire is kept free until then."""
        again = float("inf")
        for burst in sorted(self.waiting, key=lambda burst: burst.began_at is None):
            if burst.began_at is None:
                until = burst.may_begin(now)
                if until > now:
                    again = min(again, until)
                    continue
                if not burst.begin(now):
                    return None, now + _LOOK_EVERY, True
            job = self._first(burst, now)
            if job is not None:
                return job, 0.0, True
        return None, again, False

    def heard_after(self, requests: Sequence[Request], records: Sequence[Record]) -> list[float]:
        """When each of some frames that go out as one will have been understood, in seconds from the begin of the
        first: that is after a silence.

        Args:
            requests: the frames.
            records: the latest transactions, which tell how long each device takes before it answers.
        """
        line, heard, begins = self._pair.line, [], 0.0
        for request in requests:
            heard.append(begins + line.airtime(len(request.adu)) + self._pair.silence)
            answers = (record for record in reversed(records) if record.address == request.address and record.reply)
            last = next(answers, None)
            begins += takes(line, self._pair.silence, request, last and last.turnaround(line))
        return heard

    def gives_way(self, now: float) -> bool:
        """Whether a burst has had the wire for as long as it may be taken at once: where it was not answered."""
        slack = self._feeding.slack
        return any(burst.began_at is not None and now - burst.began_at > slack for burst in self.waiting)

    # As a burst sees it

    def must_wait(self, burst: Burst, now: float) -> float:
        jobs = self._in_order(burst)
        takes_all = sum(takes(self._pair.line, self._pair.silence, job.request) for job in jobs)
        until = now
        for job in jobs:
            reason = Reason.BURST_TOO_LONG if takes_all > self._feeding.burst_slack else self._gate.refusal(job)
            if reason is not Reason.NONE:
                self._take_out(job, reason)
                break
            until = max(until, self._gate.wait(job, now))
        if self._feeding.armed and not self._feeding.spares(takes_all, now):
            until = max(until, now + _LOOK_EVERY)
        return until

    def is_free(self, now: float) -> bool:
        taken = any(burst.began_at is not None for burst in self.waiting)
        return self._gate.connected and self._pair.job is None and not taken and now >= self._free_at()

    def drop(self, burst: Burst) -> None:
        for job in self._in_order(burst):
            self._take_out(job, Reason.BROKEN_OFF)

    # Inside

    def _in_order(self, burst: Burst) -> list[Job]:
        return [job for _, job in sorted(self.waiting.get(burst, {}).items())]

    def _first(self, burst: Burst, now: float) -> Job | None:
        """The next frame of a burst under way. In the middle of it nothing waits: what would have to ends it."""
        jobs = self._in_order(burst)
        if not jobs:
            return None  # it ended on another pair
        job = jobs[0]
        reason = self._gate.refusal(job)
        if reason is Reason.NONE and self._gate.wait(job, now) > now:
            reason = Reason.BROKEN_OFF
        if reason is not Reason.NONE:
            self._take_out(job, reason)
            return None
        self._queue.remove(job)
        self._leave(job)
        return job

    def _take_out(self, job: Job, reason: Reason) -> None:
        if self._queue.remove(job):
            self._give_up(job, reason)

    def _leave(self, job: Job) -> None:
        assert job.slot is not None
        waiting = self.waiting.get(job.slot.burst, {})
        if waiting.get(job.slot.place) is job:
            del waiting[job.slot.place]
        if not waiting:
            self.waiting.pop(job.slot.burst, None)
