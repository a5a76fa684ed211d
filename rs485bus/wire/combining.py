"""Which registers are read together. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from rs485bus.wire.frames import MAX_READ, Request, payload, read_holding, read_input
from rs485bus.wire.registers import Register

_READS = {3: read_holding, 4: read_input}


class Span(NamedTuple):
    """A run of registers that one request reads, and the values in it by their place in what was asked for."""

    function: int
    first: int
    length: int
    members: tuple[tuple[int, Register[Any]], ...]

    def request(self, address: int, highest: int) -> Request:
        """The request that reads it."""
        return _READS[self.function](address, self.first, self.length, highest)

    def values(self, reply: bytes) -> dict[int, Any]:
        """The values in the reply, by their place."""
        data = payload(reply)
        return {
            place: _value(register, data[2 * (register.address - self.first) :]) for place, register in self.members
        }

    def apart(self) -> list[Span]:
        """Each value by itself."""
        return [_alone(place, register, self.function) for place, register in self.members]


def spans(
    registers: Sequence[Register[Any]], *, combine: bool, gap: int = 0, function: int | None = None
) -> list[Span]:
    """The fewest requests that read some registers.

    A value is never split. Values are read together where they touch, overlap, or leave no more than `gap` registers
    between them; nothing is with `combine` False. `function` is the only one that the device reads by, if it has one.
    """
    alone = [_alone(place, register, function) for place, register in enumerate(registers)]
    if not combine:
        return alone
    joined: list[Span] = []
    for span in sorted(alone):
        last = joined[-1] if joined else None
        if last is None or span.function != last.function or span.first > last.first + last.length + gap:
            joined.append(span)
            continue
        count = max(last.first + last.length, span.first + span.length) - last.first
        if count > MAX_READ:
            joined.append(span)
        else:
            joined[-1] = Span(last.function, last.first, count, last.members + span.members)
    return joined


def words_of(register: Register[Any], value: Any) -> list[int]:
    """The values of the registers that hold `value`. What is shorter than them lies in the lower byte."""
    data = register.encode(value)
    missing = 2 * register.count - len(data)
    data = (b"\xff" if missing and register.number.low < 0 and data[0] & 0x80 else b"\0") * missing + data
    return [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]


def _alone(place: int, register: Register[Any], function: int | None = None) -> Span:
    return Span(function or register.function, register.address, register.count, ((place, register),))


def _value(register: Register[Any], data: bytes) -> Any:
    return register.decode(data[2 * register.count - register.number.size :])
