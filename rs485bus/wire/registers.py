"""Typed registers: a name, an address, a type, a unit, a range, a repeat rule. Tables of them are plain data."""

from __future__ import annotations

import enum
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, Generic, Literal, TypeVar, cast

from rs485bus.arguments import choice, real
from rs485bus.errors import LimitExceeded
from rs485bus.wire.convert import WordOrder

T = TypeVar("T")


class Repeat(enum.Enum):
    """What may be done when a command was sent and no reply came."""

    SAFE = "safe"
    """It may be sent again: reads, parameter writes, stops."""
    VERIFY = "verify"
    """It may be sent again once a read-back has told that it did not happen."""
    NEVER = "never"
    """It is not sent again."""


@dataclass(frozen=True, slots=True)
class Number:
    """How a whole number lies in bytes, high byte first."""

    name: str
    size: int
    signed: bool

    @property
    def low(self) -> int:
        return -(1 << (8 * self.size - 1)) if self.signed else 0

    @property
    def high(self) -> int:
        return (1 << (8 * self.size - self.signed)) - 1

    def encode(self, value: int) -> bytes:
        return value.to_bytes(self.size, "big", signed=self.signed)

    def decode(self, data: bytes) -> int:
        return int.from_bytes(data[: self.size], "big", signed=self.signed)


@dataclass(frozen=True, slots=True)
class Real:
    """How a floating-point number lies in bytes (IEEE 754), sign and exponent first."""

    name: str
    size: Literal[4, 8]

    @property
    def low(self) -> int:
        return -self.high

    @property
    def high(self) -> int:
        largest = b"\x7f\x7f\xff\xff" if self.size == 4 else b"\x7f\xef" + 6 * b"\xff"
        return int(self.decode(largest))

    def encode(self, value: float) -> bytes:
        return struct.pack(">f" if self.size == 4 else ">d", value)

    def decode(self, data: bytes) -> float:
        value: float = struct.unpack_from(">f" if self.size == 4 else ">d", data)[0]
        return value


U8: Final = Number("uint8", 1, signed=False)
I8: Final = Number("int8", 1, signed=True)
U16: Final = Number("uint16", 2, signed=False)
I16: Final = Number("int16", 2, signed=True)
U32: Final = Number("uint32", 4, signed=False)
I32: Final = Number("int32", 4, signed=True)
I48: Final = Number("int48", 6, signed=True)
U64: Final = Number("uint64", 8, signed=False)
I64: Final = Number("int64", 8, signed=True)
F32: Final = Real("float32", 4)
F64: Final = Real("float64", 8)


@dataclass(frozen=True, slots=True)
class Field(Generic[T]):
    """One value in a register or a block of them.

    `low` and `high` bound what may be written, in the value's own unit; the number's range holds where they are
    None. `step` is the value of one count, in that unit. `into` makes the typed value: an enum, `bool`, or nothing.
    `word_order` is "little" where the register of the lowest bits comes first.
    """

    name: str
    number: Number | Real
    unit: str = ""
    low: float | None = None
    high: float | None = None
    step: float = 1
    into: Callable[[int], T] | None = None
    word_order: WordOrder = "big"

    def encode(self, value: T) -> bytes:
        """The bytes of `value`.

        Raises:
            LimitExceeded: it is outside the range, or none of the values that may be chosen.
        """
        number = self.number
        data = number.encode(self.scaled(value)) if isinstance(number, Real) else number.encode(self.raw(value))
        return data if self.word_order == "big" else _swapped(data)

    def decode(self, data: bytes) -> T:
        """The value in the first bytes of `data`.

        Raises:
            LimitExceeded: the table does not name it. It is a `ValueError`, too.
        """
        if self.word_order == "little":
            data = _swapped(data[: self.number.size])
        raw = self.number.decode(data)
        if self.into is not None:
            try:
                return self.into(cast(int, raw))
            except ValueError:
                raise LimitExceeded(
                    f"{self.name} reads {raw}, of which the manual says nothing. Look whether "
                    "such a drive is at that address."
                ) from None
        if self.step == 1:
            return cast(T, raw)
        parts = _parts(self.step)
        return cast(T, raw / parts if parts else raw * self.step)

    def raw(self, value: T) -> int:
        """The whole number that stands for `value`, checked against the range."""
        scaled = self.scaled(value)
        raw = round(scaled)
        if self.step == 1 and raw != scaled:
            raise LimitExceeded(f"{self.name} {value} is not a whole number")
        return raw

    def scaled(self, value: T) -> float:
        """`value` in counts, checked against the range."""
        if isinstance(self.into, enum.EnumType):
            self._check_choice(value)
        number = cast(Any, value)
        if not isinstance(number, int | float) or (isinstance(number, bool) and self.into is None):
            number = real(self.name, number, f"a number in {self._range}")
        low, high = self._ends
        if not low <= number <= high:
            unit = f" {self.unit}" if self.unit else ""
            raise LimitExceeded(f"{self.name} {value}{unit} is outside {self._range}")
        if self.step == 1:
            return cast(float, number)
        parts = _parts(self.step)
        return cast(float, number * parts if parts else number / self.step)

    @property
    def _ends(self) -> tuple[float, float]:
        low = self.number.low * self.step if self.low is None else self.low
        return low, self.number.high * self.step if self.high is None else self.high

    @property
    def _range(self) -> str:
        low, high = self._ends
        return f"{low:.12g}..{high:.12g}" + (f" {self.unit}" if self.unit else "")

    def _check_choice(self, value: object) -> None:
        into = cast(Any, self.into)
        if not issubclass(into, enum.Flag):
            choice(self.name, value, into)


@lru_cache(maxsize=256)
def _parts(step: float) -> int:
    """How many steps make one, where that is a whole number: 423 steps of 0.1 are then 42.3 and nothing behind it."""
    parts = round(1 / step) if step else 0
    return parts if parts and abs(parts * step - 1) < 1e-12 else 0


def _swapped(data: bytes) -> bytes:
    """The same registers, the last one first."""
    return b"".join(data[at : at + 2] for at in range(len(data) - 2, -2, -2))


@dataclass(frozen=True, slots=True)
class Register(Field[T]):
    """One value at a register address.

    `function` is the code that reads it: 3 for holding registers, 4 for input registers. `repeat` is for the commands
    of a drive family; `unit.write` asks for it anew.
    """

    address: int = 0
    access: Literal["r", "w", "rw"] = "rw"
    repeat: Repeat = Repeat.SAFE
    default: T | None = None
    function: Literal[3, 4] = 3

    @property
    def count(self) -> int:
        """How many registers it takes."""
        return (self.number.size + 1) // 2


@dataclass(frozen=True, slots=True)
class Block:
    """Several values written or read together under one address.

    `count` is the number of registers named in the frame, which some drives do not take as half the bytes.
    """

    name: str
    address: int
    fields: tuple[Field[Any], ...]
    count: int
    repeat: Repeat = Repeat.SAFE

    def encode(self, *values: Any) -> bytes:
        """The bytes of `values`, in the order of the fields.

        Raises:
            LimitExceeded: one is out of its range.
        """
        return b"".join(field.encode(value) for field, value in zip(self.fields, values, strict=True))

    def decode(self, data: bytes) -> tuple[Any, ...]:
        """The typed values in `data`, in the order of the fields."""
        values, at = [], 0
        for field in self.fields:
            values.append(field.decode(data[at:]))
            at += field.number.size
        return tuple(values)

    @property
    def size(self) -> int:
        """How many bytes it takes."""
        return sum(field.number.size for field in self.fields)
