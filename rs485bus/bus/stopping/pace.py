"""What a halt asks about its pace. Pure."""

from __future__ import annotations

from typing import Protocol

from rs485bus.bus.line.pending import PendingReplies


class Pacing(Protocol):
    """How often a device is stopped, and for how long an answer is waited for."""

    late: PendingReplies

    def reply_timeout(self, since: float, reported: bool) -> float | None:
        """Seconds for which an answer is waited for; None for as long as usual. It was told to stop at `since`, and it
        was `reported`, or not, that it could not be seen standing."""

    @property
    def heard_at(self) -> float:
        """When it was heard last."""

    def is_noisy(self, now: float) -> bool:
        """Whether the pair is: what is not acknowledged there was not heard, and every gap counts."""

    def was_noisy_since(self, at: float) -> bool:
        """Whether noise was in the way of a frame that was sent at a time, or came after it."""

    def is_cut_short(self, now: float, since: float) -> bool:
        """Whether an answer may come later than it is waited for, or not be heard for noise.

        Three stops prove nothing then.
        """

    def is_crowded(self, now: float) -> bool:
        """Whether so many devices are being stopped, or others can hardly be fed, that a status must do where a stop
        was acknowledged."""

    @property
    def gives_up_after(self) -> float:
        """Seconds for which it is stopped then before it is said that this was in vain."""

    @property
    def looks_wait(self) -> float:
        """Seconds for which a look may wait for the stops of others before that is said."""

    def at_the_latest(self, sent_at: float) -> float:
        """When it is stopped again, after it was said that it could not be seen standing, though it acknowledged the
        last stop: infinity if there is no need to."""

    def next_at(self, now: float, sent_at: float, acknowledged: bool) -> float:
        """When it is stopped again, after it was said that it could not be seen standing. The last stop was sent at
        `sent_at`; it has `acknowledged` that and moves on, or not."""
