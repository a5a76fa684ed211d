"""Writes that may be sent again once a read-back has told that they did not happen. Pure.

Such a write is one job, with one epoch and one time, from its first attempt to its last read-back: whatever keeps the
write off the wire keeps its read-backs off, too. It is carried out at least once, or its own outcome is told.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rs485bus.wire.frames import HIGHEST_ADDRESS, Request, read_holding, registers

_log = logging.getLogger("rs485bus")


@dataclass(frozen=True, slots=True)
class Verification:
    """How to see whether a write was carried out.

    Args:
        read: a read without side effects.
        matches: given the frame that answers it, whether the device holds what was written.
    """

    read: Request
    matches: Callable[[bytes], bool]

    def shows(self, reply: bytes) -> bool:
        """Whether the reply shows that the write was carried out."""
        try:
            return self.matches(reply)
        except Exception:
            _log.exception("the comparison of a read-back failed; it counts as not carried out")
            return False


def holds(address: int, register: int, values: Sequence[int]) -> Verification:
    """Holding registers read back as they were written, from `register` on."""
    wanted = list(values)
    read = read_holding(address, register, len(wanted), HIGHEST_ADDRESS)
    return Verification(read, lambda reply: registers(reply) == wanted)
