"""The owner of the wire. Pure: jobs, bytes and the time go in; bytes to send, outcomes and the next wake come out.

It is a machine driven by calls, no task: nothing can cancel it. One transaction is on the wire at a time; between two
attempts of a job the queue decides anew; a stop waits for nothing but the end of a frame.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from typing import TypeVar

from rs485bus.bus.config import BusConfig
from rs485bus.bus.line.echo import EchoQuestion
from rs485bus.bus.line.serial_line import CUT_AFTER, LOOKS_WAIT, STOP_WAITS, SerialLine
from rs485bus.bus.line.transaction import Kind, Received
from rs485bus.bus.record import Journal
from rs485bus.bus.schedule.admission import AdmissionControl
from rs485bus.bus.schedule.burst_scheduler import BurstScheduler
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.schedule.lingering import Lingering
from rs485bus.bus.schedule.queue import GONE, READY, Queue
from rs485bus.bus.schedule.repeating import Repeating
from rs485bus.bus.schedule.scheduler import Scheduler
from rs485bus.bus.schedule.timers import Timer, Timers
from rs485bus.bus.schedule.waiting import Waiting
from rs485bus.bus.stopping.halt import Halt, Procedure
from rs485bus.bus.stopping.pacing import StopPacing
from rs485bus.bus.units.asking import hurry, question_for
from rs485bus.bus.units.motion import NEVER, Motion
from rs485bus.bus.units.probing import listening_time
from rs485bus.bus.units.unit_state import SILENT, UnitState, UnitStates
from rs485bus.bus.watchdog.feeder import next_feed
from rs485bus.bus.watchdog.feeding import ArmedWatchdog, Feeding
from rs485bus.bus.watchdog.maker import WatchdogMaker
from rs485bus.bus.watchdog.register_writes import RegisterWrites
from rs485bus.wire.exceptions import Meaning, is_a_gateways, is_exception
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Repeat
from rs485bus.wire.timing import LineSettings

T = TypeVar("T")

_log = logging.getLogger("rs485bus")

FOREVER = float("inf")
_LATE = (Kind.LATE, Kind.LATE_EXCEPTION)
_STOPS = (Urgency.STOP,)
_STOP_WAITS_FOR_PORT = 1.0
"""Seconds for which a port may be away before it is said that a device could not be seen standing."""
_SOON = (Urgency.FEED, Urgency.CONFIRM)
_STOPPING = (Urgency.STOP, Urgency.CONFIRM)
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
        self.now = now
        self._native = native
        self.send_at = now
        """When the frame that `tick` returned is to be sent."""
        self.one_way_ends_at = FOREVER
        """When the latest frame that nobody answers (a broadcast) must have gone out; infinity where none is out."""
        self.journal = Journal()
        silence = config.silence_on(line, gateway) * (not numbered)
        echo = False if numbered else None if config.echo == "auto" else config.echo
        self.feeding = Feeding(line.budget(_BROADCAST, config.turnaround, 0) + silence)
        window = config.late_reply_window_of(gateway)
        in_order = config.in_order and not gateway
        self.units = UnitStates(in_order, config.reply_timeout, window, native=native)
        self.pair = SerialLine(line, silence, echo, now)
        self.watchdogs = WatchdogMaker(self.pair, self.journal)
        self.gate = AdmissionControl(self.pair, self.units, self.feeding, config.turnaround)
        self._register_writes = RegisterWrites(self.feeding, self.gate.hearing, self.watchdogs.make)
        self._queue = Queue()
        self._repeating = Repeating(config.retries, self._queue, self._end)
        self.starts = BurstScheduler(self.pair, self._queue, self.gate, self.feeding, self._free_at, self._drop)
        self._waiting = Waiting(self.pair, self._queue, self.gate, self._drop)
        self._turnaround_until = NEVER
        self._one_way: list[Job] = []
        """Jobs that nobody answers, in their turnaround."""
        self._wake = FOREVER
        self._lead = 0.0
        self.host_slack = 0.0
        """Seconds by which this computer may be late to hand a reply over."""
        self._missed = 0
        """The unit that left the latest request unanswered; 0 if that was answered."""
        self._after_stops: list[Callable[[], None]] = []
        self.on_released: Callable[[UnitState], None] = lambda unit: None
        """Told that a device stands at last whose watchdog block was left before it did."""
        self._timers = Timers()
        self._lingering = Lingering(self._timers, self._gave_no_reply)
        self._procedures = Scheduler(lambda job: self.submit(job, self.now), self._timers, now)

    @property
    def wake(self) -> float:
        """When `tick` wants to be called next. Every call may bring that forward; none but `tick` puts it off."""
        return min(self._wake, self._timers.next_at, self.feeding.over_at)

    # Jobs and what is done later

    def submit(self, job: Job, now: float) -> None:
        """Take a job. How it ends is told through `job.on_end`, which may be at once."""
        job.queued_at = self.now = now
        job.outcome = job.code = job.heard = None
        reason = self.gate.refusal(job)
        if self._queue.size >= self.config.max_queued and not job.internal and job.urgency is not Urgency.STOP:
            reason = Reason.QUEUE_FULL
        if reason is Reason.NONE and job.slot is not None:
            reason = self.starts.join(job)
        if reason is Reason.NONE and job.expires_at is not None and job.expires_at <= now:
            reason = Reason.EXPIRED
        if reason is not Reason.NONE:
            self._end(job, Outcome.NOT_SENT, reason)
            return
        self._queue.put(job)
        if job.expires_at is not None:
            job.timer = self.at(job.expires_at, lambda: self._expire(job))
        if self.pair.job is None:
            self._wake = min(self._wake, self.pair.quiet_at - self._lead)
        elif job.urgency is Urgency.STOP:
            self._wake = min(self._wake, self.pair.wait_until(now))

    def cancel(self, job: Job, now: float) -> None:
        """The caller has gone. What was not sent never will be; what is on the wire is finished, not repeated."""
        self.now = now
        job.caller_cancelled = True
        waiting = job.read_back or job
        waiting.caller_cancelled = True
        if job.urgency is not Urgency.STOP and self._queue.remove(waiting):
            self._drop(waiting, Reason.CANCELLED)

    def at(self, when: float, callback: Callable[[], None]) -> Timer:
        """Call back when the time has come."""
        return self._timers.at(when, callback)

    def after_stops(self, callback: Callable[[], None]) -> None:
        """Call back, in a `tick`, as soon as all stops that wait are on the wire, or the port is lost."""
        self._after_stops.append(callback)

    def start(self, procedure: Procedure[T], done: Callable[[T], None]) -> None:
        """Drive a procedure to its end, whatever becomes of who started it."""
        self._procedures.start(procedure, done)

    # The wire

    def feed(self, data: bytes, now: float) -> None:
        """Bytes were received."""
        self.now = now
        for received in self.pair.feed(data, now):
            self._take(received)
        if self.pair.job is None:
            self._wake = min(self._wake, self._look_at())
        elif self.pair.is_brief:
            self._wake = min(self._wake, self.pair.wait_until())

    def feed_late(self, frame: bytes, asked: object, now: float) -> None:
        """A frame was received that answers an older request than the latest: the job `asked`, as its number tells."""
        self.now = now
        unit = self.units[frame[0]]
        if self._native and isinstance(asked, Job) and asked.outcome is None and asked.request.answered_by(frame):
            # The device itself says so: it is the answer to what waits to be sent again, or for the end of its time.
            if self._lingering.leaves(asked) or self._queue.remove(asked):
                asked.answered_since, asked.reply = asked.queued_at, frame
                self.units.heard(unit, now)
                self._end(asked, Outcome.REPLY)
        elif is_exception(frame):
            self._came_late(Kind.LATE_EXCEPTION, unit, None, frame)
        else:
            owed = (owed.request for owed in unit.late if owed.job is asked and owed.request.answered_by(frame))
            self._came_late(Kind.LATE, unit, next(owed, None), frame)

    def tick(self, now: float, lead: float = 0.0) -> bytes | None:
        """Do what is due; return the next frame to send, if there is one.

        A frame may be returned up to `lead` seconds before it may go out, at `send_at`.
        """
        self.now = now
        self._lead = lead
        self._procedures.now = now
        self._timers.run(now)
        for watch in self.feeding.overdue(now):
            self.trip(watch, f"it was unheard for {now - watch.heard_at:.3f} s")
        pair, job, frame, wake = self.pair, None, None, FOREVER
        if pair.job is not None:
            wake = pair.wait_until(self._stop_waits())
            if now >= wake:
                self._unanswered("no reply" if now >= pair.deadline else "cut")
        start = now
        if pair.job is None and self.gate.connected and not self.gate.closed:
            wake = self._look_at()
            if now >= wake:
                self._wake = FOREVER  # who is told meanwhile that a job was dropped may submit another
                if self.feeding.strain.holds:
                    self._give_up_hopeless()
                job, wake = self._choose()
                wake = min(wake, self._wake)
                start = max(now, pair.quiet_at)
            elif pair.heard_at + pair.silence > now and pair.is_noisy:
                job, wake = self._choose_among_noise(wake)
        if job is not None:
            frame = self._send(job, start)
            wake = pair.quiet_at if pair.job is None else pair.wait_until(self._stop_waits())
        self._wake = wake
        if self._after_stops and not (self.gate.connected and self._queue.has(Urgency.STOP)):
            self._stops_are_out()
        return frame

    def unplugged(self, now: float) -> None:
        """The port was lost. What is on the wire fails, what moves is dropped; reads wait for the port."""
        self.now = now
        self.gate.connected = False
        self.at(self._waiting.port_lost(now, self.journal.stats.answers), self._wait_for_port)
        self.pair.exchange.question.reopen()
        if self.pair.job is not None:
            self._unanswered("lost")
        for job in tuple(self._one_way):  # nobody knows whether it went out
            self._one_way_ended(job, Outcome.UNKNOWN, Reason.UNPLUGGED)
        for job in self._lingering.end_all():
            self._end(job, _silence_of(job), Reason.UNPLUGGED)
        self._flush(self._queue, self.gate.needs_port, Reason.UNPLUGGED)
        for unit in self.units:
            watch = self.feeding.get(unit.address)
            if watch is not None:
                self.trip(watch, "the port was lost")
            elif unit.attached is not None:
                unit.attached.motion.stop()
                unit.attached.interrupted(0.0, "the port was lost")
            if unit.halt is not None:
                self._report_if_away(unit.halt)

    def _wait_for_port(self) -> None:
        again = self._waiting.for_port(self.now)
        if again:
            self.at(again, self._wait_for_port)

    def plugged(self, now: float) -> None:
        """The port is there again. The first frames are stops, for all that may be moving."""
        self.now = now
        self.gate.connected = True
        self.pair.restart(now)
        for unit in self.units:
            if unit.attached is not None and (unit.attached.motion.may_move or unit.halt is not None):
                self.halt(unit, unit.attached.motion, emergency=True)
            elif unit.may_be_armed and not unit.guarded:
                self.on_released(unit)

    @property
    def has_plain_stops(self) -> bool:
        """Whether a stop that somebody sent by himself waits, or is on the wire."""
        job = self.pair.job
        out = job is not None and job.urgency is Urgency.STOP and not job.internal
        return out or any(not job.internal for job in self._queue.of_urgency(Urgency.STOP))

    @property
    def is_sending(self) -> bool:
        """Whether a frame is on the wire, or its answer is waited for."""
        return self.pair.job is not None or self.now < self.pair.air_end

    def close(self, now: float) -> None:
        """End everything that waits, whoever waits for it."""
        self.now = now
        self.gate.closing = self.gate.closed = True
        for unit in self.units:
            if unit.halt is not None:
                unit.halt.end()
        if self.pair.job is not None:
            self._unanswered("lost")
        for job in tuple(self._one_way):
            sent = now >= self.pair.air_end
            self._one_way_ended(job, Outcome.REPLY if sent else Outcome.UNKNOWN, Reason.CLOSED)
        for job in self._lingering.end_all():
            self._end(job, _silence_of(job))
        self._flush(self._queue, lambda _: True, Reason.CLOSED)
        self._procedures.end_all(now)
        self._timers.clear()
        self._stops_are_out()

    # Stopping

    def halt(
        self, unit: UnitState, motion: Motion, *, emergency: bool, frames: tuple[Request, ...] | None = None
    ) -> Halt:
        """Stop a device, or the part of it named, until it is seen standing. Nothing older that moves it follows."""
        attached, halt = unit.attached, unit.halt
        assert attached is not None
        motion.stop()
        if halt is None:
            halt = unit.halt = Halt(attached, motion, emergency, self.now, frames)
            pacing = StopPacing(unit, self.feeding, self.pair, self.units.listening)
            self.start(halt.run(pacing), lambda stands: self._halted(unit, stands))
        else:
            waiting = {job.request for job in self._queue.of(unit.address) if job.urgency is Urgency.STOP}
            for request in halt.again(motion, emergency, self.now):
                if request in waiting:
                    continue  # it is as good as a further one
                self.submit(
                    Job(request, urgency=Urgency.STOP, ignores_late_replies=True, internal=True, retries=0), self.now
                )
        if not self.gate.connected:
            self._report_if_away(halt)
        # The stops are queued by now; and only this device's jobs are looked at, lest a long queue hold them up.
        self._flush(self._queue.of(unit.address), lambda job: job.is_stale, Reason.STOPPED)
        return halt

    def _report_if_away(self, halt: Halt) -> None:
        """Say before long that a device could not be seen standing, where the port stays away. It is stopped first of
        all when it is there again. Closing waits for that."""

        def report() -> None:
            if not self.gate.connected and not self.gate.closing:
                halt.give_up()

        self.at(self.now + _STOP_WAITS_FOR_PORT, report)

    def stops_only(self, unit: UnitState) -> None:
        """Nothing but stops to this device until it stands: neither polls nor feeds."""
        unit.is_stops_only = True
        self.feeding.mute(unit.address)

    def restarted(self, unit: UnitState) -> None:
        """The device was seen to have started anew, which whoever saw it tells. Its watchdog register may be back at
        its default: inside of a block it counts as tripped, so that it is armed again before it moves."""
        unit.watchdog_ms = None
        watch = self.feeding.get(unit.address)
        if watch is not None and unit.guarded:
            self._lock(unit, watch, "it has started anew, and its watchdog may be off")

    def trip(self, watch: ArmedWatchdog, reason: str) -> None:
        """The device may have been stopped by its watchdog: it moves only after it was armed again."""
        unit = self.units[watch.address]
        assert unit.attached is not None
        if self.now >= watch.over:
            unit.unheard(watch.heard_at, SILENT)
        self._lock(unit, watch, f"its watchdog may have stopped it: {reason}")
        unit.attached.interrupted(self.now - watch.heard_at, reason)

    def _lock(self, unit: UnitState, watch: ArmedWatchdog, why: str) -> None:
        """It moves only after it was enabled again, and is fed only then."""
        attached = unit.attached
        assert attached is not None
        self.feeding.trip(watch)
        unit.locked = why
        # Outside of a block nothing is armed again; but what can be read to be on is fed again.
        unit.rearm = watch.timeout if unit.guarded or _can_be_read(unit) else None
        attached.motion.stop()
        self._flush(self._queue.of(watch.address), lambda job: job.is_stale, Reason.LOCKED)
        if attached.motion.may_move:
            self.halt(unit, attached.motion, emergency=True)

    def _give_up_hopeless(self) -> None:
        """Where devices answer too slowly for all to be fed, stop the slowest instead of starving the others."""
        while (watch := self.feeding.hopeless(self.now)) is not None:
            self.trip(watch, f"it takes {1000 * watch.takes:.0f} ms to be fed now, and cannot be fed in time any more")

    def flush(self, reason: Reason) -> None:
        """End every job that waits but the bus' own and stops."""
        self._flush(self._queue, lambda job: not job.internal and job.urgency is not Urgency.STOP, reason)

    def _stops_are_out(self) -> None:
        callbacks, self._after_stops = self._after_stops, []
        for callback in callbacks:
            try:
                callback()
            except Exception:
                _log.exception("what was to be called when the stops were out failed")

    def _halted(self, unit: UnitState, stands: bool) -> None:
        halt, unit.halt = unit.halt, None
        if halt is None or not stands:
            return
        halt.motion.stands(self.now)
        unit.is_stops_only = False
        self.feeding.unmute(unit.address)
        if unit.may_be_armed and not unit.guarded:
            self.on_released(unit)

    # What goes next

    def _stop_waits(self) -> float | None:
        """Since when a stop waits that what is on the wire is cut for: it could go then, and nothing trips for that.
        None if there is none."""
        if not self._queue.has(Urgency.STOP):
            return None
        job, now = self.pair.job, self.now
        if job is not None and job.feeds and not self.feeding.may_wait(job.address, now):
            return None
        stops = (stop for stop in self._queue.heads(Urgency.STOP) if not self.gate.is_rationed(stop, now))
        return min((stop.queued_at for stop in stops if self.gate.wait(stop, now) <= now), default=None)

    def _free_at(self) -> float:
        """From when on the next frame may be handed out, if nothing is out."""
        return max(self.pair.quiet_at - self._lead, self._turnaround_until)

    def _look_at(self) -> float:
        """When something may go, if nothing is out. What somebody waits for is made ready while the line is quiet."""
        if self._queue.size:
            return self.pair.quiet_at - self._lead
        probe_at = self.units.to_probe_at(self.now, idle=True)
        return max(self.pair.quiet_at, min(self.feeding.next_at(self.now), probe_at))

    def _choose(self) -> tuple[Job | None, float]:
        """The job that goes next or, if there is none, when to look again."""
        job, wake = self._queue.take(self._admit, _STOPS)
        if job is not None:
            return job, wake
        if self.now < self._turnaround_until:
            return None, min(wake, self._turnaround_until)
        if self.gate.pauses.held is not None and not self.starts:
            job, again = self._keep_quiet()
            if again > self.now or job is not None:
                return job, min(wake, again)
        watch = self.feeding.due(self.now)
        kept = False
        if self.starts and (watch is None or not self.starts.gives_way(self.now)):
            job, again, kept = self.starts.next(self.now)
            if job is not None:
                return job, again
            wake = min(wake, again)
        if watch is not None:
            other = self._take_its_turn() if self.feeding.strain.yields else None
            return self._feed(watch, wake) if other is None else (other, wake)
        wake = min(wake, self.feeding.look_at)
        job, again = self._queue.take(self._admit, _SOON)
        if job is not None or kept:
            return job, min(wake, again)
        # Looking for lost units is rationed; what is due of it is not put off by traffic.
        lost = self.units.to_probe(self.now)
        if lost is not None and (job := self._look_for(lost)) is not None:
            return job, wake
        wake = min(wake, again)
        if self.gate.held_up and (job := self._ask_instead()) is not None:
            return job, wake
        question = self.pair.exchange.question
        if question.is_pressing and (job := self._ask_of_echo(question)) is not None:
            return job, wake
        job, again = self._queue.take_rest(self._admit)
        if job is None and self.gate.held_up:
            job = self._ask_instead()
        if job is not None:
            return job, again
        watch = self.feeding.soon(self.now)
        if watch is not None:
            return self._feed(watch, wake)
        lost = self.units.to_probe(self.now, idle=True)
        if lost is not None and (job := self._look_for(lost)) is not None:
            return job, wake
        wake = min(wake, again, self.units.to_probe_at(self.now, idle=True))
        return self._ask_of_echo(question) if question.is_open else None, wake

    def _ask_of_echo(self, question: EchoQuestion) -> Job | None:
        """A read of a unit that something waits to be written to, until it is known whether the adapter echoes."""
        now, units = self.now, self.units
        waiting = (job.address for job in self._queue if self.gate.waits_for_verdict(job))
        address = question.ask(address for address in waiting if units[address].silent_until <= now)
        return None if address is None else self._look_for(units[address])

    def _ask_instead(self) -> Job | None:
        """A question for a unit that owes a reply for which somebody waits."""
        units, self.gate.held_up = self.gate.held_up, set()
        ready = None
        for unit in units:
            job = question_for(unit, self.now)
            if job is None:
                continue
            if ready is None and self._admit(job) == READY:
                job.queued_at, ready = self.now, job
            else:
                self.submit(job, self.now)
        return ready

    def _feed(self, watch: ArmedWatchdog, wake: float) -> tuple[Job | None, float]:
        """What feeds a watchdog, once the pair was quiet for as long as its device wants."""
        pause = self.units[watch.address].pause
        if pause and (again := self.gate.pauses.wait_to_feed(watch.address, pause, self.now)) > READY:
            return None, min(wake, again)
        return next_feed(watch, self.feeding, self._queue, self.units, self._admit, self.now), wake

    def _keep_quiet(self) -> tuple[Job | None, float]:
        """The job that the pair is kept quiet for, if it may go, or when to ask again; neither if it is not kept."""
        job = self.gate.pauses.held
        assert job is not None
        verdict = GONE if job.outcome is not None else self._admit(job)
        pauses = self.gate.pauses
        if verdict > READY and verdict == pauses.until:
            if not pauses.is_hopeless(job, self.now):
                return None, verdict if pauses.held is job else 0.0
            self._drop(job, Reason.LINE_BUSY)
            verdict = GONE
        pauses.held = None  # its turn has come, or it waits for something else
        if verdict > READY:
            return None, 0.0
        self._queue.remove(job)
        return (job if verdict == READY else None), 0.0

    def _take_its_turn(self) -> Job | None:
        """What else goes before a feed, if there is anything, and time for it."""
        if not self._queue.size:
            return None
        job, _ = self._queue.take(self._admit, _SOON)
        if job is None:
            job, _ = self._queue.take_rest(self._admit)
        if job is None:
            self.feeding.strain.starved(self.now)
        return job

    def _choose_among_noise(self, wake: float) -> tuple[Job | None, float]:
        """The stop, or the look that confirms one, that waits for silence no longer; else when to look again."""
        self.pair.noise_at = self.now
        job, again = self._queue.take(self._admit_over_noise, _STOPPING)
        return job, min(wake, again, self._waiting.for_silence(self.now))

    def _admit_over_noise(self, job: Job) -> float:
        verdict = self._admit(job)
        waits = LOOKS_WAIT if job.urgency is Urgency.CONFIRM else STOP_WAITS
        waiting_since = max(job.queued_at, self.pair.noisy_since)
        over = max(waiting_since + waits, self.pair.through_noise_at)
        return verdict if verdict != READY or over <= self.now else over

    def _admit(self, job: Job) -> float:
        reason = self.gate.refusal(job)
        if reason is not Reason.NONE:
            self._drop(job, reason)
            return GONE
        return self.gate.wait(job, self.now)

    def _look_for(self, unit: UnitState) -> Job | None:
        """A read that only asks whether anybody answers; None if it goes once the pair was quiet for long enough."""
        request = unit.harmless_read()
        job = Job(request, urgency=Urgency.POLL, ignores_late_replies=True, internal=True, retries=0)
        listens = unit.reply_timeout
        if unit.reach.offline:
            listens = listening_time(listens, self.journal.unit(unit.address).latency(1.0))
        listens = min(listens, self.gate.longest_wait(request))
        if listens < unit.reply_timeout:
            job.reply_timeout = listens
        if not unit.pause:
            return job
        if not self._queue.has(Urgency.POLL, unit.address):
            self.submit(job, self.now)
        return None

    # One transaction

    def _send(self, job: Job, start: float) -> bytes:
        self.send_at = start
        job.attempts += 1
        job.code = None
        job.sent_at = start
        if job.moves and job.motion is not None and job.request.writes:
            job.motion.commanded(start)
        unit = self.units[job.address]
        timeout = unit.reply_timeout if job.reply_timeout is None else job.reply_timeout
        if unit.asked_in_vain and job.urgency is Urgency.STOP and self.feeding.guards_others(job.address):
            # Whether it is there is known when it was silent for its time; others must not trip for that.
            timeout = min(timeout, max(CUT_AFTER, unit.silent_since + timeout - start))
        self.feeding.strain.sent(job.feeds)
        self.pair.begin(job, start, timeout, self.units.late(self.now))
        if job.reply_timeout is None and unit.late.in_order and self._may_be_hurried(job):
            # Others are served then. The reply may come until it is owed no more all the same.
            self.pair.deadline -= max(0.0, timeout - unit.reply_times.wait(job, timeout) - self.host_slack)
        if not job.expects_reply:
            sent = self.pair.quiet_at - self.pair.silence
            over = sent if job.urgency is Urgency.STOP else sent + self.config.turnaround
            self._turnaround_until = max(self._turnaround_until, over)
            self._note(job, b"", "broadcast" if job.is_broadcast else "sent", sent)
            self._one_way.append(job)
            self.one_way_ends_at = over
            self.at(over, lambda: self._one_way_ended(job, Outcome.REPLY))
        if job.request.writes:
            self._register_writes.sent(job)
        return job.request.adu

    def _may_be_hurried(self, job: Job) -> bool:
        """Whether a job is waited for no longer than the unit usually takes. A look that was missed is not, for the
        unit may have become slow; and the last attempts of a write are not: a reply that comes late may be that to an
        equal write before it."""
        if not job.request.writes:
            return job.attempts == 1 or job.urgency is not Urgency.CONFIRM
        return job.is_repeatable and (job.internal or job.attempts <= self._retries_of(job))

    def _retries_of(self, job: Job) -> int:
        return self.config.retries if job.retries is None else job.retries

    def _one_way_ended(self, job: Job, outcome: Outcome, reason: Reason = Reason.NONE) -> None:
        if job in self._one_way:
            self._one_way.remove(job)
            if not self._one_way:
                self.one_way_ends_at = FOREVER
            self._end(job, outcome, reason)

    def _take(self, received: Received) -> None:
        kind, request, frame = received
        unit = self.units[request.address]
        if kind in _LATE:
            self._came_late(kind, unit, request, frame)
        elif kind is not Kind.ECHO and (job := self.pair.job) is not None:
            unit.late.expire(self.now)
            if kind is Kind.NORMAL:
                undecided = job.urgency is Urgency.STOP and self._is_anothers(job, unit, frame)
            else:
                undecided = unit.late.leaves_undecided(job, frame)
            if not undecided:
                self._answered(job, unit, kind, frame)
            else:
                self.pair.exchange.pass_over(frame)
                self._heard_of(unit, frame)

    def _came_late(self, kind: Kind, unit: UnitState, request: Request | None, frame: bytes) -> None:
        """A late reply came, to a request that is owed one; None if no such is owed. It is delivered to nobody but the
        same job, which waits to be sent again. But whoever answers late is there, and heard what was asked then."""
        self.journal.unit(unit.address).late_replies += 1
        unit.heard_at = self.now
        if kind is Kind.LATE_EXCEPTION:
            unit.late.excepted(frame[1] & 0x7F, frame)
            self._heard_of(unit, frame)
            return
        self.units.heard(unit, self.now)
        hurry(unit, self.now)
        if request is None:
            return
        waiting = unit.late.waiting(request, frame)
        if (since := unit.late.arrived(request, frame)) is not None:
            self.feeding.heard(unit.address, since)
            if waiting is not None and (self._lingering.leaves(waiting) or self._queue.remove(waiting)):
                waiting.answered_since, waiting.reply = since, frame
                self._end(waiting, Outcome.REPLY)

    def _is_anothers(self, job: Job, unit: UnitState, frame: bytes) -> bool:
        """Whether the answer to a stop may be an older request's, for whose reply the stop did not wait."""
        if job.ignores_late_replies or not unit.late.must_wait(job.request, job):
            return False
        self.journal.unit(unit.address).late_replies += 1
        unit.late.arrived(job.request, frame)
        return True

    def _heard_of(self, unit: UnitState, frame: bytes) -> None:
        """A frame came that ended nothing. It tells that the unit is there, unless a gateway says that it is not."""
        if not is_a_gateways(frame):
            self.units.heard(unit, self.now)

    def _answered(self, job: Job, unit: UnitState, kind: Kind, frame: bytes) -> None:
        meaning = None
        if kind is not Kind.NORMAL:
            if kind is Kind.EXCEPTION:
                job.code = frame[2]
            meaning = unit.meaning(job.request, job.code)
            if meaning is Meaning.UNANSWERED:
                self._unanswered("no reply", frame)
                return
        since = unit.late.answered(job, self.pair.owed_until + unit.late_reply_window, frame)
        job.answered_since = since
        job.reply = frame
        self.units.answered(unit, job.request)
        self._missed = 0
        unit.heard_at = self.now
        if meaning is not None:
            unit.answers.refused(job.request)
        elif not job.unanswered and since == job.sent_at and self.now <= self.pair.deadline:
            took = self.now - since - self.pair.line.airtime(len(job.request.adu) + len(frame)) - self.pair.latency
            unit.reply_times.answered(job, took)
        if self.gate.silent:
            self.gate.silent.pop(unit, None)
        self._note(job, frame, "reply" if meaning is None else "refused", self.now)
        told = since == job.sent_at and self.pair.exchange.judge()
        if not told and not job.request.writes:
            self.pair.exchange.question.tried(job.address)
        self.pair.end(self.units.late(self.now), self.now, answered=True)
        if meaning is not None:
            self._fed_nothing(job)
            self._repeating.after_exception(job, meaning, self.now)
            return
        self.feeding.heard(unit.address, since, job.sent_at)
        if job.feeds and since == job.sent_at:
            air = self.pair.line.airtime(len(job.request.adu) + len(frame))
            self.feeding.fed(unit.address, self.now - job.sent_at - air)
        if job.request.writes:
            self._register_writes.acknowledged(job, unit)
        if unit.attached is not None and job.internal and since == job.sent_at:
            unit.attached.told(job.request, frame, since)
        self._end(job, Outcome.REPLY)

    def _unanswered(self, how: str, frame: bytes = b"") -> None:
        """The attempt on the wire got no reply: its time is over, a gateway says so in a frame, a stop cut it short, or
        the port was lost."""
        job = self.pair.job
        assert job is not None
        unit = self.units[job.address]
        job.unanswered += 1
        job.cuts += how == "cut"
        in_doubt = how == "no reply" and self.pair.exchange.is_in_doubt
        job.heard = self.pair.exchange.heard() or job.heard
        owed_until = max(self.pair.owed_until, self.now)
        unit.unheard(job.sent_at)
        self.units.owes(unit, job, owed_until)
        self._note(job, frame, how, self.now)
        if not job.request.writes:
            self.pair.exchange.question.tried(job.address)
        if how == "no reply":
            if not frame:
                if job.attempts == 1 and self.now < owed_until and not job.backs_off:
                    job.patient_until = job.sent_at + self._retries_of(job) * (owed_until - job.sent_at)
                unit.reply_times.missed(job)
                self.gate.silent[unit] = owed_until
            if job.sent_at >= unit.misses_count_from:
                unit.misses_count_from = owed_until
                self.units.unanswered(unit, job, self.now)
        self.pair.end(self.units.late(self.now), self.now, answered=False)
        self._fed_nothing(job, how)
        if job.urgency in _STOPPING and self.feeding.guards_others(job.address):
            self.gate.ration.spend(self.now - job.sent_at, self.now)
        read = unit.harmless_read
        if in_doubt and self._repeating.after_doubt(job, read(), lambda why: self._was_in_doubt(job, why), self.now):
            return
        self._not_answered(job, unit, how, 0.0 if job.internal or frame or how != "no reply" else owed_until)

    def _was_in_doubt(self, job: Job, reason: Reason) -> None:
        """The adapter has been found out, or nobody answered, or that could not be asked."""
        unit = self.units[job.address]
        if reason is not Reason.NONE:
            self._end(job, _silence_of(job), reason)
        elif self.pair.exchange.echo is not False:
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
        if how != "lost" and not unit.reach.silent and self._repeating.after_silence(job, self.now):
            if missed not in (0, job.address):
                # It may have taken this request for the answer that its neighbour did not give.
                self._queue.hurry(job)
            return
        if may_come_until > self.now:
            self._lingering.add(job, may_come_until)
            return
        if how == "no reply" and not job.internal:
            self.units.missed(unit, self.now, self.config.offline_after)
        lost = Reason.CLOSED if self.gate.closed else Reason.UNPLUGGED
        self._end(job, _silence_of(job), lost if how == "lost" else Reason.NONE)

    def _gave_no_reply(self, job: Job, reason: Reason = Reason.NONE) -> None:
        """The last attempt was not answered within the longest time that the unit may take."""
        self.units.missed(self.units[job.address], self.now, self.config.offline_after)
        self._end(job, _silence_of(job), reason)

    def _fed_nothing(self, job: Job, how: str = "refused") -> None:
        """The job's latest attempt was not acknowledged."""
        if job.feeds or (job.urgency in _STOPPING and how != "refused"):
            job.feeds = False
            self.feeding.failed(job.address, self.now, self.now - job.sent_at, cut=how == "cut")

    # How jobs end

    def _expire(self, job: Job) -> None:
        """Its time is over. On the wire it is waited for on, but its caller is told."""
        if self._waiting.expire(job.read_back or job, self.now) or job.outcome is not None:
            return
        if job in self._one_way and self.now >= job.sent_at + self.pair.line.airtime(len(job.request.adu)):
            self._one_way_ended(job, Outcome.REPLY)
        else:
            self._end(job, _silence_of(job), Reason.UNAWAITED)

    def _flush(self, jobs: Iterable[Job], which: Callable[[Job], bool], reason: Reason) -> None:
        for job in list(jobs):
            if which(job) and self._queue.remove(job):
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
        job.ended_at = self.now
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

    def _note(self, job: Job, reply: bytes, outcome: str, now: float) -> None:
        record, crc_errors = self.pair.record(job, reply, outcome, now)
        self.journal.unit(job.address).crc_errors += crc_errors
        self.journal.add(record)


def _silence_of(job: Job) -> Outcome:
    """What it means that a job was sent and not answered."""
    safe = job.repeat is Repeat.SAFE or not job.request.writes
    return Outcome.NO_REPLY if safe else Outcome.UNKNOWN


def _can_be_read(unit: UnitState) -> bool:
    """Whether its watchdog register can."""
    watchdog = None if unit.attached is None else unit.attached.watchdog
    return watchdog is not None and watchdog.read() is not None
