"""How much of what is asked a line loses, and for how long a unit may be silent on it. Pure.

Only attempts that stand between two answers of a unit are counted: those were lost by the line, for the unit was there.
"""

from __future__ import annotations

import math

LEAST = 0.01
"""The loss that is assumed of the best line."""
UNLIKELY = 1e-9
"""A silence less likely than this, for the loss that the line shows, is no silence of a unit that is there."""
_MEMORY = 100.0
"""Attempts after which an older one counts a third."""
_USUAL = 0.05
"""The loss that is assumed of a line of which nothing is known."""
_FEW = 5.0
"""Attempts that what is assumed counts for, so that the first losses are believed."""


class Loss:
    """How much of what one unit is asked is lost."""

    __slots__ = ("_answered", "_lost", "answers")

    def __init__(self) -> None:
        self.answers = 0
        """Attempts answered since the latest that was lost. Whoever hears the unit counts them here."""
        self._answered = 0.0
        self._lost = 0.0

    def between_answers(self, lost: int) -> None:
        """So many attempts were lost, and then one was answered."""
        faded = math.exp(-(self.answers + lost) / _MEMORY)
        self._answered = self._answered * faded + self.answers
        self._lost = self._lost * faded + lost
        self.answers = 0

    @property
    def counts(self) -> tuple[float, float]:
        """How many were lost and answered of late."""
        faded = math.exp(-self.answers / _MEMORY)
        return self._lost * faded, self._answered * faded + self.answers


def share_lost(lost: float, answered: float, usual: float = _USUAL) -> float:
    """The share that is lost, where so many were and so many were not. `usual` is the share that is likely anyway."""
    return max(LEAST, (lost + _FEW * usual) / (lost + answered + _FEW))


def longest_silence(loss: float) -> int:
    """How many attempts in a row may be lost, by chance, of a unit that is there."""
    return math.floor(math.log(UNLIKELY) / math.log(loss))
