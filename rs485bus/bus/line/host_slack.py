"""How much later than usual this computer may hand a reply over, learned from replies that it gave up too soon. Pure.

It is late when it does other things, or when an adapter collects bytes: whatever unit answers.
"""

from __future__ import annotations

_FORGETS = 1 / 32
"""The part of it that is forgotten with each answer that came in its time."""
_GROWS = 2.0


class HostSlack:
    """Seconds for which a reply is waited for beyond the time that its unit usually takes.

    Args:
        longest: the most, in seconds, and what is waited for as long as nothing else is known. 0 where replies come in
            exact time.
    """

    __slots__ = ("longest", "seconds")

    def __init__(self, longest: float = 0.0) -> None:
        self.longest = longest
        self.seconds = longest

    def came_in_time(self) -> None:
        """An answer came while it was waited for."""
        self.seconds -= _FORGETS * self.seconds

    def came_late(self, later: float) -> None:
        """An answer came that was waited for no longer, so many seconds later than its unit usually takes at most."""
        if later <= self.longest:  # beyond that it was the unit
            self.seconds = min(self.longest, _GROWS * max(self.seconds, later))
