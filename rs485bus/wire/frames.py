"""Requests, and what their replies must look like.

The bytes come from pymodbus' PDU classes and its CRC. What a standard master cannot say, and MKS drives need, is a
parameter here: a payload that is not two bytes a register (`write_bytes`), and a refusal inside a normal reply
(`refusal=`).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

from pymodbus.framer import FramerRTU
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from rs485bus.arguments import whole

BROADCAST = 0
MAX_ADDRESS = 247
MAX_FRAME = 256
"""The longest frame on the pair, address and CRC included (Modbus over Serial Line V1.02, 2.5.1)."""
EXCEPTION_LENGTH = 5
MAX_READ, MAX_WRITE = 125, 123
"""How many registers one frame can read or write."""

READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT = 1, 2, 3, 4
WRITE_COIL, WRITE_SINGLE, WRITE_COILS, WRITE_MULTIPLE, MASK_WRITE, READ_WRITE = 5, 6, 15, 16, 22, 23
_READS = frozenset({READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT, 7, 11, 12, 17, 20, 24, 43})

Sizer = Callable[[bytes], int]
"""Tells the length of a reply from its first bytes; 0 while that cannot be told yet."""


def crc(data: bytes) -> bytes:
    """The CRC of `data` in the order of the wire."""
    return FramerRTU.compute_CRC(data).to_bytes(2, "big")


@dataclass(frozen=True, slots=True)
class Request:
    """One frame to send, and which frames may answer it.

    A normal reply starts with `prefix` and is `length` bytes long in all; `length` 0 means that nobody answers
    (a broadcast) or, with a `sizer`, that only the reply itself tells. `refusal` is how the same device says no
    inside a normal reply, if it does. `writes` is False for frames that change nothing in the device.
    """

    address: int
    function: int
    adu: bytes
    prefix: bytes
    length: int
    writes: bool
    refusal: bytes | None = None
    sizer: Sizer | None = None

    def __str__(self) -> str:
        to = "everyone" if self.address == BROADCAST else f"unit {self.address}"
        return f"function {self.function} to {to} ({self.adu.hex(' ').upper()})"

    @property
    def register(self) -> int:
        """The first register named, for functions that name one."""
        return int.from_bytes(self.adu[2:4], "big")

    def may_answer(self, other: Request) -> bool:
        """Whether a reply to this request could be taken for the normal reply to `other`."""
        return _alike(self.prefix, other.prefix) or (self.refusal is not None and _alike(self.refusal, other.prefix))

    def may_refuse(self, other: Request) -> bool:
        """Whether a reply to this request could be taken for a refusal of `other` inside a normal reply."""
        if other.refusal is None:
            return False
        return _alike(self.prefix, other.refusal) or (self.refusal is not None and _alike(self.refusal, other.refusal))


def _alike(a: bytes, b: bytes) -> bool:
    return a.startswith(b) or b.startswith(a)


def payload(reply: bytes) -> bytes:
    """The data bytes of a reply to a register read (functions 3 and 4)."""
    return reply[3:-2]


def registers(reply: bytes) -> list[int]:
    """The registers in a reply to a register read (functions 3 and 4)."""
    return list(struct.unpack_from(f">{reply[2] // 2}H", reply, 3))


def unit_address(address: int, *, highest: int = MAX_ADDRESS) -> int:
    """The address of one unit, 1..247 or less. 0 is everyone's."""
    return whole("address", address, 1, highest)


# By type as well: what was checked of 1 says nothing of True, nor of 1.0.
@lru_cache(maxsize=1024, typed=True)
def read_holding(address: int, register: int, count: int) -> Request:
    """Read `count` (1..125) holding registers, function 03."""
    return _read(ReadHoldingRegistersRequest, address, register, count)


@lru_cache(maxsize=1024, typed=True)
def read_input(address: int, register: int, count: int) -> Request:
    """Read `count` (1..125) input registers, function 04."""
    return _read(ReadInputRegistersRequest, address, register, count)


def write_single(address: int, register: int, value: int, *, hidden_refusal: bool = False) -> Request:
    """Write one register, function 06.

    Args:
        address: 1..247, or 0 for everyone.
        register: 0..65535.
        value: 0..65535.
        hidden_refusal: the device says no by echoing 0xFFFF as the value (MKS RTU V1.0.9, 2.4).
    """
    address = _any_address(address)
    register, _ = _window(register, 1, 1)
    adu = _encode(address, WriteSingleRegisterRequest(address=register, registers=[_value(value)]))
    refusal = adu[:4] + b"\xff\xff" if hidden_refusal else None
    return _write(address, WRITE_SINGLE, adu, adu[:6], refusal)


def write_multiple(address: int, register: int, values: Sequence[int], *, hidden_refusal: bool = False) -> Request:
    """Write 1..123 registers, function 16. Arguments as for `write_single`."""
    try:
        count = len(values)
    except TypeError:
        raise TypeError(f"values must be a sequence of register values, [1, 2] say, not {values!r}") from None
    if not 1 <= count <= MAX_WRITE:
        raise ValueError(f"{count} registers in one write; 1..{MAX_WRITE} fit a frame")
    register, _ = _window(register, count, MAX_WRITE)
    pdu = WriteMultipleRegistersRequest(address=register, registers=[_value(value) for value in values])
    return _write_block(address, pdu, hidden_refusal)


def write_bytes(address: int, register: int, count: int, data: bytes, *, hidden_refusal: bool = False) -> Request:
    """Write `data` as `count` registers, function 16, also where the bytes are not twice the registers.

    MKS' homing parameters are three registers in five bytes (MKS RTU V1.0.9, 5.3.2).
    """
    if not 1 <= len(data) <= 246:
        raise ValueError(f"{len(data)} data bytes in one write; 1..246 fit a frame")
    return _write_block(address, _WriteBytes(*_window(register, count, MAX_WRITE), data), hidden_refusal)


def from_pdu(address: int, pdu: ModbusPDU, reply: type[ModbusPDU]) -> Request:
    """Any request of pymodbus, answered by PDUs of the class `reply`."""
    address = _any_address(address)
    adu = _encode(address, pdu)
    function = pdu.function_code
    prefix, length = adu[:2], int(reply.rtu_frame_size)
    if function in (READ_COILS, READ_DISCRETE):
        prefix, length = _counted(address, function, (pdu.count + 7) // 8)
    elif function in (READ_HOLDING, READ_INPUT):
        prefix, length = _counted(address, function, 2 * pdu.count)
    elif function == READ_WRITE:
        prefix, length = _counted(address, function, 2 * int.from_bytes(adu[4:6], "big"))
    elif function in (WRITE_COIL, WRITE_SINGLE, WRITE_COILS, WRITE_MULTIPLE):
        prefix, length = adu[:6], 8
    elif function == MASK_WRITE:
        prefix, length = adu[:8], 10
    silent = address == BROADCAST
    return Request(
        address=address,
        function=function,
        adu=adu,
        prefix=prefix,
        length=0 if silent else length,
        writes=function not in _READS,
        sizer=None if silent or length else reply.calculateRtuFrameSize,
    )


def _counted(address: int, function: int, size: int) -> tuple[bytes, int]:
    """How a reply begins that tells its `size` data bytes, and how long it is."""
    return bytes((address, function, size)), 5 + size


class _WriteBytes(WriteMultipleRegistersRequest):
    """A write of registers whose bytes are given as they are."""

    def __init__(self, register: int, count: int, data: bytes) -> None:
        super().__init__(address=register, count=count)
        self._data = data

    def encode(self) -> bytes:
        return struct.pack(">HHB", self.address, self.count, len(self._data)) + self._data


def _read(pdu: type[ModbusPDU], address: int, register: int, count: int) -> Request:
    address = unit_address(address)
    register, count = _window(register, count, MAX_READ)
    function: int = pdu.function_code
    adu = _encode(address, pdu(address=register, count=count))
    return Request(address, function, adu, *_counted(address, function, 2 * count), writes=False)


def _write_block(address: int, pdu: ModbusPDU, hidden_refusal: bool) -> Request:
    address = _any_address(address)
    adu = _encode(address, pdu)
    return _write(address, WRITE_MULTIPLE, adu, adu[:6], adu[:4] + b"\0\0" if hidden_refusal else None)


def _write(address: int, function: int, adu: bytes, echo: bytes, refusal: bytes | None) -> Request:
    length = 0 if address == BROADCAST else 8
    return Request(address, function, adu, echo, length, writes=True, refusal=refusal)


def _encode(address: int, pdu: ModbusPDU) -> bytes:
    head = bytes((address, pdu.function_code)) + pdu.encode()
    return head + crc(head)


def _any_address(address: int) -> int:
    return whole("address", address, BROADCAST, MAX_ADDRESS)


def _window(register: int, count: int, most: int) -> tuple[int, int]:
    """Where `count` registers begin that one frame names, and how many they are."""
    register, count = whole("register address", register, 0, 0xFFFF), whole("count", count, 1, most)
    if register + count > 0x10000:
        raise ValueError(f"registers {register}..{register + count - 1} are outside 0..65535")
    return register, count


def _value(value: int) -> int:
    return whole("register value", value, 0, 0xFFFF)
