"""What goes onto the wire next. Pure.

Stops first; then, while nothing is in its turnaround, bursts that have begun, feeds that are due, what confirms, looks
for lost units, and the rest of the queue. Where an owed reply is in the way of somebody, the unit is asked something
else instead.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator

from rs485bus.bus.clock import Clock
from rs485bus.bus.line.echo import EchoQuestion
from rs485bus.bus.line.serial_line import LOOKS_WAIT, STOP_WAITS, SerialLine
from rs485bus.bus.record import Journal
from rs485bus.bus.schedule.admission import AdmissionControl
from rs485bus.bus.schedule.burst_scheduler import BurstScheduler
from rs485bus.bus.schedule.job import NO_REASON, Job, Reason, Urgency
from rs485bus.bus.schedule.pipeline import Pipeline
from rs485bus.bus.schedule.queue import GONE, READY, Queue
from rs485bus.bus.schedule.waiting import Waiting
from rs485bus.bus.units.asking import question_for
from rs485bus.bus.units.motion import NEVER
from rs485bus.bus.units.probing import listening_time
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.units.unit_states import UnitStates
from rs485bus.bus.watchdog.feeder import next_feed
from rs485bus.bus.watchdog.feeding import ArmedWatchdog, Feeding
from rs485bus.wire.frames import Request

_STOPS = (Urgency.STOP,)
_STOPPING = (Urgency.STOP, Urgency.CONFIRM)
_FOREVER = float("inf")
_READS = 4
"""Reads, at most, of which one is looked for that is in nobody's way."""


class Selector:
    """Selects the frame that goes next.

    Args:
        clock: the time.
        pair: the pair.
        queue: what waits for it.
        gate: who may go onto it.
        feeding: the armed watchdogs.
        units: what is known of each address.
        journal: what was sent before.
        pipeline: what is out beside each other.
        submit: takes a job.
        drop: ends a job that was taken out of the queue.
    """

    def __init__(
        self,
        clock: Clock,
        pair: SerialLine,
        queue: Queue,
        gate: AdmissionControl,
        feeding: Feeding,
        units: UnitStates,
        journal: Journal,
        pipeline: Pipeline,
        submit: Callable[[Job], None],
        drop: Callable[[Job, Reason], None],
    ) -> None:
        self._clock = clock
        self._pair = pair
        self._queue = queue
        self._gate = gate
        self._feeding = feeding
        self._units = units
        self._journal = journal
        self._pipeline = pipeline
        self._submit = submit
        self._drop = drop
        self.lead = 0.0
        """Seconds before its time by which a frame may be handed out."""
        self.turnaround_until = NEVER
        """Until when nothing but stops goes: a broadcast is being carried out."""
        self.starts = BurstScheduler(pair, queue, gate, feeding, self.free_at, drop)
        self.waiting = Waiting(pair, queue, gate, drop)

    def stop_waits(self) -> float | None:
        """Since when a stop waits that what is on the wire is cut for: it could go then, and nothing trips for that.
        None if there is none."""
        if not self._queue.stops:
            return None
        job, now = self._pair.job, self._clock.now
        if job is not None and job.feeds and not self._feeding.may_wait(job.address, now):
            return None
        stops = (stop for stop in self._queue.heads(Urgency.STOP) if not self._gate.is_rationed(stop, now))
        return min((stop.queued_at for stop in stops if self._gate.wait(stop, now) <= now), default=None)

    def over_at(self) -> float:
        """Until when the job that is out may still be answered."""
        job, pair = self._pair.job, self._pair
        if not (self._queue.stops or pair.is_brief):
            return pair.deadline
        asked_at = self.stop_waits()
        if asked_at is None or job is None:
            return pair.wait_until(asked_at)
        expected = self._units[job.address].reply_times.expected(job)
        return self._pair.wait_until(asked_at, expected, patient=job.urgency in _STOPPING and self._only_repetitions)

    @property
    def _is_idle(self) -> bool:
        """Whether nobody waits for the pair, nor a unit to be looked for."""
        units = self._units
        return not (self._queue.size or units.lost or units.doubted)

    @property
    def _only_repetitions(self) -> bool:
        """Whether all stops that wait were said before. They would keep each other from ever being answered."""
        halts = (self._units[stop.address].halt for stop in self._queue.heads(Urgency.STOP))
        return all(halt is not None and halt.is_said for halt in halts)

    def free_at(self) -> float:
        """From when on the next frame may be handed out, if nothing is out."""
        return max(self._pair.quiet_at - self.lead, self.turnaround_until)

    def look_at(self) -> float:
        """When something may go, if nothing is out. What somebody waits for is made ready while the line is quiet."""
        if self._queue.size:
            return self._pair.quiet_at - self.lead
        feeding, units, now = self._feeding, self._units, self._clock.now
        at = _FOREVER if feeding.look_at == _FOREVER else feeding.next_at(now)
        if units.lost or units.doubted:
            at = min(at, units.to_probe_at(now, idle=True))
        return max(self._pair.quiet_at, at)

    def next(self) -> tuple[Job | None, float]:
        """The job that goes next or, if there is none, when to look again."""
        wake, feeding, units = _FOREVER, self._feeding, self._units
        if self._queue.stops:
            job, wake = self._queue.take(self._admit, _STOPS)
            if job is not None:
                return job, wake
        if self._clock.now < self.turnaround_until:
            return None, min(wake, self.turnaround_until)
        if self._gate.pauses.held is not None and not self.starts:
            job, again = self._keep_quiet()
            if again > self._clock.now or job is not None:
                return job, min(wake, again)
        watch = feeding.first(self._clock.now) if self._is_idle else None
        if watch is None and feeding.look_at < _FOREVER:
            watch = feeding.due(self._clock.now)
        kept = False
        if self.starts.waiting and (watch is None or not self.starts.gives_way(self._clock.now)):
            job, again, kept = self.starts.next(self._clock.now)
            if job is not None:
                return job, again
            wake = min(wake, again)
        if watch is not None:
            other = self._take_its_turn() if self._feeding.strain.yields else None
            return self._feed(watch, wake) if other is None else (other, wake)
        wake = min(wake, feeding.look_at)
        job, again = self._queue.take_soon(self._admit, self._clock.now)
        if job is not None or kept:
            return job, min(wake, again)
        # Looking for lost units is rationed; what is due of it is not put off by traffic.
        if units.lost or units.doubted:
            lost = units.to_probe(self._clock.now)
            if lost is not None and (job := self._look_for(lost)) is not None:
                return job, wake
        wake = min(wake, again)
        if self._gate.held_up and (job := self._ask_instead()) is not None:
            return job, wake
        question = self._pair.exchange.question
        if question.is_pressing and (job := self._ask_of_echo(question)) is not None:
            return job, wake
        job, again = self._queue.take_rest(self._admit)
        if job is None and self._gate.held_up:
            job = self._ask_instead()
        if job is not None:
            return job, again
        watch = feeding.soon(self._clock.now)
        if watch is not None:
            return self._feed(watch, wake)
        lost = units.to_probe(self._clock.now, idle=True)
        if lost is not None and (job := self._look_for(lost)) is not None:
            return job, wake
        wake = min(wake, again, units.to_probe_at(self._clock.now, idle=True))
        return self._ask_of_echo(question) if question.is_open else None, wake

    def next_among_noise(self, wake: float) -> tuple[Job | None, float]:
        """The stop, or the look that confirms one, that waits for silence no longer; else when to look again."""
        if self._pair.hears_noise:
            self._pair.noise_at = self._clock.now
        job, again = self._queue.take(self._admit_over_noise, _STOPPING)
        return job, min(wake, again, self.waiting.for_silence(self._clock.now))

    def _keep_quiet(self) -> tuple[Job | None, float]:
        """The job that the pair is kept quiet for, if it may go, or when to ask again; neither if it is not kept."""
        job = self._gate.pauses.held
        assert job is not None
        verdict = GONE if job.outcome is not None else self._admit(job)
        pauses = self._gate.pauses
        if verdict > READY and verdict == pauses.until:
            if not pauses.is_hopeless(job, self._clock.now):
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
        job, _ = self._queue.take_soon(self._admit, self._clock.now)
        if job is None:
            job, _ = self._queue.take_rest(self._admit)
        if job is None:
            self._feeding.strain.starved(self._clock.now)
        return job

    def _feed(self, watch: ArmedWatchdog, wake: float) -> tuple[Job | None, float]:
        """What feeds a watchdog, once the pair was quiet for as long as its device wants."""
        pause = self._units.by_address[watch.address].pause
        if pause and (again := self._gate.pauses.wait_to_feed(watch.address, pause, self._clock.now)) > READY:
            return None, min(wake, again)
        return next_feed(watch, self._feeding, self._queue, self._units, self._admit, self._clock.now), wake

    def _ask_of_echo(self, question: EchoQuestion) -> Job | None:
        """A read of a unit that something waits to be written to, until it is known whether the adapter echoes."""
        now, units = self._clock.now, self._units
        waiting = (job.address for job in self._queue if self._gate.waits_for_verdict(job))
        address = question.ask(address for address in waiting if units[address].silent_until <= now)
        return None if address is None else self._look_for(units[address])

    def _ask_instead(self) -> Job | None:
        """A question for a unit that owes a reply for which somebody waits."""
        units, self._gate.held_up = self._gate.held_up, set()
        ready = None
        for unit in units:
            if next(self._held_up(unit), None) is None:
                continue  # it has answered meanwhile
            job = question_for(unit, self._clock.now, functools.partial(self._is_in_the_way, unit))
            if job is None:
                continue
            if ready is None and self._admit(job) == READY:
                job.queued_at, ready = self._clock.now, job
            else:
                self._submit(job)
        return ready

    def _look_for(self, unit: UnitState) -> Job | None:
        """A read that only asks whether anybody answers; None if it goes once the pair was quiet for long enough, or
        if the unit is asked anyway as soon as it owes nothing that could be taken for the answer."""
        request, tries = unit.harmless_read(), _READS
        while tries and self._is_in_the_way(unit, request):
            request, tries = unit.harmless_read(), tries - 1
        if not tries:
            unit.reach.probe_at = self._clock.now + unit.late_reply_window
            return None
        job = Job(request, urgency=Urgency.POLL, ignores_late_replies=True, internal=True, retries=0)
        listens = unit.reply_timeout
        if unit.reach.offline:
            listens = listening_time(listens, self._journal.unit(unit.address).latency(1.0))
        listens = min(listens, self._gate.longest_wait(request))
        if listens < unit.reply_timeout:
            job.reply_timeout = listens
        if not unit.pause:
            return job
        if not self._queue.has(Urgency.POLL, unit.address):
            self._submit(job)
        return None

    def _is_in_the_way(self, unit: UnitState, request: Request) -> bool:
        """Whether a read of the bus' own, if it were not answered, would keep somebody waiting for longer who waits for
        what the unit owes."""
        return any(request.may_answer(waiting) for waiting in self._held_up(unit))

    def _held_up(self, unit: UnitState) -> Iterator[Request]:
        """What waits for what the unit owes."""
        waiting = self._queue.next_of(unit.address) if unit.late else ()
        return (job.request for job in waiting if unit.late.must_wait(job.request, job))

    def _admit_over_noise(self, job: Job) -> float:
        verdict = self._admit(job)
        waits = LOOKS_WAIT if job.urgency is Urgency.CONFIRM else STOP_WAITS
        waiting_since = max(job.queued_at, self._pair.noisy_since)
        over = max(waiting_since + waits, self._pair.through_noise_at)
        return verdict if verdict != READY or over <= self._clock.now else over

    def _admit(self, job: Job) -> float:
        gate = self._gate
        reason = gate.refusal(job)
        if job.backs_off and reason is NO_REASON and self._is_in_the_way(self._units[job.address], job.request):
            reason = Reason.OWED
        if reason is not NO_REASON:
            self._drop(job, reason)
            return GONE
        until = gate.wait(job, self._clock.now)
        if until > self._clock.now:
            gives_up_at = gate.gives_up_at(job)
            if gives_up_at <= self._clock.now:
                self._units.missed(self._units[job.address], self._clock.now)
                self._drop(job, Reason.OWED)
                return GONE
            until = min(until, gives_up_at)
        return self._pipeline.wait(job) if self._pipeline.out and until == READY else until
