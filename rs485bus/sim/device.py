"""What hangs on a virtual line: something with an address that is asked and answers. Pure: time is an argument."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TypeVar

from rs485bus.wire.frames import BROADCAST, crc

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
KEPT = 5_000
"""How many of its latest requests a device remembers, at least: it may run for days."""
_T = TypeVar("_T")


def remember(history: list[_T], latest: _T) -> None:
    """Add to a history, and forget what is older than the latest `KEPT`, now and then."""
    if len(history) >= 2 * KEPT:
        del history[:-KEPT]
    history.append(latest)


class Refusal(Exception):
    """A device says no, with a Modbus exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class SimDevice(ABC):
    """A device on a virtual line.

    Args:
        address: 1..247.

    Raises:
        ValueError: the address is out of range.
    """

    turnaround: float | None = None
    """Seconds before it starts to answer; None for what the line is set to."""
    silence: float | None = None
    """Seconds of silence that it needs before a frame; None for t3.5."""
    baudrate: int | None = None
    """What it is set to; None for whatever the line is."""

    def __init__(self, address: int) -> None:
        if not 1 <= address <= 247:
            raise ValueError(f"address {address} is outside 1..247")
        self.address = address

    def rate(self, now: float) -> int | None:
        """The baud rate at which it listens and answers now."""
        return self.baudrate

    def heeds(self, frame: bytes) -> bool:
        """Whether a frame means anything to it. Others need not be looked at: that is most of them on a full pair."""
        return True

    @abstractmethod
    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        """Do what a request says (function and data, without address and CRC); return the answer's, if it answers.

        Raises:
            Refusal: with an exception code.
        """

    def receive(self, frame: bytes, now: float) -> bytes | None:
        """Take a whole frame in; return the frame that answers it, if one does."""
        if len(frame) < 4 or frame[0] not in (self.address, BROADCAST) or crc(frame[:-2]) != frame[-2:]:
            return None
        broadcast = frame[0] == BROADCAST
        address = self.address
        try:
            reply = self.answer(frame[1:-2], now, broadcast=broadcast)
        except Refusal as refusal:
            reply = bytes((frame[1] | 0x80, refusal.code))
        if broadcast or reply is None:
            return None
        body = bytes([address]) + reply
        return body + crc(body)


class SimUnit(SimDevice):
    """A plain Modbus device: a bank of registers that functions 03, 04, 06 and 16 reach.

    Args:
        address: 1..247.
        registers: their values; any other address is refused with exception 02.
    """

    def __init__(self, address: int, registers: dict[int, int]) -> None:
        super().__init__(address)
        self.registers = dict(registers)
        self.writes: list[tuple[float, int, tuple[int, ...]]] = []
        """The latest writes it took: when, first register, values."""

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        function, register = pdu[0], int.from_bytes(pdu[1:3], "big")
        if function in (3, 4) and len(pdu) == 5:
            return self._read(function, register, int.from_bytes(pdu[3:5], "big"), now)
        if function == 6 and len(pdu) == 5:
            self.write(register, (int.from_bytes(pdu[3:5], "big"),), now)
            return pdu
        if function == 16 and len(pdu) >= 6:
            count = int.from_bytes(pdu[3:5], "big")
            if not 1 <= count <= 123 or pdu[5] != 2 * count or len(pdu) != 6 + pdu[5]:
                raise Refusal(ILLEGAL_VALUE)
            values = tuple(int.from_bytes(pdu[at : at + 2], "big") for at in range(6, len(pdu), 2))
            self.write(register, values, now)
            return pdu[:5]
        raise Refusal(ILLEGAL_FUNCTION)

    def _read(self, function: int, register: int, count: int, now: float) -> bytes:
        if not 1 <= count <= 125:
            raise Refusal(ILLEGAL_VALUE)
        values = self.read(register, count, now)
        return bytes((function, 2 * count)) + b"".join(value.to_bytes(2, "big") for value in values)

    def read(self, register: int, count: int, now: float) -> list[int]:
        """The registers asked for. Raises `Refusal` where there is none."""
        try:
            return [self.registers[address] for address in range(register, register + count)]
        except KeyError:
            raise Refusal(ILLEGAL_ADDRESS) from None

    def write(self, register: int, values: tuple[int, ...], now: float) -> None:
        """Take a write. Raises `Refusal` where there is no such register."""
        if any(address not in self.registers for address in range(register, register + len(values))):
            raise Refusal(ILLEGAL_ADDRESS)
        remember(self.writes, (now, register, values))
        for offset, value in enumerate(values):
            self.registers[register + offset] = value
