"""Tells the silence of a drive that starts anew from what a line loses. Pure."""

from __future__ import annotations

_LONG, _FOR = 3, 0.25
"""Requests in a row that must have been left unanswered, at least, and seconds that must have passed since the first:
one may be waited for no longer than a drive usually takes."""
_UNLIKELY = 1e-3
"""How often the line may lose as many in a row."""
_LEAST = 0.01
"""The share that any line is taken to lose."""
_MEMORY = 0.99
"""By how much what was before counts less after every request."""
_FEW, _USUAL = 5.0, 0.05
"""What is taken for known of a line in the beginning: of so many requests this share was lost."""


class Silence:
    """What one drive has answered of late, and what not.

    What the line loses is judged by single losses: a long silence is the drive's, and no evidence of the line.
    """

    __slots__ = ("_answered", "_in_vain", "_lost", "_since")

    def __init__(self) -> None:
        self._in_vain = 0
        """Requests in a row that it has not answered."""
        self._since = 0.0
        """When the first of them was sent."""
        self._answered, self._lost = _FEW * (1 - _USUAL), _FEW * _USUAL

    def missed(self, sent_at: float) -> None:
        """It has not answered in its time what was sent then."""
        self._since = self._since if self._in_vain else sent_at
        self._in_vain += 1

    def answered(self, now: float) -> bool:
        """It answers; whether it was silent before, longer than the line explains."""
        in_vain, self._in_vain = self._in_vain, 0
        share = max(_LEAST, self._lost / (self._lost + self._answered))
        self._answered, self._lost = _MEMORY * self._answered + 1, _MEMORY * self._lost
        if in_vain < _LONG:
            self._lost += in_vain
        return in_vain >= _LONG and now > self._since + _FOR and share**in_vain <= _UNLIKELY
