"""Who may go onto the wire: asked when a job is submitted, and again immediately before each transmission. Pure."""

from __future__ import annotations

from rs485bus.bus.feeding import Feeding
from rs485bus.bus.job import Job, Reason, Urgency
from rs485bus.bus.queue import READY
from rs485bus.bus.station import Station, Stations
from rs485bus.wire.frames import MAX_FRAME
from rs485bus.wire.timing import LineSettings

_FOREVER = float("inf")


class Gate:
    """The state of the bus, as far as it keeps jobs off the wire."""

    __slots__ = ("_feeding", "_line", "_stations", "closed", "connected", "latched", "settled")

    def __init__(self, line: LineSettings, stations: Stations, feeding: Feeding) -> None:
        self._line = line
        self._stations = stations
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
        if self._feeding.slack < _FOREVER and self._takes(job) > self._feeding.slack:
            return Reason.TOO_LONG
        if job.moves and self.latched:
            return Reason.LATCHED
        if job.moves and not self.connected:
            return Reason.UNPLUGGED
        if job.is_broadcast:
            return Reason.LOCKED if job.moves and any(station.locked for station in self._hearing(job)) else Reason.NONE
        station = self._stations[job.address]
        if station.reach.offline:
            return Reason.OFFLINE
        if station.muzzled:
            return Reason.EMERGENCY if self.latched else Reason.STOPPED
        return Reason.LOCKED if job.moves and station.locked else Reason.NONE

    def _hearing(self, job: Job) -> list[Station]:
        """The known devices that would act on a broadcast."""
        return [
            station
            for station in self._stations
            if station.attached is not None and station.attached.hears(job.request)
        ]

    def _takes(self, job: Job) -> float:
        if job.is_broadcast:
            return 0.0  # the turnaround is part of what was admitted
        timeout = self._stations[job.address].reply_timeout if job.reply_timeout is None else job.reply_timeout
        return self._line.budget(len(job.request.adu), timeout, job.request.length or MAX_FRAME)

    def wait(self, job: Job, now: float) -> float:
        """Until when a job that may be sent must wait; READY if it need not."""
        if not self.settled and job.request.writes and job.urgency is not Urgency.STOP:
            return _FOREVER
        if job.is_broadcast:
            return _FOREVER if job.moves and any(station.halt for station in self._hearing(job)) else READY
        station = self._stations[job.address]
        if job.moves and station.halt is not None:
            return _FOREVER
        if station.silent_until > now:
            return station.silent_until
        if station.late and not job.tolerant:
            station.late.expire(now)
            return station.late.must_wait(job.request, job)
        return READY
