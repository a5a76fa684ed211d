"""Streams share the wire with others."""

from __future__ import annotations

from rs485bus.bus.bus import Bus
from rs485bus.bus.schedule.job import Job, Urgency


class Turns:
    """Whose turn it is, where streams share a bus with others: after a set-point somebody else may go first."""

    def __init__(self) -> None:
        self.last: Job | None = None
        """The set-point that was sent last."""

    def urgency(self, bus: Bus) -> Urgency:
        """How urgent the next set-point is."""
        flight, queue, last = bus.owner.journal.flight, bus.owner.queue, self.last
        mine = bool(flight) and last is not None and flight[-1].sent_at == last.sent_at
        others = queue.has(Urgency.COMMAND) or queue.has(Urgency.POLL)
        return Urgency.COMMAND if mine and others else Urgency.CONFIRM
