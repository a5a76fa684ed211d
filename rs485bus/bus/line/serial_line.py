"""The pair of wires as the owner sees it: whose turn it is, how long there was silence, what is out. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.line.transaction import Received, Transaction
from rs485bus.bus.record import Record
from rs485bus.bus.schedule.job import Job
from rs485bus.wire.frames import MAX_FRAME
from rs485bus.wire.timing import LineSettings

CUT_AFTER = 0.01
"""Seconds of silence after which a stop does not wait for a reply any longer."""


class SerialLine:
    """Silence, airtime and the one job that is out.

    The silence counts from the last byte received or from the end of the airtime of what was sent, whichever is
    later: a write call returning says nothing about the wire.

    Args:
        line: how characters travel.
        silence: seconds that must stand between two frames.
        echo: whether the adapter returns what is sent; None to find out.
        now: the time.
    """

    __slots__ = (
        "_air_end",
        "_first_byte_at",
        "_heard_at",
        "airtime",
        "deadline",
        "exchange",
        "job",
        "line",
        "quiet_at",
        "silence",
    )

    def __init__(self, line: LineSettings, silence: float, echo: bool | None, now: float) -> None:
        self.line = line
        self.silence = silence
        self.exchange = Transaction(echo)
        self.job: Job | None = None
        """The job that is out and may still be answered."""
        self.deadline = 0.0
        """When its reply budget is over."""
        self.airtime = 0.0
        """Seconds in which bytes were on the pair."""
        self.quiet_at = now + silence
        """When the next frame may start."""
        self._air_end = now
        self._heard_at = now
        self._first_byte_at: float | None = None

    def begin(self, job: Job, start: float, reply_timeout: float, late: Iterable[PendingReplies]) -> None:
        """The job's frame goes out at `start`."""
        request = job.request
        air = self.line.airtime(len(request.adu))
        self.airtime += air
        self._air_end = start + air
        self.quiet_at = self._air_end + self.silence
        self._first_byte_at = None
        self.exchange.begin(request, late)
        if job.expects_reply:
            self.job = job
            self.deadline = start + self.line.budget(len(request.adu), reply_timeout, request.length or MAX_FRAME)

    def feed(self, data: bytes, now: float) -> list[Received]:
        """Bytes were received; return the frames they complete."""
        self.airtime += self.line.airtime(len(data))
        self._heard_at = now
        self.quiet_at = max(self._air_end, now) + self.silence
        if self._first_byte_at is None:
            self._first_byte_at = now
        return self.exchange.feed(data)

    def wait_until(self, stop_waits: bool) -> float:
        """Until when the job that is out may still be answered. A stop waits for no more than a silence."""
        if not stop_waits:
            return self.deadline
        return min(self.deadline, max(self._air_end, self._heard_at) + CUT_AFTER)

    def end(self, late: Iterable[PendingReplies]) -> None:
        """The job that was out was answered or given up."""
        self.job = None
        self.exchange.idle(late)

    def restart(self, now: float) -> None:
        """The port was opened anew."""
        self._air_end = now
        self.quiet_at = now + self.silence

    def record(self, job: Job, reply: bytes, outcome: str, now: float) -> tuple[Record, int]:
        """What this attempt of the job was, and how many CRC errors came with it."""
        skipped, crc_errors = self.exchange.counts()
        record = Record(
            job.address,
            job.urgency,
            job.attempts,
            job.request.adu,
            reply,
            skipped,
            job.queued_at,
            job.sent_at,
            self._first_byte_at,
            now,
            outcome,
        )
        return record, crc_errors
