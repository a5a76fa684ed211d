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
"""Seconds within which a unit that falls silent again counts as coming and going."""
SILENCE = 4
"""Attempts in a row without an answer from which on a unit has fallen silent. A bad line hardly ever does that."""


class ProbeBudget:
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


class Reachability:
    """Whether one unit answers."""

    __slots__ = ("_listened", "_misses", "_silent_at", "_streak", "offline", "probe_at")

    def __init__(self) -> None:
        self.offline = False
        self.probe_at = 0.0
        """Not to be looked for before."""
        self._misses = 0
        self._streak = 0
        self._listened = 0.0
        self._silent_at = float("-inf")

    @property
    def silent(self) -> bool:
        """Whether it has fallen silent. Nothing is repeated then: repetitions are for what a line loses."""
        return self._streak >= SILENCE

    @property
    def missed_in_a_row(self) -> int:
        """Attempts in a row that were not answered."""
        return self._streak

    def flaps(self, now: float) -> bool:
        """Whether it fell silent only just now."""
        return now - self._silent_at < FLAPPING

    def answered(self) -> bool:
        """The unit answered. True if it was offline until now."""
        back, self.offline = self.offline, False
        self._misses = self._streak = 0
        self._listened = 0.0
        return back

    def unanswered(self, now: float, listened: float, flapping: int) -> bool:
        """An attempt was not answered. True if the unit is offline from now on, since it comes and goes.

        Args:
            now: the time.
            listened: how many seconds were listened for it.
            flapping: how many units come and go.
        """
        self._streak += 1
        self._listened += listened
        if self._streak != SILENCE:
            return False
        flaps, self._silent_at = self.flaps(now), now
        if not flaps:
            return False
        self.offline = True
        self.probe_at = now + self._listened * max(1, flapping) / SHARE
        return True

    def missed(self, now: float, limit: int) -> bool:
        """A request ended without an answer. True if the unit is offline from now on, after `limit` in a row."""
        self._misses += 1
        if self.offline or self._misses < limit:
            return False
        self.offline = True
        self.probe_at = now
        return True
