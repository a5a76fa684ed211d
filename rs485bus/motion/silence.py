"""Tells the silence of a drive that starts anew from what a line loses. Pure."""

from __future__ import annotations

_LONG = 3
"""Requests in a row that must have been left unanswered, at least."""
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

    __slots__ = ("_answered", "_in_vain", "_lost")

    def __init__(self) -> None:
        self._in_vain = 0
        """Requests in a row that it has not answered."""
        self._answered, self._lost = _FEW * (1 - _USUAL), _FEW * _USUAL

    def missed(self) -> None:
        """It has not answered in its time."""
        self._in_vain += 1

    def answered(self) -> bool:
        """It answers; whether it was silent before, longer than the line explains."""
        in_vain, self._in_vain = self._in_vain, 0
        share = max(_LEAST, self._lost / (self._lost + self._answered))
        self._answered, self._lost = _MEMORY * self._answered + 1, _MEMORY * self._lost
        if in_vain < _LONG:
            self._lost += in_vain
        return in_vain >= _LONG and share**in_vain <= _UNLIKELY
