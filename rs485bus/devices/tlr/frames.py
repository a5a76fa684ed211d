"""Requests to TL-R drives from typed values (TL-R manual, 4). Pure."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, TypeVar

from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.values import Auxiliary, ControlWord
from rs485bus.wire.frames import WRITE_MULTIPLE, WRITE_SINGLE, Request, read_holding, write_multiple, write_single
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")


def read(address: int, what: Register[Any] | Block) -> Request:
    """Read a register or a block, function 03."""
    return read_holding(address, what.address, what.count)


def words(data: bytes) -> tuple[int, ...]:
    """The registers in the bytes of a value or a block."""
    return struct.unpack(f">{len(data) // 2}H", data)


def write(address: int, register: int, values: Sequence[int]) -> Request:
    """Write registers: one by function 06, several by 16."""
    if len(values) == 1:
        return write_single(address, register, values[0])
    return write_multiple(address, register, values)


def control(address: int, word: ControlWord) -> Request:
    """Write the control word (3.1.3)."""
    return write_single(address, r.CONTROL.address, r.CONTROL.raw(word))


def auxiliary(address: int, command: Auxiliary) -> Request:
    """Write the auxiliary control (3.5.3)."""
    return write_single(address, r.AUXILIARY.address, r.AUXILIARY.raw(command))


def written(request: Request) -> dict[int, int]:
    """The registers that a request writes, each with its value; none where it is no write of registers."""
    if request.function == WRITE_SINGLE:
        data = request.adu[4:6]
    elif request.function == WRITE_MULTIPLE:
        data = request.adu[7:-2]
    else:
        return {}
    return dict(enumerate(words(data), request.register))
