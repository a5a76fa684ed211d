"""Tells the silence of a drive that starts anew from what a line loses. Pure."""

from __future__ import annotations

_LONG, _FOR = 3, 0.25
"""Requests in a row that must have been left unanswered, at least, and seconds that must have passed since the first:
one may be waited for no longer than a drive usually takes."""
_UNLIKELY = 1e-3
"""How often the line may lose as many in a row."""
_LEAST = 0.01
"""The share that any line is taken to lose."""
_MANY = 64
"""Of more that are not answered no more is known than of so many."""
_MEMORY = 0.99
"""By how much what was before counts less after every request."""
_FEW, _USUAL = 5.0, 0.05
"""What is taken for known of a line in the beginning: of so many requests this share was lost."""


class Silence:
    """What one drive has answered of late, and what not.

    What the line loses is judged by single losses: a long silence is the drive's, and no evidence of the line.
    """

    __slots__ = ("_all", "_answered", "_is_calm", "_last", "_late", "_lost", "_misses", "_was_silent")

    def __init__(self) -> None:
        self._misses: list[float] = []
        """When that was sent what it has not answered since it last did; the first ones, where there are many."""
        self._last: list[float] = []
        """The same of its last silence."""
        self._was_silent = False
        """It was silent since it last answered in time, and has answered late since."""
        self._all: list[float] = []
        """When that was sent what it has not answered in time since it last answered all that it was asked."""
        self._late = 0
        """How much of that it has answered late."""
        self._is_calm = True
        """It was not heard late since it last answered in time."""
        self._answered, self._lost = _FEW * (1 - _USUAL), _FEW * _USUAL

    @property
    def has_missed(self) -> bool:
        """Whether it has left anything unanswered since it last answered."""
        return bool(self._misses)

    def missed(self, sent_at: float) -> None:
        """It has not answered in its time what was sent then."""
        if len(self._misses) < _MANY:
            self._misses.append(sent_at)
        if len(self._all) < _MANY:
            self._all.append(sent_at)

    def came_late(self, sent_at: float) -> bool:
        """It answers late what was sent then at the latest: it has not started anew since. Nor has it since what is
        answered first by as many late replies, in the order in which it was sent. Whether it was silent before that in
        its last silence."""
        self._late, self._is_calm = self._late + 1, False
        first = max(0, len(self._all) + 1 - self._late)  # one may be on its way that is not missed yet
        if first < len(self._all) < _MANY:
            sent_at = min(sent_at, self._all[first])
        self._take(self._misses, sent_at)
        self._misses = []
        return self._is_silence(self._last, sent_at)

    def answered(self, now: float) -> bool:
        """It answers; whether it was silent before, longer than the line explains."""
        misses = self._misses
        if misses:
            self._take(misses, now)
        elif self._is_calm:
            self._all.clear()
            self._late = 0
        self._is_calm = True
        self._answered, self._lost = _MEMORY * self._answered + 1, _MEMORY * self._lost
        if misses:
            self._misses = []
            if len(misses) < _LONG:
                self._lost += len(misses)
        was_silent, self._was_silent = self._was_silent, False
        return was_silent

    def _take(self, misses: list[float], end: float) -> None:
        """What it has not answered was not answered until then."""
        if self._is_silence(misses, end):
            self._was_silent, self._last = True, misses

    def _is_silence(self, misses: list[float], end: float) -> bool:
        """Whether that is longer than the line explains, by what was sent before its end."""
        misses = [sent_at for sent_at in misses if sent_at < end]
        if len(misses) < _LONG or end <= misses[0] + _FOR:
            return False
        share = max(_LEAST, self._lost / (self._lost + self._answered))
        return bool(share ** len(misses) <= _UNLIKELY)
