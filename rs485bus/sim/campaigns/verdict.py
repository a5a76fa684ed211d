"""What became of each request, held against what the units did. Pure.

A request's own frames are told apart by their order on the wire: two equal writes are two requests.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from rs485bus.bus.schedule.job import Job, Outcome, Urgency
from rs485bus.sim.campaigns.witness import MEMORY
from rs485bus.wire.frames import registers
from rs485bus.wire.registers import Repeat

SLACK = 0.15
"""Seconds that the attempt on the wire may go on after the time of its request is over."""
LONGEST = 60.0
"""Seconds within which a request without a time of its own must have ended."""

Reads = Callable[[int, int], tuple[float, bytes]]
"""When a unit gave the answer with a number, and to which request."""


@dataclass
class Verdict:
    """What a campaign found. `wrong`, `early_frames` and `stuck` must be empty."""

    requests: int
    outcomes: Counter[str] = field(default_factory=Counter)
    events: Counter[str] = field(default_factory=Counter)
    """What happened besides: stops, emergency stops, unpluggings."""
    wrong: list[str] = field(default_factory=list)
    stuck: int = 0
    early_frames: int = 0
    late_replies: int = 0
    seconds: float = 0.0
    memory: list[int] = field(default_factory=list)
    """The most memory the process has used until each tenth, in kilobytes; empty where the system does not tell."""

    def __str__(self) -> str:
        ended = ", ".join(f"{name} {count}" for name, count in sorted(self.outcomes.items()))
        events = ", ".join(f"{count} {name}" for name, count in sorted(self.events.items()))
        grown = f", memory {self.memory[1]} -> {self.memory[-1]} kB" if len(self.memory) > 1 else ""
        lines = [f"{self.requests} requests in {self.seconds:.0f} s of virtual time{grown}", ended]
        if events:
            lines.append(events)
        lines.append(
            f"{len(self.wrong)} wrong answers, {self.early_frames} frames before t3.5, {self.stuck} stuck jobs, "
            f"{self.late_replies} late replies"
        )
        return "\n".join(lines)

    @property
    def is_good(self) -> bool:
        """Nothing was found."""
        return not (self.wrong or self.stuck or self.early_frames)

    def add(self, other: Verdict) -> None:
        """Put another campaign's findings to these."""
        self.requests += other.requests
        self.outcomes += other.outcomes
        self.events += other.events
        self.wrong += other.wrong
        self.stuck += other.stuck
        self.early_frames += other.early_frames
        self.late_replies += other.late_replies
        self.seconds += other.seconds


@dataclass(eq=False, slots=True)
class Fate:
    """A request, its frames on the wire, and what the unit did with them."""

    job: Job
    asked_at: float
    sent: int = 0
    done: int = 0
    refused: int = 0
    ends: int = 0
    ended_at: float = 0.0
    cancelled_at: float = float("inf")

    def fault(self, reads: Reads) -> str:
        """What is wrong with how it ended; nothing if it is right."""
        job, outcome = self.job, self.job.outcome
        limit = self.asked_at + LONGEST if job.expires_at is None else job.expires_at + SLACK
        if self.ends > 1:
            return "ended twice"
        if self.ended_at > limit:
            return f"ended {self.ended_at - limit:.3f} s too late"
        if job.is_broadcast:
            if outcome is Outcome.NOT_SENT and self.sent:
                return "a broadcast said not to be sent that was"
            return "a broadcast said to be sent that was not" if outcome is Outcome.REPLY and not self.sent else ""
        if outcome is Outcome.REFUSED and not self.refused:
            return "a refusal that the unit never gave"
        if not job.request.writes:
            return self._fault_of_read(reads)
        if outcome is Outcome.REPLY and not self.done:
            return "a write reported done that was not"
        if outcome in (Outcome.REFUSED, Outcome.NOT_SENT) and self.done:
            return "a write reported not done that was"
        if outcome is Outcome.NO_REPLY and job.repeat is Repeat.NEVER and self.done:
            return "a write that may be repeated safely, it says, and that was done"
        if job.repeat is Repeat.NEVER and self.sent > 1:
            return "a write sent too often"
        return ""

    def _fault_of_read(self, reads: Reads) -> str:
        job = self.job
        if job.outcome is not Outcome.REPLY or job.request.register >= MEMORY:
            return ""
        high, low = registers(job.reply)[:2]
        answered, asked = reads(job.address, high << 16 | low)
        if asked != job.request.adu[1:-2] or answered < self.asked_at:
            return "the answer to another request"
        return ""

    def may_still_go(self, now: float, stopped_at: float) -> str:
        """What is wrong with its being sent now; nothing if it may be.

        Args:
            now: the time.
            stopped_at: when what it moves was stopped last.
        """
        if self.ends:
            return "sent after its end"
        if self.cancelled_at < now and self.job.urgency is not Urgency.STOP:
            return "sent after it was cancelled"
        if self.job.moves and self.asked_at < stopped_at:
            return "older than a stop, and sent after it"
        return ""
