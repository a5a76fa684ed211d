"""Tells from what a drive reports whether an axis stands. Pure.

A status alone has been seen to lie, both ways. So an axis stands when its position stays for so long that the slowest
speed would have shown, and its status says so too. Where the status goes on saying that it moves, the position must
stay for longer.
"""

from __future__ import annotations

from dataclasses import dataclass

NEVER = float("-inf")


@dataclass(frozen=True, slots=True, kw_only=True)
class StandstillRule:
    """How an axis of a drive is seen to stand. Times are seconds."""

    same: int = 2
    """Counts by which the position of a standing axis may change."""
    apart: float
    """How far two equal positions must be apart where the status says that the axis stands."""
    contradicted: float
    """The same where the status does not say so."""
    still_rpm: float = float("inf")
    """The speed up to which a standing axis may seem to turn; infinity where the reported speed says nothing."""
    wraps: int = 0
    """The counter begins again after so many counts; 0 if it never does."""

    def shows_after(self, acceleration: float) -> float:
        """Seconds after its start at which an axis no longer seems to stand that gets faster by so many counts/s²."""
        return (self.same + 1) / self.contradicted / acceleration if self.contradicted else 0.0

    def moved(self, before: int, after: int) -> int:
        """The counts from one position to another."""
        counts = after - before
        return (counts + self.wraps // 2) % self.wraps - self.wraps // 2 if self.wraps else counts


class Standstill:
    """What was reported of one axis since the last frame that could set it in motion.

    Args:
        rule: how it is seen to stand.
    """

    __slots__ = ("_fast_at", "_moved_at", "_moved_from", "_position", "_running", "rule", "since", "until")

    def __init__(self, rule: StandstillRule) -> None:
        self.rule = rule
        self.forget()

    def forget(self) -> None:
        """What was reported so far proves nothing any more."""
        self._position: int | None = None
        self.since = NEVER
        """From when on the position has not changed."""
        self.until = NEVER
        """When the position was last asked for."""
        self._moved_at = self._moved_from = NEVER
        self._running: bool | None = None
        self._fast_at = NEVER

    def see(
        self,
        at: float,
        position: int | None = None,
        running: bool | None = None,
        rpm: float | None = None,
        by: float = NEVER,
    ) -> None:
        """Take in what was asked at a time or later: where the axis is, what its status says, how fast it turns.

        `by` is the latest time at which it can have been so: what was asked again may be that much younger.
        """
        if running is not None:
            self._running = running
        if rpm is not None:
            self._fast_at = at if abs(rpm) > self.rule.still_rpm else NEVER
        if position is None:
            return
        if self._position is None:
            self._position, self.since = position, max(at, by)
        elif abs(self.rule.moved(self._position, position)) > self.rule.same:
            self._moved_at, self._moved_from, self.since = at, self.until, max(at, by)
            self._position = position
            self._running = None  # a status that said that it stands has lied
        self.until = at

    @property
    def position(self) -> int | None:
        """Where it is, as long as it has not moved from there."""
        return self._position

    @property
    def unmoved(self) -> float:
        """For how many seconds the position is known not to have changed."""
        return max(0.0, self.until - self.since) if self._position is not None else 0.0

    def is_in_doubt(self, longest: float) -> bool:
        """Whether it cannot be told yet, or was seen to move only by two positions further apart than that: it may have
        stood since."""
        if self.verdict is None:
            return True
        return self._moved_at == self.until and self._moved_at - self._moved_from > longest

    @property
    def has_moved(self) -> bool:
        """Whether two positions have shown that it moves, or did."""
        return self._moved_at != NEVER

    @property
    def says_so(self) -> bool:
        """Whether the status says that the axis stands, and the position does not show that it lies."""
        return self._running is False

    @property
    def confirmed(self) -> bool:
        """Whether the status says that the axis stands, and the position has not changed since it did."""
        return self._running is False and self._position is not None

    @property
    def verdict(self) -> bool | None:
        """True: it stands. False: it moves. None: that cannot be told yet."""
        if self._position is None:
            return None
        if self._fast_at > self.since:
            return False  # the speed that was reported with its last change of position is no later news
        if self.unmoved >= (self.rule.apart if self.confirmed else self.rule.contradicted):
            return True
        return False if self._moved_at == self.until else None
