"""What came of each attempt: a reply, whose it is and what it is worth, or none, and what follows on that. Pure."""

from __future__ import annotations

from typing import Protocol

from rs485bus.bus.clock import Clock
from rs485bus.bus.config import BusConfig
from rs485bus.bus.line.diagnosis import is_there
from rs485bus.bus.line.serial_line import SerialLine
from rs485bus.bus.line.transaction import ECHO, NORMAL, Kind
from rs485bus.bus.record import Journal, Record
from rs485bus.bus.schedule.admission import AdmissionControl
from rs485bus.bus.schedule.job import NOT_WEIGHED, REPLY, STOP, Job, Outcome, Reason, Urgency
from rs485bus.bus.schedule.lingering import Lingering
from rs485bus.bus.schedule.pipeline import Pipeline
from rs485bus.bus.schedule.queue import Queue
from rs485bus.bus.schedule.repeating import Repeating
from rs485bus.bus.schedule.timers import Timers
from rs485bus.bus.units.asking import hurry
from rs485bus.bus.units.motion import NEVER
from rs485bus.bus.units.reachability import share_lost
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.units.unit_states import UnitStates
from rs485bus.bus.watchdog.feeding import Feeding
from rs485bus.bus.watchdog.register_writes import RegisterWrites
from rs485bus.wire.exceptions import ACCEPTED, Meaning, is_a_gateways, is_exception
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Repeat

_LATE = (Kind.LATE, Kind.LATE_EXCEPTION)
_STOPPING = (Urgency.STOP, Urgency.CONFIRM)


class End(Protocol):
    """Ends a job."""

    def __call__(self, job: Job, outcome: Outcome, reason: Reason = Reason.NONE) -> None: ...


class Attempts:
    """Judges what came of each attempt.

    Args:
        clock: the time.
        config: how the bus behaves.
        pair: the pair.
        queue: what waits for it.
        gate: who may go onto it.
        feeding: the armed watchdogs.
        units: what is known of each address.
        journal: what was sent before.
        register_writes: sees the writes to watchdog registers.
        timers: calls back.
        end: ends a job.
        numbered: each answer tells which request it is to.
        native: and it is the device itself that tells.
    """

    def __init__(
        self,
        clock: Clock,
        config: BusConfig,
        pair: SerialLine,
        queue: Queue,
        gate: AdmissionControl,
        feeding: Feeding,
        units: UnitStates,
        journal: Journal,
        register_writes: RegisterWrites,
        timers: Timers,
        end: End,
        *,
        numbered: bool,
        native: bool,
    ) -> None:
        self._clock = clock
        self._pair = pair
        self._queue = queue
        self._gate = gate
        self._feeding = feeding
        self._units = units
        self._journal = journal
        self._register_writes = register_writes
        self._end = end
        self._repeating = Repeating(config.retries, queue, end)
        self.lingering = Lingering(timers, self.gave_no_reply)
        self.pipeline = Pipeline(config.pipeline if numbered else 1, native, units, feeding, timers, self._missed_one)
        self._missed = 0
        """The unit that left the latest request unanswered; 0 if that was answered."""

    def retries_of(self, job: Job) -> int:
        """How often a job is repeated."""
        return self._repeating.retries_of(job)

    def send_none_again(self, now: float) -> None:
        """What was submitted until now is not sent again, nor read back, but stops and the bus' own."""
        self._repeating.flushed_at = now

    def end_all(self) -> list[Job]:
        """The jobs that may be answered while others are served: no answer can come any more."""
        return self.lingering.end_all() + self.pipeline.end_all()

    def take(self, kind: Kind, request: Request, frame: bytes) -> None:
        """A frame was received: what it is, and the request it belongs to."""
        unit = self._units.by_address[request.address]
        if kind in _LATE:
            self.came_late(kind, unit, request, frame)
        elif kind is not ECHO and (job := self._pair.job) is not None:
            if unit.late.owed:
                unit.expire(self._clock.now)
            if kind is NORMAL:
                undecided = job.urgency is STOP and self._is_anothers(job, unit, frame)
            else:
                undecided = unit.late.leaves_undecided(job, frame)
            if not undecided:
                self._answered(job, unit, kind, frame)
            else:
                self._pair.exchange.pass_over(frame)
                self._heard_of(unit, frame)

    def came_late(self, kind: Kind, unit: UnitState, request: Request | None, frame: bytes) -> None:
        """A late reply came, to a request that is owed one; None if no such is owed. It is delivered to nobody but the
        same job, which waits to be sent again. But whoever answers late is there, and heard what was asked then."""
        self._journal.unit(unit.address).late_replies += 1
        unit.heard_at = self._clock.now
        if kind is Kind.LATE_EXCEPTION:
            unit.late.excepted(frame[1] & 0x7F, frame)
            self._heard_of(unit, frame)
            return
        self._units.heard(unit, self._clock.now)
        hurry(unit, self._clock.now)
        if request is None:
            return
        waiting, latest = unit.late.waiting(request, frame), unit.late.latest(request, frame)
        is_the_only_one = unit.late.count(request, frame) == 1
        if (since := unit.late.arrived(request, frame)) is not None:
            if unit.attached is not None and latest > NEVER:
                unit.tell(unit.attached.on_late_reply, latest)
            self._feeding.heard(unit.address, since, late=True)
            if is_the_only_one:
                took = self._clock.now - since
                unit.answered_late(took)
                self._pair.host.came_late(took - self._pair.line.airtime(len(frame)) - unit.reply_times.longest)
            if waiting is not None and (self.lingering.leaves(waiting) or self._queue.remove(waiting)):
                waiting.answered_since, waiting.reply = since, frame
                unit.tell_reply(request, frame, since, self._clock.now)
                self._end(waiting, Outcome.REPLY)

    def _answered(self, job: Job, unit: UnitState, kind: Kind, frame: bytes) -> None:
        meaning = None
        if kind is not NORMAL:
            if kind is Kind.EXCEPTION:
                job.code = frame[2]
            meaning = unit.meaning(job.request, job.code)
            if meaning is Meaning.UNANSWERED:
                self.unanswered("no reply", frame)
                return
        now, pair, request, feeding = self._clock.now, self._pair, job.request, self._feeding
        since = unit.late.answered(job, pair.owed_until + unit.late_reply_window, frame)
        is_its_own = since == job.sent_at
        job.answered_since = since
        job.reply = frame
        self._units.answered(unit, request, now)
        self._missed = 0
        unit.heard_at = now
        if meaning is not None:
            unit.answers.refused(request)
        elif is_its_own and not job.unanswered and now <= pair.deadline:
            unit.reply_times.answered(job, now - pair.air_end - len(frame) * pair.character - pair.latency)
            pair.host.came_in_time()
        if self._gate.silent:
            self._gate.silent.pop(unit, None)
        self.note(job, frame, "reply" if meaning is None else "refused", now)
        told = is_its_own and pair.exchange.judge()
        if not told and not request.writes:
            pair.exchange.question.tried(job.address)
        if job.code == ACCEPTED:
            self._units.owes(unit, job, pair.owed_until)
        pair.end(self._units.late(now) if self._units.owing else (), now, answered=True)
        if meaning is not None:
            self._fed_nothing(job)
            if meaning is not Meaning.REFUSED and unit.attached is not None:
                unit.tell(unit.attached.on_busy)
            self._repeating.after_exception(job, meaning, now)
            return
        # Where an answer is never known to be the latest attempt's, it feeds as if it were: that was sent all the same.
        feeding.heard(unit.address, since if unit.late.in_order else job.sent_at, job.sent_at)
        if job.feeds and is_its_own:
            feeding.fed(unit.address, now - job.sent_at - pair.line.airtime(len(request.adu) + len(frame)))
        if request.writes:
            self._register_writes.acknowledged(job, unit)
        if unit.attached is not None:
            asked_at = unit.late.asked_in_turn(job, since) if unit.late.owed else since
            if asked_at > NEVER:
                unit.tell_reply(request, frame, asked_at, now)
        if job.weighed < 0 or since >= job.queued_at or not self._is_asked_again(job, unit):
            self._end(job, REPLY)

    def _is_asked_again(self, job: Job, unit: UnitState) -> bool:
        """Whether a job is asked again whose answer may be a late reply. Where that does not decide it, the bus' own go
        by what was said of its age; others wait until no reply can come late."""
        if unit.late.may_be_decided(job):
            job.weighed += 1
        elif job.internal:
            return False
        else:
            job.cuts, job.weighed = job.cuts + job.weighed, NOT_WEIGHED
        return self._repeating.once_more(job, self._clock.now)

    def _is_anothers(self, job: Job, unit: UnitState, frame: bytes) -> bool:
        """Whether the answer to a stop may be an older request's, for whose reply the stop did not wait."""
        if job.ignores_late_replies or not unit.late.must_wait(job.request, job):
            return False
        self._journal.unit(unit.address).late_replies += 1
        unit.late.arrived(job.request, frame)
        return True

    def _heard_of(self, unit: UnitState, frame: bytes) -> None:
        """A frame came that ended nothing. It tells that the unit is there, unless a gateway says that it is not."""
        if not is_a_gateways(frame):
            self._units.heard(unit, self._clock.now)

    def unanswered(self, how: str, frame: bytes = b"") -> None:
        """The attempt on the wire got no reply: its time is over, a gateway says so in a frame, a stop cut it short, or
        the port was lost."""
        job = self._pair.job
        assert job is not None
        unit = self._units[job.address]
        job.unanswered += 1
        job.cuts += how == "cut"
        in_doubt = how == "no reply" and self._pair.exchange.is_in_doubt
        heard = self._pair.exchange.heard()
        job.heard = heard or job.heard
        if how == "no reply" and heard is not None and heard.rest and self._may_be_spoilt(job, unit):
            job.cuts += 1
            job.patient_until = max(job.patient_until, self._clock.now) + self._clock.now - job.sent_at
        if heard is not None and how == "no reply" and is_there(job.request, heard):
            self._units.heard(unit, self._clock.now)
        owed_until = max(self._pair.owed_until, self._clock.now)
        unit.unheard(job.sent_at, self._clock.now)
        if unit.attached is not None and how != "cut":
            unit.tell(unit.attached.on_unanswered, job.sent_at)
        self._units.owes(unit, job, owed_until)
        self.note(job, frame, how, self._clock.now)
        if not job.request.writes:
            self._pair.exchange.question.tried(job.address)
        if how == "no reply":
            if not frame:
                if job.attempts == 1 and self._clock.now < owed_until and not job.backs_off:
                    waits = unit.waits(job, self._repeating.retries_of(job))
                    job.patient_until = job.sent_at + (waits - 1) * (owed_until - job.sent_at)
                unit.reply_times.missed(job, share_lost(*unit.reach.loss.counts))
                self._pair.host.missed()
                self._gate.silent[unit] = owed_until
            if job.sent_at >= unit.misses_count_from:
                unit.misses_count_from = owed_until
                self._units.unanswered(unit, job, self._clock.now)
        self._pair.end(self._units.late(self._clock.now), self._clock.now, answered=False)
        self._fed_nothing(job, how)
        if job.urgency in _STOPPING and unit.halt is not None and self._feeding.guards_others(job.address):
            self._gate.ration.spend(self._clock.now - job.sent_at, self._clock.now)
        if in_doubt:
            read = unit.harmless_read()
            if self._repeating.after_doubt(job, read, lambda why: self._was_in_doubt(job, why), self._clock.now):
                return
        ended = job.internal or job.setpoint or frame or how != "no reply"
        self._not_answered(job, unit, how, 0.0 if ended else owed_until)

    def _may_be_spoilt(self, job: Job, unit: UnitState) -> bool:
        """Whether a late reply of its unit may have hit the attempt on the wire, which does not count then. All of them
        may be hit by noise, so that not many do not count."""
        is_owed = any(owed.until > job.sent_at for owed in unit.late)
        return is_owed and not job.internal and job.cuts < self._repeating.retries_of(job)

    def _was_in_doubt(self, job: Job, reason: Reason) -> None:
        """The adapter has been found out, or nobody answered, or that could not be asked."""
        unit = self._units[job.address]
        if reason is not Reason.NONE:
            self._end(job, silence_of(job), reason)
        elif self._pair.exchange.echo is not False:
            self._not_answered(job, unit, "no reply")
        else:
            job.unanswered -= 1
            job.reply, job.answered_since = job.request.adu, job.sent_at
            unit.late.arrived(job.request, job.reply)
            self._register_writes.acknowledged(job, unit)
            self._end(job, Outcome.REPLY)

    def _not_answered(self, job: Job, unit: UnitState, how: str, may_come_until: float = 0.0) -> None:
        """What came of an attempt that was not answered. Its reply may come until the time given all the same."""
        missed, self._missed = self._missed, job.address
        if how != "lost" and not unit.reach.silent and self._repeating.after_silence(job, self._clock.now):
            if missed not in (0, job.address):
                # It may have taken this request for the answer that its neighbour did not give.
                self._queue.hurry(job)
            return
        if may_come_until > self._clock.now:
            self.lingering.add(job, may_come_until)
            return
        if how == "no reply" and not job.internal:
            self._units.missed(unit, self._clock.now)
        lost = Reason.CLOSED if self._gate.closed else Reason.UNPLUGGED
        self._end(job, silence_of(job), lost if how == "lost" else Reason.NONE)

    def gave_no_reply(self, job: Job, reason: Reason = Reason.NONE) -> None:
        """The last attempt was not answered within the longest time that the unit may take."""
        self._units.missed(self._units[job.address], self._clock.now)
        self._end(job, silence_of(job), reason)

    def _fed_nothing(self, job: Job, how: str = "refused") -> None:
        """The job's latest attempt was not acknowledged."""
        if job.feeds or (job.urgency in _STOPPING and how != "refused"):
            job.feeds = False
            self._feeding.failed(job.address, self._clock.now, self._clock.now - job.sent_at, cut=how == "cut")

    def answered_late(self, job: Job, unit: UnitState, frame: bytes) -> None:
        """The device itself answers, late, what waits to be sent again, or for the end of its time."""
        meaning = unit.meaning(job.request, frame[2]) if is_exception(frame) else None
        if meaning is Meaning.UNANSWERED or not (self.lingering.leaves(job) or self._queue.remove(job)):
            return
        self._units.heard(unit, self._clock.now)
        if meaning is None:
            job.answered_since, job.reply = job.queued_at, frame
            self._end(job, Outcome.REPLY)
            return
        job.code = frame[2]
        job.unanswered -= 1  # this attempt was answered; an earlier one may have done what it was refused
        self._repeating.after_exception(job, meaning, self._clock.now)

    # What is out beside others

    def one_answered(self, job: Job, frame: bytes) -> None:
        """A frame came that answers, by its number, one of the requests that are out beside each other."""
        now, unit = self._clock.now, self._units[job.address]
        refused = is_exception(frame)
        if not (job.request.answered_by(frame) or (refused and frame[1] & 0x7F == job.request.function)):
            return  # a gateway has mixed something up: the job's time decides
        meaning = None
        if refused:
            if unit.late.leaves_undecided(job, frame):
                return
            job.code = frame[2]
            meaning = unit.meaning(job.request, job.code)
        self.pipeline.leaves(job)
        if meaning is Meaning.UNANSWERED:
            self._missed_one(job, frame)
            return
        job.answered_since = unit.late.answered(job, now + unit.late_reply_window, frame)
        job.reply = frame
        if job.code == ACCEPTED:
            self._units.owes(unit, job, now)
        self._units.answered(unit, job.request, now)
        unit.heard_at = now
        self._note_one(job, frame, "reply" if meaning is None else "refused")
        if meaning is None:
            self._end(job, Outcome.REPLY)
        else:
            self._repeating.after_exception(job, meaning, now)

    def _missed_one(self, job: Job, frame: bytes = b"") -> None:
        """One of those was not answered in its time, or a gateway says in a frame that it will not be."""
        now, unit = self._clock.now, self._units[job.address]
        job.unanswered += 1
        self._units.owes(unit, job, now)
        self._note_one(job, frame, "no reply")
        self._units.unanswered(unit, job, now)
        self._not_answered(job, unit, "no reply")

    def _note_one(self, job: Job, reply: bytes, outcome: str) -> None:
        sent, now = (job.queued_at, job.sent_at), self._clock.now
        self._journal.add(
            Record(job.address, job.urgency, job.attempts, job.request.adu, reply, 0, *sent, None, now, outcome)
        )

    def note(self, job: Job, reply: bytes, outcome: str, now: float) -> None:
        self._journal.add(*self._pair.record(job, reply, outcome, now))


def silence_of(job: Job) -> Outcome:
    """What it means that a job was sent and not answered."""
    safe = job.repeat is Repeat.SAFE or not job.request.writes
    return Outcome.NO_REPLY if safe else Outcome.UNKNOWN
