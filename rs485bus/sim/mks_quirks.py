"""What users have seen MKS drives do beside their manual, each an option of the virtual drive."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import Status
from rs485bus.sim.mks_memory import Refused
from rs485bus.sim.mks_shaft import MksShaft


@dataclass(frozen=True, slots=True, kw_only=True)
class Quirks:
    """Of one drive."""

    lying: Status | None = None
    """What 0xF1 says while the motor turns; None for the truth."""
    undefined_every: int = 0
    """Every so manieth read of 0xF1 is answered by a value that the manual does not name; 0 for none."""
    refuses_every: int = 0
    """Every so manieth write is refused, and nothing is done; 0 for none."""
    lag: float = 0.0
    """Seconds before the shaft stands in which 0xF1 says already that it does."""


PLAIN = Quirks()
_UNDEFINED = b"\x00\x09"
"""A status of 9."""


class Manners:
    """A drive with its quirks.

    Args:
        quirks: its own.
        stuck: what 0xF1 goes on saying after a move; None for the truth.
    """

    def __init__(self, quirks: Quirks, stuck: Status | None) -> None:
        self.quirks = quirks
        self._stuck = stuck
        self._statuses = self._writes = 0

    def status(self, motion: MksShaft, now: float) -> Status:
        """What it says of its motor."""
        if self.quirks.lying is not None and motion.motor.moving(now):
            return self.quirks.lying
        status = motion.status(now + self.quirks.lag)
        is_stuck = motion.has_moved and status is Status.STOPPED
        return self._stuck if is_stuck and self._stuck is not None else status

    def answered(self, register: int, data: bytes) -> bytes:
        """What it answers to the read of a register."""
        if register != r.STATUS.address:
            return data
        self._statuses += 1
        return _UNDEFINED if _is_turn(self.quirks.undefined_every, self._statuses) else data

    def refuse(self) -> None:
        """It is written to. Raises `Refused` where it says no."""
        self._writes += 1
        if _is_turn(self.quirks.refuses_every, self._writes):
            raise Refused


def _is_turn(every: int, count: int) -> bool:
    return every > 0 and count % every == 0
