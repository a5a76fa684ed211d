"""Who may go onto the wire: asked when a job is submitted, and again immediately before each transmission. Pure."""

from __future__ import annotations

from rs485bus.bus.schedule.job import Job, Reason, Urgency
from rs485bus.bus.schedule.queue import READY
from rs485bus.bus.units.unit_state import UnitState, UnitStates
from rs485bus.bus.watchdog.feeding import Feeding
from rs485bus.wire.frames import MAX_FRAME
from rs485bus.wire.timing import LineSettings

_FOREVER = float("inf")


class AdmissionControl:
    """The state of the bus, as far as it keeps jobs off the wire."""

    __slots__ = ("_feeding", "_line", "_units", "closed", "connected", "latched", "settled")

    def __init__(self, line: LineSettings, units: UnitStates, feeding: Feeding) -> None:
        self._line = line
        self._units = units
        self._feeding = feeding
        self.latched = False
        """An emergency stop was made; nothing moves until it is cleared."""
        self.closed = False
        self.connected = True
        self.settled = False
        """It is known whether the adapter echoes. Until then nothing is written."""

    def refusal(self, job: Job) -> Reason:
        """Why a job may be sent neither now nor later; NONE if it may."""
        if self.closed:
            return Reason.CLOSED
        if job.is_stale:
            return Reason.STOPPED
        if job.internal or job.urgency is Urgency.STOP:
            return Reason.NONE
        if self._feeding.armed and job.request.writes and self._disrupts(job):
            return Reason.DISRUPTIVE
        if self._feeding.slack < _FOREVER and self._takes(job) > self._feeding.slack:
            return Reason.TOO_LONG
        if job.moves and self.latched:
            return Reason.LATCHED
        if job.moves and not self.connected:
            return Reason.UNPLUGGED
        if job.is_broadcast:
            return Reason.LOCKED if job.moves and any(unit.locked for unit in self._hearing(job)) else Reason.NONE
        unit = self._units[job.address]
        if unit.reach.offline:
            return Reason.OFFLINE
        if unit.is_stops_only:
            return Reason.EMERGENCY if self.latched else Reason.STOPPED
        return Reason.LOCKED if job.moves and unit.locked else Reason.NONE

    def _hearing(self, job: Job) -> list[UnitState]:
        """The attached devices that would act on it."""
        if not job.is_broadcast:
            unit = self._units[job.address]
            return [] if unit.attached is None else [unit]
        return [unit for unit in self._units if unit.attached is not None and unit.attached.hears(job.request)]

    def _disrupts(self, job: Job) -> bool:
        return any(unit.attached is not None and unit.attached.disrupts(job.request) for unit in self._hearing(job))

    def _takes(self, job: Job) -> float:
        if job.is_broadcast:
            return 0.0  # the turnaround is part of what was admitted
        timeout = self._units[job.address].reply_timeout if job.reply_timeout is None else job.reply_timeout
        return self._line.budget(len(job.request.adu), timeout, job.request.length or MAX_FRAME)

    def wait(self, job: Job, now: float) -> float:
        """Until when a job that may be sent must wait; READY if it need not."""
        if job.not_before > now:
            return job.not_before
        if not self.settled and job.request.writes and job.urgency is not Urgency.STOP:
            return _FOREVER
        if job.is_broadcast:
            return _FOREVER if job.moves and any(unit.halt for unit in self._hearing(job)) else READY
        unit = self._units[job.address]
        if job.moves and unit.halt is not None:
            return _FOREVER
        if unit.silent_until > now:
            return unit.silent_until
        if unit.late and not job.ignores_late_replies:
            unit.late.expire(now)
            return unit.late.must_wait(job.request, job)
        return READY

    def hindrance(self, job: Job, now: float) -> Reason:
        """Why a job that may be sent has not been by now."""
        if self.wait(job, now) <= now:
            return Reason.EXPIRED  # others had the wire
        unit = self._units[job.address]
        if any(hearing.halt for hearing in self._hearing(job)) or unit.silent_until > now:
            return Reason.STOPPING
        return Reason.OWED if unit.late else Reason.EXPIRED
