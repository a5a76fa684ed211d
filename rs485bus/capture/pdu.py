"""What a request says, whatever the device: its function, where it begins, how much, which bytes. Pure.

Source: Modbus Application Protocol V1.1b3, chapter 6.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from rs485bus.wire.answers import (
    DIAGNOSTICS,
    ENCAPSULATED,
    EVENT_COUNTER,
    EVENT_LOG,
    EXCEPTION_STATUS,
    MASK_WRITE,
    READ_COILS,
    READ_DISCRETE,
    READ_FIFO,
    READ_FILE,
    READ_HOLDING,
    READ_INPUT,
    READ_WRITE,
    SERVER_ID,
    WRITE_COIL,
    WRITE_COILS,
    WRITE_FILE,
    WRITE_MULTIPLE,
    WRITE_SINGLE,
)
from rs485bus.wire.exceptions import exception

READS: Final = (READ_HOLDING, READ_INPUT)
_BIT_READS: Final = (READ_COILS, READ_DISCRETE)

_TARGETS: Final = {
    READ_COILS: ("read", "coil"),
    READ_DISCRETE: ("read", "discrete input"),
    READ_HOLDING: ("read", "holding register"),
    READ_INPUT: ("read", "input register"),
    WRITE_COIL: ("write", "coil"),
    WRITE_COILS: ("write", "coil"),
    WRITE_SINGLE: ("write", "register"),
    WRITE_MULTIPLE: ("write", "register"),
}
_NAMES: Final = {
    MASK_WRITE: "mask-write register",
    READ_WRITE: "read and write registers",
    READ_FIFO: "read queue",
    READ_FILE: "read file records",
    WRITE_FILE: "write file records",
    EXCEPTION_STATUS: "read exception status",
    DIAGNOSTICS: "diagnostics",
    EVENT_COUNTER: "read event counter",
    EVENT_LOG: "read event log",
    SERVER_ID: "report server id",
    ENCAPSULATED: "read identification",
}


@dataclass(frozen=True, slots=True)
class Spoken:
    """A request, taken apart. What does not apply is 0 or empty."""

    address: int
    function: int
    register: int
    count: int
    data: bytes
    """What it writes."""

    @property
    def verb(self) -> str:
        """ "read", "write", or "" where it is neither."""
        return _TARGETS.get(self.function, ("",))[0]

    @property
    def what(self) -> str:
        """It in words, by the specification alone."""
        target = _TARGETS.get(self.function)
        if target is None:
            return _NAMES.get(self.function, f"function {self.function}")
        verb, noun = target
        some = noun if self.count == 1 else f"{self.count} {noun}s"
        return f"{verb} {some} at 0x{self.register:02X}"


def spoken(adu: bytes) -> Spoken:
    """Take a request apart. Bytes that make no sense leave 0 and nothing."""
    address, function = adu[0], adu[1]
    register, number = int.from_bytes(adu[2:4], "big"), int.from_bytes(adu[4:6], "big")
    if function in (*READS, *_BIT_READS) and len(adu) == 8:
        return Spoken(address, function, register, number, b"")
    if function in (WRITE_SINGLE, WRITE_COIL) and len(adu) == 8:
        return Spoken(address, function, register, 1, adu[4:6])
    if function in (WRITE_MULTIPLE, WRITE_COILS) and len(adu) >= 9:
        return Spoken(address, function, register, number, adu[7:-2])
    return Spoken(address, function, 0, 0, b"")


def told(asked: Spoken, reply: bytes) -> bytes:
    """The data in a reply to a read of registers; empty for other replies."""
    return reply[3:-2] if asked.function in READS and len(reply) > 5 else b""


def bare(asked: Spoken, data: bytes) -> str:
    """Data of which no names are known, in words."""
    if not data:
        return ""
    if asked.function == WRITE_COIL:
        return "on" if data[0] else "off"
    if asked.function in (*READS, WRITE_SINGLE, WRITE_MULTIPLE) and len(data) == 2 * asked.count:
        return " ".join(str(int.from_bytes(data[at : at + 2], "big")) for at in range(0, len(data), 2))
    return data.hex(" ").upper()


def bits(asked: Spoken, reply: bytes) -> str:
    """The bits in a reply to a read of coils or inputs, the first one first."""
    if asked.function not in _BIT_READS:
        return ""
    number = int.from_bytes(reply[3:-2], "little")
    return "".join(str(number >> at & 1) for at in range(asked.count))


def refusal(asked: Spoken, reply: bytes) -> str:
    """Why a reply says no, in words; empty where it does not, as far as the specification tells."""
    if len(reply) == 5 and reply[1] & 0x80:
        return f"exception {reply[2]:02X}, {exception(reply[2]).name}"
    return ""
