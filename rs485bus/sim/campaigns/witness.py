"""A unit that remembers what it was asked and what it did, so that what was said of it can be held against it."""

from __future__ import annotations

from collections.abc import Callable

from rs485bus.sim.device import ILLEGAL_ADDRESS, Refusal, SimDevice

FORBIDDEN = 0x4000
"""Registers from here on are refused."""
HIDDEN = 0x3000
"""Writes from here on are refused inside a normal reply, as MKS drives do."""
MEMORY = 0x2000
"""Registers from here on hold what was written; all others tell at every read which one it was."""

Told = Callable[[bytes, bool, float], None]
"""What a unit did: the request (function and data), whether it carried it out, and when."""


def overhear(drive: SimDevice, told: Told) -> None:
    """Have told what a drive does with each request; it says no inside a normal reply, as MKS drives do."""
    answer = drive.answer

    def overheard(pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        try:
            reply = answer(pdu, now, broadcast=broadcast)
        except Refusal:
            told(pdu, False, now)
            raise
        refused = reply is not None and reply[0] == 16 and reply[3:5] == bytes(2)
        told(pdu, reply is not None and not refused, now)
        return reply

    drive.answer = overheard  # type: ignore[method-assign] # it is listened to on its own


class Witness(SimDevice):
    """A unit that tells what it does.

    Args:
        address: 1..247.
        told: told of each request, when it is carried out or refused.
    """

    def __init__(self, address: int, told: Told) -> None:
        super().__init__(address)
        self.reads: dict[int, tuple[float, bytes]] = {}
        """When which request was answered, by the number that its answer holds."""
        self._told = told
        self._serial = 0
        self._memory: dict[int, int] = {}

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        register = int.from_bytes(pdu[1:3], "big")
        hidden = HIDDEN <= register < FORBIDDEN and pdu[0] in (6, 16)
        self._told(pdu, register < FORBIDDEN and not hidden, now)
        if register >= FORBIDDEN:
            raise Refusal(ILLEGAL_ADDRESS)
        if hidden:
            return pdu[:3] + (b"\xff\xff" if pdu[0] == 6 else b"\0\0")
        if pdu[0] in (3, 4):
            return self._read(pdu, register, now)
        data = pdu[3:5] if pdu[0] == 6 else pdu[6:]
        for at in range(0, len(data), 2):
            self._memory[register + at // 2] = int.from_bytes(data[at : at + 2], "big")
        return pdu if pdu[0] == 6 else pdu[:5]

    def _read(self, pdu: bytes, register: int, now: float) -> bytes:
        count = int.from_bytes(pdu[3:5], "big")
        if register >= MEMORY:
            words = [self._memory.get(register + at, 0) for at in range(count)]
            return bytes((pdu[0], 2 * count)) + b"".join(word.to_bytes(2, "big") for word in words)
        self._serial = (self._serial + 1) % 0x1_0000_0000
        self.reads[self._serial] = (now, pdu)
        self.reads.pop(self._serial - 500, None)
        return bytes((pdu[0], 2 * count)) + (self._serial.to_bytes(4, "big") + bytes(2 * count))[: 2 * count]
