"""Coils, registers, queues and files: requests by the public functions, and what their replies hold. Pure.

Source: Modbus Application Protocol V1.1b3, chapter 6. `wire.frames` has the four functions that drives use, and
`wire.diagnostics` those that ask a device about itself. `highest` is as for `write_single`.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

from rs485bus.arguments import flag, whole
from rs485bus.wire.answers import (
    MASK_WRITE,
    READ_COILS,
    READ_DISCRETE,
    READ_FIFO,
    READ_FILE,
    READ_WRITE,
    WRITE_COIL,
    WRITE_COILS,
    WRITE_FILE,
    counted,
)
from rs485bus.wire.frames import MAX_ADDRESS, MAX_READ, Request, public, window, words

T = TypeVar("T")

MAX_READ_BITS, MAX_WRITE_BITS = 2000, 1968
"""How many coils one frame can read or write (6.1, 6.11)."""
MAX_READ_WRITE = 121
"""How many registers function 23 can write (6.17)."""
_MAX_RECORD = 9999
MAX_FILE_REPLY, _MAX_FILE_WRITE = 245, 251
"""How many bytes of records one frame can hold (6.14, 6.15)."""
_MAX_RECORDS_READ, _MAX_RECORDS_WRITTEN = (MAX_FILE_REPLY - 2) // 2, (_MAX_FILE_WRITE - 7) // 2
_REFERENCE_TYPE = 6


class FileRange(NamedTuple):
    """Registers of a file to read: `length` of them from record `record` (0..9999) of file `file` (1..65535) on."""

    file: int
    record: int
    length: int


class FileData(NamedTuple):
    """Registers of a file to write, from record `record` (0..9999) of file `file` (1..65535) on."""

    file: int
    record: int
    values: Sequence[int]


# Bits


def read_coils(address: int, coil: int, count: int, *, highest: int = MAX_ADDRESS) -> Request:
    """Read `count` (1..2000) coils, function 01."""
    return _read_bits(address, READ_COILS, "coil", coil, count, highest)


def read_discrete(address: int, first: int, count: int, *, highest: int = MAX_ADDRESS) -> Request:
    """Read `count` (1..2000) discrete inputs, function 02."""
    return _read_bits(address, READ_DISCRETE, "input", first, count, highest)


def bits(reply: bytes, count: int) -> list[bool]:
    """The first `count` bits in a reply to functions 01 and 02. The lowest bit of the first byte comes first."""
    number = int.from_bytes(reply[3:-2], "little")
    return [bool(number >> at & 1) for at in range(count)]


def write_coil(address: int, coil: int, value: bool, *, highest: int = MAX_ADDRESS) -> Request:
    """Set or clear one coil, function 05."""
    coil, _ = window(coil, 1, 1, "coil")
    data = struct.pack(">HH", coil, 0xFF00 if flag("coil value", value) else 0)
    return public(address, WRITE_COIL, data, highest=highest)


def write_coils(address: int, coil: int, values: Sequence[bool], *, highest: int = MAX_ADDRESS) -> Request:
    """Set or clear 1..1968 coils, function 15."""
    try:
        flags = [flag("coil value", value) for value in values]
    except TypeError as error:
        if isinstance(values, Iterable):
            raise
        raise TypeError(f"values must be a sequence of coil values, [True, False] say, not {values!r}") from error
    if not 1 <= len(flags) <= MAX_WRITE_BITS:
        raise ValueError(f"{len(flags)} coils in one write; 1..{MAX_WRITE_BITS} fit a frame")
    coil, count = window(coil, len(flags), MAX_WRITE_BITS, "coil")
    size = (count + 7) // 8
    number = sum(value << at for at, value in enumerate(flags))
    data = struct.pack(">HHB", coil, count, size) + number.to_bytes(size, "little")
    return public(address, WRITE_COILS, data, highest=highest)


# Registers


def mask_write(address: int, register: int, and_mask: int, or_mask: int, *, highest: int = MAX_ADDRESS) -> Request:
    """Set a register to (its value AND `and_mask`) OR (`or_mask` AND NOT `and_mask`), function 22."""
    register, _ = window(register, 1, 1)
    masks = whole("and_mask", and_mask, 0, 0xFFFF), whole("or_mask", or_mask, 0, 0xFFFF)
    return public(address, MASK_WRITE, struct.pack(">HHH", register, *masks), highest=highest)


def read_write(
    address: int,
    read_register: int,
    read_count: int,
    write_register: int,
    values: Sequence[int],
    *,
    highest: int = MAX_ADDRESS,
) -> Request:
    """Write 1..121 registers, then read `read_count` (1..125) others, function 23."""
    numbers = words(values, MAX_READ_WRITE)
    write_register, count = window(write_register, len(numbers), MAX_READ_WRITE)
    data = struct.pack(">HHHHB", *window(read_register, read_count, MAX_READ), write_register, count, 2 * count)
    return public(address, READ_WRITE, data + _packed(numbers), highest=highest)


def read_fifo(address: int, register: int, *, highest: int = MAX_ADDRESS) -> Request:
    """Read the queue of up to 31 registers whose pointer is at `register`, function 24. It is not emptied by that."""
    register, _ = window(register, 1, 1)
    return public(address, READ_FIFO, struct.pack(">H", register), highest=highest)


def fifo(reply: bytes) -> list[int]:
    """The registers in such a reply, the oldest first."""
    return _unpacked(reply[6:-2])


# Files


def read_files(address: int, records: Sequence[tuple[int, int, int]], *, highest: int = MAX_ADDRESS) -> Request:
    """Read registers of one or more files, function 20."""
    groups = [
        struct.pack(
            ">BHHH", _REFERENCE_TYPE, *_place(file, record), whole("record length", length, 1, _MAX_RECORDS_READ)
        )
        for file, record, length in _triples(records, "[(file, record, length)]")
    ]
    sizes = [2 + 2 * int.from_bytes(group[5:], "big") for group in groups]
    _check_size("reply", sum(sizes), MAX_FILE_REPLY)
    _check_size("request", 7 * len(groups), MAX_FILE_REPLY)
    request = public(address, READ_FILE, bytes((7 * len(groups),)) + b"".join(groups), highest=highest)
    # How long the reply is, is known here; the groups in it are so, too.
    prefix, length, _ = counted(request.adu, sum(sizes))
    return replace(request, prefix=prefix, length=length, sizer=None)


def file_records(reply: bytes) -> list[list[int]]:
    """The registers in a reply to function 20, a list for each group that was asked for."""
    groups, at = [], 3
    while at < len(reply) - 2:
        end = at + 1 + reply[at]
        groups.append(_unpacked(reply[at + 2 : min(end, len(reply) - 2)]))
        at = end
    return groups


def write_files(
    address: int, records: Sequence[tuple[int, int, Sequence[int]]], *, highest: int = MAX_ADDRESS
) -> Request:
    """Write registers of one or more files, function 21."""
    data = b""
    for file, record, values in _triples(records, "[(file, record, values)]"):
        numbers = words(values, _MAX_RECORDS_WRITTEN)
        data += struct.pack(">BHHH", _REFERENCE_TYPE, *_place(file, record), len(numbers)) + _packed(numbers)
    _check_size("request", len(data), _MAX_FILE_WRITE)
    return public(address, WRITE_FILE, bytes((len(data),)) + data, highest=highest)


def _triples(records: Sequence[tuple[int, int, T]], example: str) -> list[tuple[int, int, T]]:
    try:
        return [(file, record, last) for file, record, last in records]
    except (TypeError, ValueError):
        raise TypeError(f"records must be made like {example}, not {records!r}") from None


def _place(file: int, record: int) -> tuple[int, int]:
    return whole("file number", file, 1, 0xFFFF), whole("record number", record, 0, _MAX_RECORD)


def _check_size(what: str, size: int, most: int) -> None:
    if not size:
        raise ValueError("name the records: [(file, record, length)] to read, [(file, record, values)] to write")
    if size > most:
        raise ValueError(f"the {what} would hold {size} bytes of records; {most} fit a frame. Ask for fewer at once")


def _read_bits(address: int, function: int, what: str, first: int, count: int, highest: int) -> Request:
    first, count = window(first, count, MAX_READ_BITS, what)
    return public(address, function, struct.pack(">HH", first, count), highest=highest)


def _packed(values: Sequence[int]) -> bytes:
    return struct.pack(f">{len(values)}H", *values)


def _unpacked(data: bytes) -> list[int]:
    return list(struct.unpack(f">{len(data) // 2}H", data[: len(data) // 2 * 2]))
