"""What came of the looks at one drive: whether it answers, and tells what it is asked. Pure."""

from __future__ import annotations

import math

from rs485bus.bus.units.loss import share_lost
from rs485bus.motion.look_budget import SHARE
from rs485bus.motion.standstill import NEVER

_LOOKS = 4
"""How many looks must have been in vain then, at least, however long the drive may take for one."""
_UNLIKELY = math.log(1e-6)
"""How unlikely it must be that the line has lost them all."""
_PAUSE = 0.05
"""The longest pause, in seconds, before a drive is asked again that does not tell what it is asked."""


class LookOutcomes:
    """What came of the looks at one drive."""

    __slots__ = ("_misses", "_untold", "not_before")

    def __init__(self) -> None:
        self.not_before = NEVER
        """When it is looked at again, at the soonest."""
        self._misses = 0
        """Looks that were not answered since one was."""
        self._untold = 0
        """Looks for where an axis is that did not tell it, answered or not, since any look did."""

    def answered(self, at: float, took: float, *, told: bool, telling: bool, where: bool) -> None:
        """A look was answered in so many seconds.

        Args:
            at: when.
            took: how long that took.
            told: the answer told what the look was for.
            telling: the look was for where an axis is.
            where: the answer told that, whatever the look was for.
        """
        self._misses = 0
        self._untold = 0 if where else self._untold + telling
        if not told:
            self._pause(at, took)

    def missed(self, at: float, took: float, *, telling: bool) -> None:
        """It was not answered in so many seconds. `telling`: it was for where an axis is."""
        self._misses += 1
        self._untold += telling
        # The first repetition goes at once; later ones leave the wire to others.
        self._pause(at, 0.0 if self._misses == 1 else took)

    def in_vain(self, counts: tuple[float, float]) -> tuple[bool, bool]:
        """Whether too many looks in a row were not answered; and whether too many did not tell where an axis is, of a
        drive that answers. `counts`: how many answers the line has lost, and how many came."""
        if self._misses < _LOOKS and self._untold < _LOOKS:
            return False, False
        looks = max(_LOOKS, math.ceil(_UNLIKELY / math.log(share_lost(*counts))))
        return self._misses >= looks, self._untold >= looks and not self._misses

    def _pause(self, at: float, took: float) -> None:
        self.not_before = at + min(took * (1 / SHARE - 1), _PAUSE)
