"""Requests to ZLAC8015D drives from typed values. Reads are function 03 (ZLAC8015D RS485 V1.06, 2)."""

from __future__ import annotations

from typing import Any, TypeVar

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.values import ControlWord
from rs485bus.wire.frames import Request, read_holding, write_bytes, write_single
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")

MAX_ADDRESS = 127
"""The highest node ID (0x2001). 1 also says 0, which is the broadcast address of Modbus."""


def read(address: int, what: Register[Any] | Block) -> Request:
    """Read a register or a block, function 03."""
    return read_holding(address, what.address, what.count)


def write(address: int, register: Register[T], value: T) -> Request:
    """Write a register, function 06; one of 32 bits takes function 16."""
    if register.count == 1:
        return write_single(address, register.address, register.raw(value) & 0xFFFF)
    return write_bytes(address, register.address, register.count, register.encode(value))


def write_together(address: int, *values: tuple[Register[Any], Any]) -> Request:
    """Write registers that lie one behind the other in one frame, function 16: (register, value), lowest first."""
    first = values[0][0].address
    data = bytearray()
    for register, value in values:
        if register.address != first + len(data) // 2:
            raise ValueError(f"{register.name} (0x{register.address:04X}) does not lie behind the one before it")
        data += register.encode(value)
    return write_bytes(address, first, len(data) // 2, bytes(data))


def write_twins(address: int, *pairs: tuple[r.Twin[T], T, T]) -> Request:
    """Write what exists once for each wheel in one frame: (twin, left, right), lowest first."""
    values = [item for twin, left, right in pairs for item in ((twin.left, left), (twin.right, right))]
    return write_together(address, *values)


def control(address: int, word: ControlWord) -> Request:
    """A control word."""
    return write(address, r.CONTROL, word)
