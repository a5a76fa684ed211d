"""Streams share the wire with others."""

from __future__ import annotations

from rs485bus.bus.bus import Bus
from rs485bus.bus.schedule.job import Job, Urgency

_LATE, _YIELDS = 0.9, 0.4
"""How old a set-point may be, in transactions, that waits for two more, or for one and what somebody else asks. So none
is older than three when it is on the wire."""


class Haste:
    """Whether a set-point that takes several frames may wait for others. Pure."""

    def __init__(self) -> None:
        self.takes = 0.0
        """Seconds that the first of some frames took last, with its answer, and the silence after it."""
        self.frames = 1
        """Frames that a set-point takes."""
        self.apart = 0.0
        """Seconds between the last two set-points."""

    @property
    def every(self) -> float:
        """Seconds from one set-point to the next on a wire that is full, with a look between them."""
        return (self.frames + 1) * self.takes

    def is_late(self, wanted_at: float, now: float) -> bool:
        """Whether one would be too old after two other frames, unless a newer one should have come until then."""
        age = now - wanted_at
        return age > _LATE * self.takes or age < self.apart - 2 * self.takes

    def yields_until(self, wanted_at: float) -> float:
        """Until when it lets somebody else go first whose turn it is."""
        return wanted_at + _YIELDS * self.takes


class Turns:
    """Whose turn it is, where streams share a bus with others: after a set-point somebody else may go first."""

    def __init__(self) -> None:
        self.last: Job | None = None
        """The set-point that was sent last."""

    def urgency(self, bus: Bus, frames: int) -> Urgency:
        """How urgent the next set-point is, of so many frames. One of several lets somebody go first after the last of
        them, and waits for others only that are set-points as well."""
        flight, queue, last = bus.owner.journal.flight, bus.owner.queue, self.last
        mine = bool(flight) and last is not None and flight[-1].sent_at == last.sent_at
        if frames > 1:
            others = any(job.setpoint for job in queue.heads(Urgency.COMMAND))
        else:
            others = queue.has(Urgency.COMMAND) or queue.has(Urgency.POLL)
        return Urgency.COMMAND if mine and others else Urgency.CONFIRM
