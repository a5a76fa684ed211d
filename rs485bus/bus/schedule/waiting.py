"""How long a job may wait for the wire, and what is said of one whose time is over. Pure.

Nothing waits without end: not for silence on a line that is never quiet, and not for a port that stays away.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from rs485bus.bus.line.serial_line import OTHERS_WAIT, SerialLine
from rs485bus.bus.schedule.admission import AdmissionControl
from rs485bus.bus.schedule.job import Job, Reason, Urgency
from rs485bus.bus.schedule.queue import Queue

_log = logging.getLogger("rs485bus")

PORT_WAITS = 30.0
"""Seconds for which a job without a time limit waits for a port that is away."""
_LOOK_EVERY = 0.01
"""Seconds after which it is looked again whose time is over: there may be many."""
_FOREVER = float("inf")

Drop = Callable[[Job, Reason], None]


class Waiting:
    """The jobs that wait for one pair.

    Args:
        pair: the pair.
        queue: those jobs.
        gate: who may go onto the pair.
        drop: ends a job that was taken out of the queue.
    """

    __slots__ = ("_answers", "_away_since", "_drop", "_gate", "_look_at", "_pair", "_queue", "_said_since")

    def __init__(self, pair: SerialLine, queue: Queue, gate: AdmissionControl, drop: Drop) -> None:
        self._pair = pair
        self._queue = queue
        self._gate = gate
        self._drop = drop
        self._away_since = 0.0
        self._answers = -1
        self._look_at = 0.0
        self._said_since = _FOREVER
        """Since when there was the noise that the log was told of."""

    def expire(self, job: Job, now: float) -> bool:
        """The job's time is over. False if it does not wait here."""
        if not self._queue.remove(job):
            return False
        self._drop(job, self._hindrance(job, now))
        return True

    def _hindrance(self, job: Job, now: float) -> Reason:
        """Why a job has not been sent by now."""
        if not self._gate.connected:
            return Reason.UNPLUGGED
        if self._pair.has_noise(now) and job.urgency is not Urgency.STOP:
            return Reason.LINE_BUSY
        return self._gate.hindrance(job, now)

    def for_silence(self, now: float) -> float:
        """There is noise: end the jobs that have waited for silence long enough. Returns when to look again.

        Stops go out over noise: they are not ended.
        """
        look_at = max(self._pair.noisy_since + OTHERS_WAIT, self._look_at)
        if now < look_at:
            return look_at
        self._say(now)
        self._look_at = self._end_those(self._pair.noisy_since, OTHERS_WAIT, Reason.LINE_BUSY, now)
        return self._look_at

    def port_lost(self, now: float, answers: int) -> float:
        """The port is away. Returns when to look whether anybody has waited too long for it.

        Args:
            now: the time.
            answers: how many it has carried. If none since it was lost before, it was hardly there meanwhile.
        """
        if self._answers != answers:
            self._answers, self._away_since = answers, now
        return self._away_since + PORT_WAITS

    def for_port(self, now: float) -> float:
        """End the jobs that have waited for the port long enough. Returns when to look again; 0 if it is there."""
        if self._gate.connected:
            return 0.0
        return self._end_those(self._away_since, PORT_WAITS, Reason.UNPLUGGED, now)

    def _end_those(self, since: float, seconds: float, reason: Reason, now: float) -> float:
        """End the jobs that have waited for so many seconds, at the longest since then. Returns when to look again."""
        look_at = now + seconds
        for job in list(self._queue):
            if reason is Reason.UNPLUGGED:
                # The bus' own stops go out first when the port is there again.
                waits_on = job.expires_at is not None or (job.internal and job.urgency is Urgency.STOP)
            else:
                waits_on = job.urgency is Urgency.STOP
            if waits_on:
                continue
            over = max(job.queued_at, since) + seconds
            if over > now:
                look_at = min(look_at, over)
            elif self._queue.remove(job):
                self._drop(job, reason)
        return max(look_at, now + _LOOK_EVERY)

    def _say(self, now: float) -> None:
        if self._said_since != self._pair.noisy_since:
            self._said_since = self._pair.noisy_since
            _log.warning(
                "the line has not been quiet for %.1f s: nothing but stops goes out. Look for %s",
                now - self._pair.noisy_since,
                WHAT_TO_LOOK_FOR,
            )


WHAT_TO_LOOK_FOR = (
    "a second master on the pair, noise from a motor's cable, missing bias or termination resistors, wires A and B the "
    "wrong way round, and a device that talks at another baud rate"
)
