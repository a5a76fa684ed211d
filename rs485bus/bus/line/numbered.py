"""Replies that tell for certain which request they answer: nothing is owed, and nothing waits. Pure."""

from __future__ import annotations

from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.schedule.job import Job


class NumberedReplies(PendingReplies):
    """What a device owes that speaks Modbus TCP itself: nothing that could be mistaken for anything."""

    __slots__ = ()

    def unanswered(self, job: Job, until: float, *, accepted: bool = False) -> None:
        """A reply to it may still arrive, under its own number."""

    def answered(self, job: Job, until: float, frame: bytes = b"") -> float:
        """The job was answered. Returns when the oldest request was sent that this reply may answer, or earlier."""
        return job.queued_at if job.unanswered else job.sent_at
