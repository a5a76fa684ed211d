"""Requests to MKS drives from typed values, and back. They refuse inside normal replies (MKS RTU V1.0.9, 2.4)."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

from rs485bus.arguments import real, whole
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import Model
from rs485bus.errors import LimitExceeded
from rs485bus.wire.frames import (
    BROADCAST,
    READ_INPUT,
    WRITE_MULTIPLE,
    WRITE_SINGLE,
    Request,
    read_input,
    write_bytes,
    write_single,
)
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")

_READS: dict[tuple[int, int], Register[Any] | Block] = {(what.address, what.count): what for what in r.READS}
_SINGLE: dict[int, Register[Any]] = {register.address: register for register in r.SINGLE_WRITES}
_BLOCKS: dict[tuple[int, int], Register[Any] | Block] = {(what.address, what.count): what for what in r.BLOCK_WRITES}
_NATIVE_REQUEST, _NATIVE_REPLY = 0xFA, 0xFB
# Of the reply the manual says nothing: drives were seen to begin it so.


class Spoken(NamedTuple):
    """What a request says: which register or block, and the typed values it writes; none for a read."""

    what: Register[Any] | Block
    values: tuple[Any, ...]


def read(address: int, what: Register[Any] | Block) -> Request:
    """Read a register or a block, function 04."""
    return read_input(address, what.address, what.count)


def write(address: int, register: Register[T], value: T) -> Request:
    """Write a register, function 06; one of 32 bits takes function 16."""
    if register.count == 1:
        return write_single(address, register.address, register.raw(value), hidden_refusal=True)
    return write_bytes(address, register.address, register.count, register.encode(value), hidden_refusal=True)


def write_block(address: int, block: Block, *values: Any) -> Request:
    """Write a block, function 16, its values in the order of its fields."""
    return write_bytes(address, block.address, block.count, block.encode(*values), hidden_refusal=True)


def current(address: int, model: Model, milliamperes: int, save: bool) -> Request:
    """Set the working current (3.2.3): 0..3000 mA, of a 57D 0..5200 mA. Unsaved it holds until a restart."""
    value = check_current("working current", model, milliamperes)
    value |= 0 if save else r.CURRENT_NOT_SAVED
    return write_single(address, r.CURRENT.address, value, hidden_refusal=True)


def check_current(name: str, model: Model, milliamperes: int) -> int:
    """A current that a model can give. Raises `LimitExceeded`."""
    if not 0 <= real(name, milliamperes) <= model.max_current:
        raise LimitExceeded(f"{name} {milliamperes} mA is outside 0..{model.max_current} mA of a SERVO{model.value}")
    return whole(name, milliamperes, 0, model.max_current)


def native(address: int, code: int, *data: int) -> Request:
    """A frame of the drives' own protocol, which ends in the sum of its bytes (3.2.12).

    It is no Modbus: to the bus it is a frame that nobody answers, with a turnaround after it in which whatever comes
    back is passed over. The manual prints it for address 1 alone; that the second byte is the address is inferred.
    """
    body = bytes((_NATIVE_REQUEST, address, code, *data))
    return Request(BROADCAST, code, body + bytes([sum(body) % 256]), prefix=b"", length=0, writes=True)


def is_native(address: int, data: bytes) -> bool:
    """Whether some bytes are a frame of a drive's own protocol, a request or a reply."""
    begins = len(data) > 3 and data[0] in (_NATIVE_REQUEST, _NATIVE_REPLY) and data[1] == address
    return begins and sum(data[:-1]) % 256 == data[-1]


def understand(pdu: bytes) -> Spoken:
    """What a request says, from its function code and data.

    Raises:
        ValueError: no drive of the family understands it, or a value is none of those that can be chosen.
    """
    register, count = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
    function = pdu[0] if pdu else 0
    what: Register[Any] | Block | None = None
    data = b""
    if function == READ_INPUT and len(pdu) == 5:
        what = _READS.get((register, count))
    elif function == WRITE_SINGLE and len(pdu) == 5:
        what, data = _SINGLE.get(register), pdu[3:]
    elif function == WRITE_MULTIPLE and len(pdu) > 6 and pdu[5] == len(pdu) - 6:
        what, data = _BLOCKS.get((register, count)), pdu[6:]
    if what is None or (data and len(data) != _size(what)):
        raise ValueError(f"{pdu.hex(' ').upper()} is no request to an MKS drive")
    if not data:
        return Spoken(what, ())
    return Spoken(what, what.decode(data) if isinstance(what, Block) else (what.decode(data),))


def _size(what: Register[Any] | Block) -> int:
    return what.size if isinstance(what, Block) else what.number.size
