"""Tells a drive that has restarted from one that has not. Pure.

The drive does not say that it restarted: it counts from zero again, whether its motor is enabled cannot be relied on,
and a position of zero proves nothing. But what was written to it and not saved is gone. So the registers of the next
target bear witness: as long as they hold what was written last, it is the same drive with the same zero.
"""

from __future__ import annotations

from collections.abc import Sequence


class Witness:
    """What some registers were written to, and must still hold."""

    def __init__(self) -> None:
        self._may_hold: list[set[int]] | None = None

    @property
    def speaks(self) -> bool:
        """Whether it is known what they must hold."""
        return self._may_hold is not None

    def writing(self, values: Sequence[int]) -> None:
        """These values are written. Until that is confirmed each register may hold the old or the new one."""
        if self._may_hold is not None:
            self._may_hold = [held | {value} for held, value in zip(self._may_hold, values, strict=True)]

    def written(self, values: Sequence[int]) -> None:
        """They hold these values."""
        self._may_hold = [{value} for value in values]

    def forget(self) -> None:
        """It is not known what they hold."""
        self._may_hold = None

    def denies(self, values: Sequence[int]) -> bool:
        """Whether they hold what nobody wrote to them."""
        if self._may_hold is None:
            return False
        return any(value not in held for held, value in zip(self._may_hold, values, strict=True))
