"""Typed requests to one TL-R drive over its bus: what is written is read back. Source: TL-R manual, 4."""

from __future__ import annotations

import logging
from typing import Any, TypeVar

from rs485bus.bus.bus import Bus
from rs485bus.bus.failure import what_was_done
from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.tlr.adapter import FAMILY, TlrAttached
from rs485bus.devices.tlr.frames import auxiliary, control, words, write
from rs485bus.devices.tlr.values import Auxiliary, ControlWord, ExceptionCode
from rs485bus.errors import DeviceRefused, NoReply
from rs485bus.wire.frames import Request, payload, read_holding
from rs485bus.wire.registers import Block, Register, Repeat

T = TypeVar("T")

_log = logging.getLogger("rs485bus")
_TRUNCATED_FROM = 5
"""Registers in one write of which some firmware keeps only the first ones."""
_REFUSALS = {
    ExceptionCode.ILLEGAL_DATA: "illegal data: the value is outside what this parameter can be",
    ExceptionCode.EXECUTION_DENIED: "execution denied: it does not do that now. Look at its status for an alarm, an "
    "input that holds it, or a motion under way",
}


class Link:
    """One drive, as it is talked to.

    Args:
        bus: the bus it is on.
        attached: the drive, as the bus knows it.
        clear_trigger: write 0 before a trigger, so that its bits rise.
        block_writes: write what belongs together in one request. Where the drive turns out to keep only a part of it,
            the rest is written singly, from then on all of it.
    """

    def __init__(self, bus: Bus, attached: TlrAttached, *, clear_trigger: bool, block_writes: bool) -> None:
        self.clear_trigger = clear_trigger
        self.block_writes = block_writes
        self._bus = bus
        self._attached = attached
        self._address = attached.address

    async def read(self, register: Register[T], urgency: Urgency = Urgency.COMMAND) -> T:
        """Read one value."""
        return register.decode(await self._read(register.address, register.count, urgency))

    async def read_block(self, block: Block, urgency: Urgency = Urgency.COMMAND) -> tuple[Any, ...]:
        """Read the values of a block."""
        return block.decode(await self._read(block.address, block.count, urgency))

    async def read_words(self, block: Block, urgency: Urgency = Urgency.COMMAND) -> tuple[int, ...]:
        """Read the registers of a block as they are."""
        return words(await self._read(block.address, block.count, urgency))

    async def put(self, what: Register[Any] | Block, *values: Any) -> None:
        """Write a register, or the values of a block, and read them back.

        Raises:
            LimitExceeded: a value is out of its range; nothing was sent.
            DeviceRefused: the drive does not take it, or reads back something else.
            NoReply: it did not answer.
        """
        wanted, there = words(what.encode(*values)), None
        first = what.address
        if self.block_writes or len(wanted) == 1:
            try:
                await self._ask(write(self._address, first, wanted))
            except NoReply:
                if len(wanted) < _TRUNCATED_FROM:
                    raise
                # Firmware that keeps less may say so in its answer, which then is none to this request.
            there = words(await self._read(first, len(wanted), Urgency.COMMAND))
            if there != wanted and len(wanted) >= _TRUNCATED_FROM:
                self.block_writes = False
                _log.info("%s %d keeps only a part of a block; it is written singly", FAMILY, self._address)
        if there != wanted and len(wanted) > 1:
            for at, word in enumerate(wanted):
                if there is None or there[at] != word:
                    await self._ask(write(self._address, first + at, (word,)))
            there = words(await self._read(first, len(wanted), Urgency.COMMAND))
        if there != wanted:
            raise DeviceRefused(
                f"{FAMILY} {self._address} acknowledged {what.name} and reads back {there} instead of {wanted}.",
                address=self._address,
            )

    async def control(self, word: ControlWord, repeat: Repeat = Repeat.SAFE, slot: BurstSlot | None = None) -> None:
        """Write the control word, at once or when it is its turn. A stop drops it while it waits."""
        attached = self._attached
        await self._ask(control(self._address, word), repeat=repeat, moves=True, slot=slot)
        attached.word = word

    async def auxiliary(self, command: Auxiliary, repeat: Repeat = Repeat.SAFE) -> None:
        """Have the drive carry out an auxiliary command."""
        if self.clear_trigger:
            await self._ask(auxiliary(self._address, Auxiliary.NONE))
        await self._ask(auxiliary(self._address, command), repeat=repeat)

    async def write(self, register: Register[T], value: T) -> None:
        """Write one register once, without reading it back: it changes how the drive is talked to."""
        await self._ask(write(self._address, register.address, words(register.encode(value))), repeat=Repeat.NEVER)

    async def _read(self, register: int, count: int, urgency: Urgency) -> bytes:
        return payload(await self._ask(read_holding(self._address, register, count), urgency=urgency))

    async def _ask(
        self,
        request: Request,
        *,
        urgency: Urgency = Urgency.COMMAND,
        repeat: Repeat = Repeat.SAFE,
        moves: bool = False,
        slot: BurstSlot | None = None,
    ) -> bytes:
        motion = self._attached.motion if moves else None
        try:
            return await self._bus.ask(request, urgency=urgency, repeat=repeat, moves=moves, motion=motion, slot=slot)
        except DeviceRefused as refused:
            known = next((code for code in _REFUSALS if code == refused.code), None)
            if known is None:
                raise
            raise DeviceRefused(
                f"{FAMILY} {self._address} refuses, {_REFUSALS[known]} (exception {known:02}): {request}. "
                f"{what_was_done(request, known)}",
                code=known,
                address=refused.address,
                request=refused.request,
                attempts=refused.attempts,
            ) from refused
