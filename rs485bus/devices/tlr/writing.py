"""How a TL-R drive is written to: what is written is read back, and what starts something rises. Pure.

Source: TL-R manual, 3.1.3, 3.5.3, 4.3.
"""

from __future__ import annotations

import logging
from typing import Any

from rs485bus.devices.tlr.frames import auxiliary, control, read, words, write
from rs485bus.devices.tlr.values import Auxiliary, ControlWord
from rs485bus.errors import DeviceRefused, NoReply, OutcomeUnknown, RequestFailed
from rs485bus.motion.plan import Ask, Plan
from rs485bus.wire.frames import payload
from rs485bus.wire.registers import Block, Register, Repeat

_log = logging.getLogger("rs485bus")
_ATTEMPTS = 3
"""How often a block is written that is not answered."""
_TRUNCATED_FROM = 5
"""Registers in one write of which some firmware keeps only the first ones."""


class TlrWriter:
    """Plans that write to one drive.

    Args:
        name: names the drive in messages.
        address: its address.
        clear_trigger: write 0 before a trigger, so that its bits rise.
        block_writes: write what belongs together in one request. Where the drive turns out to keep only a part of it,
            the rest is written singly, from then on all of it.
    """

    def __init__(self, name: str, address: int, *, clear_trigger: bool, block_writes: bool) -> None:
        self.name = name
        self.address = address
        self.clear_trigger = clear_trigger
        self.block_writes = block_writes

    def clear_control(self) -> Plan[None]:
        """Have the bits of a trigger rise."""
        if self.clear_trigger:
            yield Ask(control(self.address, ControlWord.NONE))

    def auxiliary(self, command: Auxiliary, repeat: Repeat = Repeat.SAFE) -> Plan[None]:
        """Have it carry out an auxiliary command (3.5.3)."""
        if self.clear_trigger:
            yield Ask(auxiliary(self.address, Auxiliary.NONE))
        yield Ask(auxiliary(self.address, command), repeat=repeat)

    def put(self, what: Register[Any] | Block, *values: Any, repeat: Repeat = Repeat.SAFE) -> Plan[None]:
        """Write a register, or the values of a block, and read them back; by `Repeat.VERIFY`, before a write that was
        not answered is repeated, too.

        Raises:
            LimitExceeded: a value is out of its range; nothing was sent.
            DeviceRefused: the drive does not take it, or reads back something else.
            NoReply: it did not answer.
        """
        wanted = words(what.encode(*values))
        there: tuple[int, ...] | None = None
        if self.block_writes or len(wanted) == 1:
            unknown: RequestFailed | None = None
            for _ in range(_ATTEMPTS if repeat is Repeat.VERIFY else 1):
                before, unknown = unknown, None
                try:
                    yield Ask(write(self.address, what.address, wanted), repeat=repeat)
                except (NoReply, OutcomeUnknown) as error:
                    if len(wanted) < _TRUNCATED_FROM:
                        raise
                    # Firmware that keeps less may say so in its answer, which then is none to this request.
                    unknown = error
                except DeviceRefused:
                    if before is not None:
                        raise before from None  # what was refused may have been done already
                    raise
                there = words(payload((yield Ask(read(self.address, what)))))
                if unknown is None or there == wanted:
                    break
            if there != wanted and len(wanted) >= _TRUNCATED_FROM:
                self.block_writes = False
                _log.info("%s keeps only a part of a block; it is written singly", self.name)
        if there != wanted and len(wanted) > 1:
            for at, word in enumerate(wanted):
                if there is None or there[at] != word:
                    yield Ask(write(self.address, what.address + at, (word,)))
            there = words(payload((yield Ask(read(self.address, what)))))
        if there != wanted:
            raise DeviceRefused(
                f"{self.name} acknowledged {what.name} and reads back {there} instead of {wanted}.",
                address=self.address,
            )
