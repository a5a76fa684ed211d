"""Requests, and what their replies must look like.

The bytes come from pymodbus' PDU classes. What a standard master cannot say, and MKS drives need, is a
parameter here: a payload that is not two bytes a register (`write_bytes`), and a refusal inside a normal reply
(`refusal=`).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from rs485bus.arguments import whole
from rs485bus.wire.answers import READ_INPUT as READ_INPUT
from rs485bus.wire.answers import WRITE_MULTIPLE as WRITE_MULTIPLE
from rs485bus.wire.answers import WRITE_SINGLE as WRITE_SINGLE
from rs485bus.wire.answers import Answer, answer_to, changes, counted
from rs485bus.wire.answers import Sizer as Sizer
from rs485bus.wire.crc import crc as crc

BROADCAST = 0
MAX_ADDRESS = 247
HIGHEST_ADDRESS = 255
"""The highest address that a byte can say. What is above 247 is reserved (Modbus over Serial Line V1.02, 2.2)."""
MAX_FRAME = 256
"""The longest frame on the pair, address and CRC included (Modbus over Serial Line V1.02, 2.5.1)."""
EXCEPTION_LENGTH = 5
MAX_READ, MAX_WRITE = 125, 123
"""How many registers one frame can read or write."""


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

    def __hash__(self) -> int:
        return hash(self.adu)  # bytes remember theirs

    def __str__(self) -> str:
        to = "everyone" if self.address == BROADCAST else f"unit {self.address}"
        return f"function {self.function} to {to} ({self.adu.hex(' ').upper()})"

    @property
    def register(self) -> int:
        """The first register named, for functions that name one."""
        return int.from_bytes(self.adu[2:4], "big")

    def answered_by(self, frame: bytes) -> bool:
        """Whether a frame may be a reply to this request: a normal one, a refusal inside one, or an exception."""
        if frame.startswith(bytes((self.address, self.function | 0x80))):
            return len(frame) == EXCEPTION_LENGTH
        if self.length and len(frame) != self.length:
            return False
        return frame.startswith(self.prefix) or (self.refusal is not None and frame.startswith(self.refusal))

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


def is_read(adu: bytes) -> bool:
    """Whether a request does nothing but read, by functions 01 to 04. Nothing at all is none."""
    return len(adu) > 1 and 1 <= adu[1] <= 4


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
def read_holding(address: int, register: int, count: int, highest: int = MAX_ADDRESS) -> Request:
    """Read `count` (1..125) holding registers, function 03."""
    return _read(ReadHoldingRegistersRequest, address, register, count, highest)


@lru_cache(maxsize=1024, typed=True)
def read_input(address: int, register: int, count: int, highest: int = MAX_ADDRESS) -> Request:
    """Read `count` (1..125) input registers, function 04."""
    return _read(ReadInputRegistersRequest, address, register, count, highest)


def write_single(
    address: int, register: int, value: int, *, hidden_refusal: bool = False, highest: int = MAX_ADDRESS
) -> Request:
    """Write one register, function 06.

    Args:
        address: 1..247, or 0 for everyone.
        register: 0..65535.
        value: 0..65535.
        hidden_refusal: the device says no by echoing 0xFFFF as the value (MKS RTU V1.0.9, 2.4).
        highest: 255 to allow the addresses that the specification reserves.
    """
    address = _any_address(address, highest)
    register, _ = window(register, 1, 1)
    adu = _encode(address, WriteSingleRegisterRequest(address=register, registers=[_value(value)]))
    return _write(adu, adu[:4] + b"\xff\xff" if hidden_refusal else None)


def write_multiple(
    address: int, register: int, values: Sequence[int], *, hidden_refusal: bool = False, highest: int = MAX_ADDRESS
) -> Request:
    """Write 1..123 registers, function 16. Arguments as for `write_single`."""
    numbers = words(values, MAX_WRITE)
    register, _ = window(register, len(numbers), MAX_WRITE)
    pdu = WriteMultipleRegistersRequest(address=register, registers=numbers)
    return _write_block(address, pdu, hidden_refusal, highest)


def write_bytes(address: int, register: int, count: int, data: bytes, *, hidden_refusal: bool = False) -> Request:
    """Write `data` as `count` registers, function 16, also where the bytes are not twice the registers.

    MKS' homing parameters are three registers in five bytes (MKS RTU V1.0.9, 5.3.2).
    """
    if not 1 <= len(data) <= 246:
        raise ValueError(f"{len(data)} data bytes in one write; 1..246 fit a frame")
    pdu = _WriteBytes(*window(register, count, MAX_WRITE), data)
    return _write_block(address, pdu, hidden_refusal, MAX_ADDRESS)


def public(address: int, function: int, data: bytes, *, highest: int = MAX_ADDRESS) -> Request:
    """A request by a public function of the specification. 0 as the address is everyone's."""
    adu = _closed(whole("address", address, BROADCAST, highest), function, data)
    answer = answer_to(adu)
    if answer is None:
        raise ValueError(f"function {function} is no public one: say how it is answered")
    return _request(adu, answer, changes(adu))


def private(
    address: int, function: int, data: bytes, answer: Answer, *, writes: bool, highest: int = MAX_ADDRESS
) -> Request:
    """A request by any function, answered as said."""
    return _request(_closed(whole("address", address, BROADCAST, highest), function, data), answer, writes)


def from_pdu(address: int, pdu: ModbusPDU, reply: type[ModbusPDU], *, highest: int = MAX_ADDRESS) -> Request:
    """Any request of pymodbus, answered by PDUs of the class `reply`.

    How long a reply is, is asked of the class where it is not pymodbus' own, and of the specification otherwise.
    """
    address = whole("address", address, BROADCAST, highest)
    adu = _encode(address, pdu)
    is_own = reply.__module__.startswith("pymodbus.")
    answer = answer_to(adu) if is_own else None
    if answer is None:
        answer = _told_by(reply, adu)
    return _request(adu, answer, changes(adu))


def _told_by(reply: type[ModbusPDU], adu: bytes) -> Answer:
    """How long the reply is by its own class."""
    size = int(reply.rtu_frame_size)
    if size:
        return Answer(adu[:2], size)
    base = ModbusPDU.calculateRtuFrameSize.__func__  # type: ignore[attr-defined] # a class method has one
    if not reply.rtu_byte_count_pos and getattr(reply.calculateRtuFrameSize, "__func__", None) is base:
        raise ValueError(
            f"{reply.__name__} does not say how long its frame is: give it rtu_frame_size, rtu_byte_count_pos or "
            "calculateRtuFrameSize()"
        )

    def sized(frame: bytes) -> int:
        try:
            return int(reply.calculateRtuFrameSize(frame))
        except Exception:  # whatever it makes of too few bytes
            return 0

    return Answer(adu[:2], 0, sized)


def _request(adu: bytes, answer: Answer, writes: bool) -> Request:
    if adu[0] == BROADCAST:
        answer = Answer(answer.prefix, 0)
    return Request(adu[0], adu[1], adu, answer.prefix, answer.length, writes, sizer=answer.sizer)


class _WriteBytes(WriteMultipleRegistersRequest):
    """A write of registers whose bytes are given as they are."""

    def __init__(self, register: int, count: int, data: bytes) -> None:
        super().__init__(address=register, count=count)
        self._data = data

    def encode(self) -> bytes:
        return struct.pack(">HHB", self.address, self.count, len(self._data)) + self._data


def _read(pdu: type[ModbusPDU], address: int, register: int, count: int, highest: int) -> Request:
    address = unit_address(address, highest=highest)
    register, count = window(register, count, MAX_READ)
    adu = _encode(address, pdu(address=register, count=count))
    return _request(adu, counted(adu, 2 * count), writes=False)


def _write_block(address: int, pdu: ModbusPDU, hidden_refusal: bool, highest: int) -> Request:
    adu = _encode(_any_address(address, highest), pdu)
    return _write(adu, adu[:4] + b"\0\0" if hidden_refusal else None)


def _write(adu: bytes, refusal: bytes | None) -> Request:
    length = 0 if adu[0] == BROADCAST else 8
    return Request(adu[0], adu[1], adu, adu[:6], length, writes=True, refusal=refusal)


def _encode(address: int, pdu: ModbusPDU) -> bytes:
    return _closed(address, pdu.function_code, pdu.encode())


def _closed(address: int, function: int, data: bytes) -> bytes:
    """The frame, with its CRC."""
    head = bytes((address, function)) + data
    if len(head) + 2 > MAX_FRAME:
        raise ValueError(f"a frame of {len(head) + 2} bytes; the longest has {MAX_FRAME}")
    return head + crc(head)


def _any_address(address: int, highest: int) -> int:
    return whole("address", address, BROADCAST, highest)


def window(register: int, count: int, most: int, what: str = "register") -> tuple[int, int]:
    """Where `count` registers (or what it is) begin that one frame names, and how many they are."""
    register, count = whole(f"{what} address", register, 0, 0xFFFF), whole("count", count, 1, most)
    if register + count > 0x10000:
        raise ValueError(f"{what}s {register}..{register + count - 1} are outside 0..65535")
    return register, count


def words(values: Sequence[int], most: int) -> list[int]:
    """The values of 1..`most` registers that one frame writes."""
    try:
        count = len(values)
    except TypeError:
        raise TypeError(f"values must be a sequence of register values, [1, 2] say, not {values!r}") from None
    if not 1 <= count <= most:
        raise ValueError(f"{count} registers in one write; 1..{most} fit a frame")
    return [_value(value) for value in values]


def _value(value: int) -> int:
    return whole("register value", value, 0, 0xFFFF)
