"""The owner of the wire. Pure: jobs, bytes and the time go in; bytes to send, outcomes and the next wake come out.

It is a machine driven by calls, no task: nothing can cancel it. One transaction is on the wire at a time; between two
attempts of a job the queue decides anew; a stop waits for nothing but the end of a frame.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from typing import TypeVar

from rs485bus.bus.attempts import Attempts, silence_of
from rs485bus.bus.clock import Clock
from rs485bus.bus.config import BusConfig
from rs485bus.bus.line.serial_line import CUT_AFTER, SerialLine
from rs485bus.bus.line.transaction import Kind
from rs485bus.bus.record import Journal
from rs485bus.bus.schedule.admission import AdmissionControl
from rs485bus.bus.schedule.job import CONFIRM, NO_REASON, STOP, Job, Outcome, Reason, Urgency
from rs485bus.bus.schedule.one_way import OneWay
from rs485bus.bus.schedule.queue import Queue
from rs485bus.bus.schedule.scheduler import Failed, Scheduler, unheeded
from rs485bus.bus.schedule.selector import Selector
from rs485bus.bus.schedule.timers import Timer, Timers
from rs485bus.bus.stopping.halt import Procedure
from rs485bus.bus.stopping.stops import Stops
from rs485bus.bus.units.unit_states import UnitStates
from rs485bus.bus.watchdog.feeding import Feeding
from rs485bus.bus.watchdog.maker import WatchdogMaker
from rs485bus.bus.watchdog.register_writes import RegisterWrites
from rs485bus.wire.exceptions import is_exception
from rs485bus.wire.timing import LineSettings

T = TypeVar("T")

_log = logging.getLogger("rs485bus")

FOREVER = float("inf")
_BROADCAST = 32
"""Bytes of a broadcast that is always allowed, however tight the armed watchdogs are."""


class Owner:
    """One pair of wires and everything that waits for it. Times are seconds on one steady clock.

    Args:
        line: how characters travel.
        config: how the bus behaves.
        now: the time.
        gateway: a TCP gateway does the framing; replies may overtake each other behind it.
        numbered: it tells which request it answers (Modbus TCP).
        native: what answers is the device itself, so that no reply is taken for another's.
    """

    def __init__(
        self,
        line: LineSettings,
        config: BusConfig,
        now: float,
        *,
        gateway: bool = False,
        numbered: bool = False,
        native: bool = False,
    ) -> None:
        self.config = config
        self._clock = clock = Clock(now)
        self._native = native
        self.send_at = now
        """When the frame that `tick` returned is to be sent."""
        self.sent: Job | None = None
        """The job whose frame that is."""
        self.journal = Journal()
        silence = config.silence_on(line, gateway) * (not numbered)
        echo = False if numbered else None if config.echo == "auto" else config.echo
        self.feeding = Feeding(line.budget(_BROADCAST, config.turnaround, 0) + silence)
        in_order = config.in_order and not gateway
        self.units = UnitStates(config, in_order, config.late_reply_window_of(gateway), native=native)
        self.pair = SerialLine(line, silence, echo, now)
        self.watchdogs = WatchdogMaker(self.pair, self.journal)
        self.gate = AdmissionControl(self.pair, self.units, self.feeding, config)
        self._register_writes = RegisterWrites(self.feeding, self.gate.hearing, self.watchdogs.make)
        self._timers = Timers()
        self.queue = Queue()
        wire = (self.pair, self.queue, self.gate, self.feeding, self.units)
        self._attempts = Attempts(
            clock,
            config,
            *wire,
            self.journal,
            self._register_writes,
            self._timers,
            self._end,
            numbered=numbered,
            native=native,
        )
        self._pipeline = self._attempts.pipeline
        self._selector = Selector(clock, *wire, self.journal, self._pipeline, self._submit, self._drop)
        self.starts = self._selector.starts
        self._procedures = Scheduler(self._submit, self._timers, clock)
        self.stops = Stops(clock, *wire, self._procedures, self._timers, self._submit, self._flush)
        self.one_way = OneWay(self._timers, self._end)
        self._wake = FOREVER
        self._after_stops: list[Callable[[], None]] = []

    @property
    def now(self) -> float:
        """The time of the latest call, in seconds."""
        return self._clock.now

    @now.setter
    def now(self, now: float) -> None:
        self._clock.now = now

    @property
    def wake(self) -> float:
        """When `tick` wants to be called next. Every call may bring that forward; `tick` and answers put it off."""
        return min(self._wake, self._timers.next_at, self.feeding.over_at)

    # Jobs and what is done later

    def submit(self, job: Job, now: float) -> None:
        """Take a job. How it ends is told through `job.on_end`, which may be at once."""
        job.queued_at = self._clock.now = now
        job.outcome = job.code = job.heard = None
        pair, urgency, reason = self.pair, job.urgency, self.gate.refusal(job)
        if self.queue.size >= self.config.max_queued and not (job.internal or job.setpoint or urgency is STOP):
            reason = Reason.QUEUE_FULL
        if reason is NO_REASON and job.slot is not None:
            reason = self.starts.join(job)
        if reason is NO_REASON and job.expires_at is not None and job.expires_at <= now:
            reason = Reason.EXPIRED
        if reason is not NO_REASON:
            self._end(job, Outcome.NOT_SENT, reason)
            return
        # What confirms a stop waits for no set-point, which waits for the end of that stop. Other looks take turns.
        look = urgency is CONFIRM and job.is_look and self.units[job.address].halt is not None
        self.queue.put(job, first=look or (job.on_turn is not None and job.goes_first))
        if job.expires_at is not None:
            job.timer = self.at(job.expires_at, lambda: self._expire(job))
        if pair.job is None:
            self._wake = min(self._wake, pair.quiet_at - self._selector.lead)
        elif urgency is STOP:
            self._wake = min(self._wake, pair.wait_until(now))

    def _submit(self, job: Job) -> None:
        self.submit(job, self._clock.now)

    def cancel(self, job: Job, now: float) -> None:
        """The caller has gone. What was not sent never will be; what is on the wire is finished, not repeated."""
        self._clock.now = now
        job.caller_cancelled = True
        waiting = job.read_back or job
        waiting.caller_cancelled = True
        if job.urgency is not Urgency.STOP and self.queue.remove(waiting):
            self._drop(waiting, Reason.CANCELLED)

    def at(self, when: float, callback: Callable[[], None]) -> Timer:
        """Call back when the time has come."""
        return self._timers.at(when, callback)

    def after_stops(self, callback: Callable[[], None]) -> None:
        """Call back, in a `tick`, as soon as all stops that wait are on the wire, or the port is lost."""
        self._after_stops.append(callback)

    def start(self, procedure: Procedure[T], done: Callable[[T], None], failed: Failed = unheeded) -> None:
        """Drive a procedure to its end, whatever becomes of who started it. One that raises has `failed`."""
        self._procedures.start(procedure, done, failed)

    # The wire

    def feed(self, data: bytes, now: float) -> None:
        """Bytes were received."""
        self._clock.now = now
        pair, waits_for = self.pair, self.pair.job
        for received in pair.feed(data, now):
            self._attempts.take(*received)
        if pair.job is None:
            # Where a job was answered, nobody waits any more for the end of its time.
            self._wake = min(self._selector.look_at(), self._wake if waits_for is None else FOREVER)
        elif pair.is_brief:
            self._wake = min(self._wake, pair.wait_until())

    def feed_late(self, frame: bytes, asked: object, now: float) -> None:
        """A frame was received that answers an older request than the latest: the job `asked`, as its number tells."""
        self._clock.now = now
        unit = self.units[frame[0]]
        if isinstance(asked, Job) and self._pipeline.is_out(asked):
            self._attempts.one_answered(asked, frame)
            self._wake = now
        elif self._native and isinstance(asked, Job) and asked.outcome is None and asked.request.answered_by(frame):
            self._attempts.answered_late(asked, unit, frame)
        elif is_exception(frame):
            self._attempts.came_late(Kind.LATE_EXCEPTION, unit, None, frame)
        else:
            owed = (owed.request for owed in unit.late if owed.job is asked and owed.request.answered_by(frame))
            self._attempts.came_late(Kind.LATE, unit, next(owed, None), frame)

    def tick(self, now: float, lead: float = 0.0) -> bytes | None:
        """Do what is due; return the next frame to send, if there is one.

        A frame may be returned up to `lead` seconds before it may go out, at `send_at`.
        """
        self._clock.now = now
        pair, gate, selector = self.pair, self.gate, self._selector
        selector.lead = lead
        if now >= self._timers.next_at:
            self._timers.run(now)
        if now >= self.feeding.over_at:
            for watch in self.feeding.overdue(now):
                self.stops.trip(watch, f"it was unheard for {now - watch.heard_at:.3f} s")
        job, frame, wake = None, None, FOREVER
        if pair.job is not None:
            wake = selector.over_at()
            if now >= wake:
                self._attempts.unanswered("no reply" if now >= pair.deadline else "cut")
        start = now
        if pair.job is None and gate.connected and not gate.closed:
            wake = selector.look_at()
            if now >= wake:
                self._wake = FOREVER  # who is told meanwhile that a job was dropped may submit another
                if self.feeding.strain.holds:
                    self.stops.give_up_hopeless()
                job, wake = selector.next()
                wake = min(wake, self._wake)
                start = max(now, pair.quiet_at)
            elif pair.heard_at + pair.silence > now and pair.is_noisy:
                job, wake = selector.next_among_noise(wake)
        if job is not None:
            frame = self._send(job, start)
            wake = pair.quiet_at if pair.job is None else selector.over_at()
        self._wake = wake
        if self._after_stops and not (gate.connected and self.queue.stops):
            self._stops_are_out()
        return frame

    def unplugged(self, now: float) -> None:
        """The port was lost. What is on the wire fails, what moves is dropped; reads wait for the port."""
        self._clock.now = now
        self.gate.connected = False
        self.at(self._selector.waiting.port_lost(now, self.journal.stats.answers), self._wait_for_port)
        self.pair.exchange.question.reopen()
        if self.pair.job is not None:
            self._attempts.unanswered("lost")
        self.one_way.end_all(Outcome.UNKNOWN, Reason.UNPLUGGED)  # nobody knows whether they went out
        for job in self._attempts.end_all():
            self._end(job, silence_of(job), Reason.UNPLUGGED)
        self._flush(self.queue, self.gate.needs_port, Reason.UNPLUGGED)
        for unit in self.units:
            watch = self.feeding.get(unit.address)
            if watch is not None:
                self.stops.trip(watch, "the port was lost")
            elif unit.attached is not None:
                unit.attached.motion.stop()
                unit.tell(unit.attached.interrupted, 0.0, "the port was lost")
            if unit.halt is not None:
                self.stops.report_if_away(unit.halt)

    def _wait_for_port(self) -> None:
        if again := self._selector.waiting.for_port(self._clock.now):
            self.at(again, self._wait_for_port)

    def plugged(self, now: float) -> None:
        """The port is there again. The first frames are stops, for all that may be moving."""
        self._clock.now = now
        self.gate.connected = True
        self.pair.restart(now)
        for unit in self.units:
            if unit.attached is not None and (unit.attached.motion.may_move or unit.halt is not None):
                self.stops.halt(unit, unit.attached.motion, emergency=True)
            elif unit.may_be_armed and not unit.guarded:
                self.stops.on_released(unit)

    @property
    def has_plain_stops(self) -> bool:
        """Whether a stop that somebody sent by himself waits, or is on the wire."""
        job = self.pair.job
        out = job is not None and job.urgency is Urgency.STOP and not job.internal
        return out or any(not job.internal for job in self.queue.of_urgency(Urgency.STOP))

    @property
    def is_sending(self) -> bool:
        """Whether a frame is on the wire, or its answer is waited for."""
        return self.pair.job is not None or self._clock.now < self.pair.air_end

    def close(self, now: float) -> None:
        """End everything that waits, whoever waits for it."""
        self._clock.now = now
        self.gate.closing = self.gate.closed = True
        self.stops.end_all()
        if self.pair.job is not None:
            self._attempts.unanswered("lost")
        sent = now >= self.pair.air_end
        self.one_way.end_all(Outcome.REPLY if sent else Outcome.UNKNOWN, Reason.CLOSED)
        for job in self._attempts.end_all():
            self._end(job, silence_of(job))
        self._flush(self.queue, lambda _: True, Reason.CLOSED)
        self._procedures.end_all()
        self._timers.clear()
        self._stops_are_out()

    def flush(self, reason: Reason) -> None:
        """End every job that waits but the bus' own and stops. What is on the wire is not sent again."""
        self._attempts.send_none_again(self._clock.now)
        self._flush(self.queue, lambda job: not job.internal and job.urgency is not Urgency.STOP, reason)

    def _stops_are_out(self) -> None:
        callbacks, self._after_stops = self._after_stops, []
        for callback in callbacks:
            try:
                callback()
            except Exception:
                _log.exception("what was to be called when the stops were out failed")

    def _send(self, job: Job, start: float) -> bytes:
        self.send_at, self.sent = start, job
        job.take_turn()
        job.attempts += 1
        job.code, job.sent_at = None, start
        if job.moves and job.motion is not None and job.request.writes:
            job.motion.commanded(start)
        units, pair, request = self.units, self.pair, job.request
        unit = units.by_address[job.address]
        timeout = unit.reply_timeout if job.reply_timeout is None else job.reply_timeout
        if self._pipeline.size > 1 and self._pipeline.takes(job):
            self._pipeline.add(job, start + pair.longest_wait(request, timeout))
            return request.adu
        if unit.asked_in_vain and job.urgency is Urgency.STOP and self.feeding.guards_others(job.address):
            # Others must not trip for it. But what it usually takes it gets: its answer would hit what goes next.
            timeout = min(timeout, max(CUT_AFTER, unit.reply_times.longest, unit.silent_since + timeout - start))
        if self.feeding.armed:
            self.feeding.strain.sent(job.feeds)
        pair.begin(job, start, timeout, units.late(self._clock.now) if units.owing else (), unit.reply_times)
        if job.reply_timeout is None and unit.late.in_order and self._may_be_hurried(job):
            # Others are served then. The reply may come until it is owed no more all the same.
            slack = pair.host.longest if job.feeds else pair.host.seconds
            pair.deadline -= max(0.0, timeout - unit.reply_times.wait(job, timeout) - slack)
        if not job.expects_reply:
            sent = pair.quiet_at - pair.silence
            over = sent if job.urgency is Urgency.STOP else sent + self.config.turnaround
            self._selector.turnaround_until = max(self._selector.turnaround_until, over)
            self._attempts.note(job, b"", "broadcast" if job.is_broadcast else "sent", sent)
            self.one_way.add(job, over)
        if request.writes:
            self._register_writes.sent(job)
            units.tell_sent(job, start)
        return request.adu

    def _may_be_hurried(self, job: Job) -> bool:
        """Whether a job is waited for no longer than the unit usually takes. A look that was missed is not, for the
        unit may have become slow; and the last attempts of a write are not: a reply that comes late may be that to an
        equal write before it."""
        if not job.request.writes:
            return job.attempts == 1 or job.urgency is not Urgency.CONFIRM
        again = job.internal or job.setpoint or job.attempts <= self._attempts.retries_of(job)
        return job.is_repeatable and again

    # How jobs end

    def _expire(self, job: Job) -> None:
        """Its time is over. On the wire it is waited for on, but its caller is told."""
        if self._selector.waiting.expire(job.read_back or job, self._clock.now) or job.outcome is not None:
            return
        if job in self.one_way and self._clock.now >= job.sent_at + self.pair.line.airtime(len(job.request.adu)):
            self.one_way.ended(job)
        else:
            self._end(job, silence_of(job), Reason.UNAWAITED)

    def _flush(self, jobs: Iterable[Job], which: Callable[[Job], bool], reason: Reason) -> None:
        for job in list(jobs):
            if which(job) and self.queue.remove(job):
                self._drop(job, reason)

    def _drop(self, job: Job, reason: Reason) -> None:
        """It is not sent, or not sent again. What was sent unanswered may have been done."""
        if reason is Reason.LINE_BUSY:
            self.journal.missed()
        if job.unanswered:
            self._end(job, Outcome.UNKNOWN if job.request.writes else Outcome.NO_REPLY, reason)
        else:
            # Of those that were sent and answered, only what the device was too busy for waits once more.
            self._end(job, Outcome.NOT_SENT if job.code is None else Outcome.REFUSED, reason)

    def _end(self, job: Job, outcome: Outcome, reason: Reason = Reason.NONE) -> None:
        if job.outcome is not None:
            return  # its caller has not waited for the end of what is on the wire
        job.outcome = outcome
        job.reason = reason
        job.ended_at = self._clock.now
        if job.timer is not None:
            self._timers.cancel(job.timer)
            job.timer = None
        if job.on_end is not None:
            try:
                job.on_end(job)
            except Exception:
                _log.exception("what was to be called at the end of a request failed: %s", job.request)
        if job.slot is not None:
            self.starts.ended(job)
