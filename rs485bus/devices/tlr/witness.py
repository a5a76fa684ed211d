"""Tells a drive that has restarted from one that has not. Pure.

The drive does not say that it restarted: it counts from zero again, whether its motor is enabled cannot be relied on,
and a position of zero proves nothing. But what was written to it and not saved is gone. So the registers of the next
target bear witness: as long as they hold what was written last, it is the same drive with the same zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence


class Witness:
    """What some registers were written to, and must still hold.

    Args:
        registers: their addresses.
    """

    def __init__(self, registers: range) -> None:
        self._registers = registers
        self._may_hold: list[set[int]] | None = None

    @property
    def speaks(self) -> bool:
        """Whether it is known what they must hold."""
        return self._may_hold is not None

    def sent(self, values: Mapping[int, int]) -> None:
        """A write of these registers goes out. Until they are read each one may hold the old or the new value."""
        if self._may_hold is not None:
            for held, register in zip(self._may_hold, self._registers, strict=True):
                held.update({values[register]} if register in values else ())

    def read(self, values: Sequence[int]) -> None:
        """They were read, and held these values."""
        self._may_hold = [{value} for value in values]

    def forget(self) -> None:
        """It is not known what they hold."""
        self._may_hold = None

    def denies(self, values: Sequence[int]) -> bool:
        """Whether they hold what nobody wrote to them."""
        if self._may_hold is None:
            return False
        return any(value not in held for held, value in zip(self._may_hold, values, strict=True))
