"""Who may go onto the wire: asked when a job is submitted, and again immediately before each transmission. Pure."""

from __future__ import annotations

from dataclasses import replace

from rs485bus.bus.config import BusConfig
from rs485bus.bus.line.serial_line import SerialLine
from rs485bus.bus.schedule.job import FEED, NO_REASON, START, STOP, Job, Reason, Urgency
from rs485bus.bus.schedule.pauses import PauseKeeper
from rs485bus.bus.schedule.queue import READY
from rs485bus.bus.stopping.ration import StopRation
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.units.unit_states import UnitStates
from rs485bus.bus.watchdog.feeding import Feeding
from rs485bus.bus.watchdog.reckoning import add_up
from rs485bus.errors import WatchdogInfeasible
from rs485bus.wire.frames import MAX_FRAME, Request

_FOREVER = float("inf")
_HELD_UP = 5.0
"""Seconds, at least, for which a job waits for late replies of its unit to end."""
_STOPPING = (Urgency.STOP, Urgency.CONFIRM)


class AdmissionControl:
    """The state of the bus, as far as it keeps jobs off the wire.

    Args:
        pair: the pair.
        units: what is known of each address.
        feeding: the armed watchdogs.
        config: how the bus behaves.
    """

    __slots__ = (
        "_by_address",
        "_echo",
        "_feeding",
        "_line",
        "_pair",
        "_retries",
        "_turnaround",
        "_units",
        "closed",
        "closing",
        "connected",
        "held_up",
        "latched",
        "pauses",
        "ration",
        "silent",
    )

    def __init__(self, pair: SerialLine, units: UnitStates, feeding: Feeding, config: BusConfig) -> None:
        self._pair = pair
        self._line = pair.line
        self._echo = pair.exchange.question
        self.pauses = PauseKeeper(pair)
        self._units = units
        self._by_address = units.by_address
        self._feeding = feeding
        self._turnaround = config.turnaround
        self._retries = config.retries
        self.ration = StopRation()
        """Of stops to devices that do not answer."""
        self.latched = False
        """An emergency stop was made; nothing moves until it is cleared."""
        self.closing = False
        """The bus is being closed: nothing is set in motion any more."""
        self.closed = False
        self.connected = True
        self.held_up: set[UnitState] = set()
        """Units for whose owed reply somebody waits."""
        self.silent: dict[UnitState, float] = {}
        """Until when units may still answer that were not waited for as long."""

    def refusal(self, job: Job) -> Reason:
        """Why a job may be sent neither now nor later; NONE if it may."""
        if self.closed:
            return Reason.CLOSED
        if job.urgency is STOP:
            return NO_REASON
        if job.motion is not None and job.is_stale:
            return Reason.STOPPED
        if job.urgency is FEED and not self.connected:
            return Reason.UNPLUGGED
        if job.internal:
            return Reason.OFFLINE if job.backs_off and self._units[job.address].reach.offline else NO_REASON
        feeding, moves = self._feeding, job.moves
        if feeding.armed and job.request.writes and self._disrupts(job):
            return Reason.DISRUPTIVE
        if feeding.slack < _FOREVER and self._takes(job) > feeding.slack:
            return Reason.TOO_LONG
        if moves and self.closing:
            return Reason.CLOSED
        if moves and self.latched:
            return Reason.LATCHED
        if moves and not self.connected:
            return Reason.UNPLUGGED
        if job.is_broadcast:
            return self._refusal_of_broadcast(job) if moves else NO_REASON
        unit = self._by_address[job.address]
        if unit.reach.offline:
            return Reason.OFFLINE
        if unit.is_stops_only:
            return Reason.EMERGENCY if self.latched else Reason.STOPPED
        if not moves:
            return NO_REASON
        return Reason.LOCKED if unit.locked else Reason.UNCONFIRMED if _is_unconfirmed(unit) else NO_REASON

    def _refusal_of_broadcast(self, job: Job) -> Reason:
        """The same, for a broadcast that could move something."""
        hearing = self.hearing(job)
        if any(unit.locked for unit in hearing):
            return Reason.LOCKED
        return Reason.UNCONFIRMED if any(map(_is_unconfirmed, hearing)) else Reason.NONE

    def needs_port(self, job: Job) -> bool:
        """Whether it is not worth waiting for a port that was lost: a motion, or the arming of a watchdog."""
        return (job.moves and not job.internal) or job.urgency is Urgency.FEED

    def hearing(self, job: Job) -> list[UnitState]:
        """The attached devices that would act on it."""
        if not job.is_broadcast:
            unit = self._units[job.address]
            return [] if unit.attached is None else [unit]
        return [unit for unit in self._units if unit.hears(job.request)]

    def _disrupts(self, job: Job) -> bool:
        return any(unit.disrupts(job.request) for unit in self.hearing(job))

    def _takes(self, job: Job) -> float:
        """How long it may take the wire."""
        if job.is_broadcast:
            return self._line.budget(len(job.request.adu), self._turnaround, 0) + self._pair.silence
        unit = self._units[job.address]
        timeout = unit.reply_timeout if job.reply_timeout is None else job.reply_timeout
        pause = unit.pause if job.pause is None else job.pause
        length = job.request.length or MAX_FRAME
        waits = timeout + self._pair.latency
        return pause + self._line.budget(len(job.request.adu), waits, length) + self._pair.silence

    def longest_wait(self, request: Request) -> float:
        """How long the answer to a request may be waited for, in seconds, lest an armed watchdog trips."""
        pair = self._pair
        budget = pair.line.budget(len(request.adu), pair.latency, request.length or MAX_FRAME)
        return self._feeding.slack - budget - pair.silence

    def check_wait(self, unit: UnitState, reply_timeout: float, pause: float) -> None:
        """Refuse to wait longer for a device than the armed watchdogs allow: it is asked unbidden, to feed it, say.

        Raises:
            WatchdogInfeasible: with the numbers.
        """
        if unit.attached is None:
            return  # a request of somebody's own that would take too long is not sent
        allowed = min(self.longest_wait(request) for request in unit.reads())
        if reply_timeout + pause > allowed:
            raise WatchdogInfeasible(
                f"Unit {unit.address} cannot be waited for {1000 * (reply_timeout + pause):.0f} ms (reply_timeout and "
                f"pause) while a watchdog on the bus is armed that allows {1000 * allowed:.0f} ms. Leave the watchdog "
                "block first, or use a longer watchdog.",
                {"needed": reply_timeout + pause, "available": allowed},
            )
        watch = self._feeding.get(unit.address)
        longer = reply_timeout + pause - unit.reply_timeout - unit.pause
        if watch is None or longer <= 0:
            return
        changed = replace(watch, attempt=watch.attempt + longer, occupies=watch.occupies + longer)
        others = [other for other in self._feeding.with_planned().values() if other.address != unit.address]
        reckoning = add_up([changed, *others], self._feeding.turnaround)
        if not reckoning.fits:
            raise WatchdogInfeasible(
                f"Unit {unit.address} cannot be waited for {1000 * longer:.0f} ms longer: the watchdogs on the bus "
                f"could not be fed in time. {reckoning}. Leave the watchdog block first, or use a longer watchdog.",
                reckoning.numbers,
            )

    def wait(self, job: Job, now: float) -> float:
        """Until when a job that may be sent must wait; READY if it need not."""
        if job.not_before > now:
            return job.not_before
        if self._feeding.armed and (until := self._wait_for_feeds(job, now)) > now:
            return until
        if job.urgency is STOP and job.request.writes:
            # It waits for nothing but a watchdog that must not be fed.
            silent_until = self._units[job.address].silent_until
            return silent_until if silent_until > now else READY
        if job.is_broadcast:
            if job.moves and any(unit.halt for unit in self.hearing(job)):
                return _FOREVER
            return self._may_be_hit_until(None, job, now) if self.silent else READY
        unit = self._by_address[job.address]
        if job.moves and unit.halt is not None:
            return _FOREVER
        if unit.silent_until > now:
            return unit.silent_until
        if self._echo.verdict is None and self.waits_for_verdict(job):
            return _FOREVER
        if unit.late.owed and not (job.ignores_late_replies or (job.weighed >= 0 and not unit.late.in_order)):
            unit.expire(now)
            if (until := unit.late.must_wait(job.request, job)) > now:
                self.held_up.add(unit)
                job.held_up_since = job.held_up_since or now
                return until
        if self.silent and not job.is_repeatable and (until := self._may_be_hit_until(unit, job, now)) > now:
            return until
        pause = unit.pause if job.pause is None else job.pause
        if pause and job.urgency > START:
            return self.pauses.wait(job, pause, now)
        return READY

    def gives_up_at(self, job: Job) -> float:
        """Until when a job may be held up by what its unit owes: it may go on to leave unanswered what others ask, and
        would keep it waiting without end. A read of a plain unit that leaves questions unanswered waits no longer than
        it takes to miss it; where that has happened already, no longer than for its own answer."""
        if not job.held_up_since or job.internal or job.setpoint or job.slot is not None:
            return _FOREVER
        unit = self._units[job.address]
        if job.expires_at is None and not job.request.writes and unit.leaves_questions:
            if unit.reach.gave_up:
                return job.held_up_since + unit.reply_times.expected(job)[1]
            return job.held_up_since + unit.waits(job, self._retries) * unit.reply_timeout
        return max(job.held_up_since, job.sent_at) + max(_HELD_UP, 3 * unit.late_reply_window)

    def waits_for_verdict(self, job: Job) -> bool:
        """Whether a job has to wait until it is known that the adapter does not echo, or has been tried for long."""
        told = job.request.writes and job.expects_reply and job.urgency is not Urgency.STOP
        return told and self._echo.keeps_waiting(job.address)

    def _may_be_hit_until(self, unit: UnitState | None, job: Job, now: float) -> float:
        """Until when the late reply of another unit could hit a job that must not be repeated."""
        if job.urgency is Urgency.STOP:
            return READY
        self.silent = {silent: until for silent, until in self.silent.items() if until > now}
        return max((until for silent, until in self.silent.items() if silent is not unit), default=READY)

    def hindrance(self, job: Job, now: float) -> Reason:
        """Why a job that may be sent has not been by now."""
        if self.wait(job, now) <= now:
            return Reason.EXPIRED  # others had the wire
        if self._echo.is_open and self.waits_for_verdict(job):
            return Reason.ECHO
        unit = self._units[job.address]
        if any(hearing.halt for hearing in self.hearing(job)) or unit.silent_until > now:
            return Reason.STOPPING
        return Reason.OWED if unit.late else Reason.EXPIRED

    def _wait_for_feeds(self, job: Job, now: float) -> float:
        """Until when it must wait lest an armed watchdog trips; forever, where what comes first is a feed."""
        feeding = self._feeding
        if job.urgency in _STOPPING and self.is_rationed(job, now):
            if self.ration.free_at > now:
                return self.ration.free_at
            return READY if feeding.spares(self._takes(job), now) else _FOREVER
        if job.urgency is Urgency.STOP:
            # A stop waits for no feed, unless stops in vain have taken their share, and something would trip.
            pressed = self.ration.free_at > now and feeding.guards_others(job.address)
        else:
            pressed = feeding.pressed
        return _FOREVER if pressed and not feeding.affords(self._takes(job), now) else READY

    def is_rationed(self, job: Job, now: float) -> bool:
        """Whether it is meant to stop a device that does not answer, while others are guarded."""
        if job.is_broadcast or not self._feeding.guards_others(job.address):
            return False
        unit = self._units[job.address]
        return unit.halt is not None and unit.is_silent(now)


def _is_unconfirmed(unit: UnitState) -> bool:
    """Whether it was told to stop, and could not be seen standing."""
    return unit.halt is not None and unit.halt.failed
