"""Requests to MKS drives from typed values. They refuse inside normal replies (MKS RTU V1.0.9, 2.4)."""

from __future__ import annotations

from typing import Any, TypeVar

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import Model
from rs485bus.errors import LimitExceeded
from rs485bus.wire.frames import Request, read_input, write_bytes, write_single
from rs485bus.wire.registers import Block, Register

T = TypeVar("T")


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
    if not 0 <= milliamperes <= model.max_current:
        raise LimitExceeded(
            f"working current {milliamperes} mA is outside 0..{model.max_current} mA of a SERVO{model.value}"
        )
    value = milliamperes if save else milliamperes | r.CURRENT_NOT_SAVED
    return write_single(address, r.CURRENT.address, value, hidden_refusal=True)
