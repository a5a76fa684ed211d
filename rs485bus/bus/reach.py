"""Which units answer, and how much time may be spent on looking for those that do not. Pure.

Listening to a unit that does not answer takes the wire from all others, so it is rationed. A unit that was lost is
looked for out of one account for all lost units, which fills slowly. A unit that comes and goes costs its last
requests each time it goes; that, too, is paid for with time in which it is not looked for.
"""

from __future__ import annotations

SHARE = 0.02
"""The part of all time that may be spent on looking for lost units; as much again on those that come and go."""
BURST = 0.25
"""Seconds that may be spent on looking at once."""
FLAPPING = 60.0
"""Seconds within which a unit that is lost again after it was found counts as coming and going."""


class Listening:
    """The account of the time spent on looking for lost units."""

    __slots__ = ("_at", "_level")

    def __init__(self) -> None:
        self._level = 0.0
        self._at = 0.0

    def spend(self, seconds: float, now: float) -> None:
        self._level = self._drained(now) + seconds
        self._at = now

    def free_at(self, now: float) -> float:
        """When there is something to spend again."""
        return now + max(0.0, self._drained(now) - BURST) / SHARE

    def _drained(self, now: float) -> float:
        return max(0.0, self._level - SHARE * (now - self._at))


class Reach:
    """Whether one unit answers."""

    __slots__ = ("_found_at", "_listened", "_score", "offline", "probe_at")

    def __init__(self) -> None:
        self.offline = False
        self.probe_at = 0.0
        """Not to be looked for before."""
        self._score = 0
        self._listened = 0.0
        self._found_at = float("-inf")

    def flaps(self, now: float) -> bool:
        """Whether it was found again only just now."""
        return now - self._found_at < FLAPPING

    def answered(self, now: float) -> bool:
        """The unit answered. True if it was offline until now."""
        self._listened = 0.0
        if self.offline:
            # One more request without an answer, and it is lost again.
            self.offline = False
            self._found_at = now
            return True
        self._score = max(0, self._score - 1)
        return False

    def unanswered(self, listened: float) -> None:
        """An attempt was not answered, for which was listened so many seconds."""
        self._listened += listened

    def missed(self, now: float, limit: int, flapping: int) -> bool:
        """A request ended without an answer. True if the unit is offline from now on.

        Args:
            now: the time.
            limit: how many requests in a row.
            flapping: how many units come and go.
        """
        self._score = min(limit, self._score + 1)
        if self.offline or self._score < limit:
            return False
        self.offline = True
        self._score = limit - 1
        self.probe_at = now + (self._listened * max(1, flapping) / SHARE if self.flaps(now) else 0.0)
        return True
