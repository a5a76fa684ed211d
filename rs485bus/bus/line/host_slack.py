"""How much later than usual this computer may hand a reply over. Pure.

It is late when it does other things, or when an adapter collects bytes: whatever unit answers. A reply that is given up
too soon is hit by the next frame. So on a line that loses next to nothing it is waited for long, which costs nothing;
where much is lost, as long as pays; and longer again where replies have come too late.
"""

from __future__ import annotations

_PAYS = 0.015
"""The share of lost replies from which on waiting costs more than a repetition for nothing now and then."""
_FORGETS = 1 / 64
"""The part of what is known of the line that counts no more after each attempt."""
_NOTHING = 1e-3
_GROWS = 2.0


class HostSlack:
    """Seconds for which a reply is waited for beyond the time that its unit usually takes.

    Args:
        longest: the most, in seconds. 0 where replies come in exact time.
    """

    __slots__ = ("_late", "_lost", "longest", "seconds")

    def __init__(self, longest: float = 0.0) -> None:
        self.longest = longest
        self.seconds = longest
        self._lost = 0.0
        """The share of replies that did not come, of late."""
        self._late = 0.0
        """What would have done for those that came too late."""

    def came_in_time(self) -> None:
        """An answer came while it was waited for."""
        if self._lost:
            self._lost = self._lost * (1 - _FORGETS) if self._lost > _NOTHING else 0.0
            self._late -= self._late * _FORGETS
            self._reckon()

    def missed(self) -> None:
        """No answer came while it was waited for."""
        self._lost += (1 - self._lost) * _FORGETS
        self._reckon()

    def came_late(self, later: float) -> None:
        """An answer came that was waited for no longer, so many seconds later than its unit usually takes at most."""
        if later <= self.longest:  # beyond that it was the unit
            self._late = min(self.longest, _GROWS * max(self.seconds, later))
            self._reckon()

    def _reckon(self) -> None:
        self.seconds = max(self._late, self.longest * min(1.0, _PAYS / self._lost) if self._lost else self.longest)
