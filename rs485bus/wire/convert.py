"""Numbers, text and bits in 16-bit registers, by pymodbus' names and rules. Pure."""

from __future__ import annotations

import enum
import struct
from collections.abc import Sequence
from typing import Literal

WordOrder = Literal["big", "little"]
"""Which register of a value comes first: the one of the highest bits, or the one of the lowest."""

Value = int | float | str | list[bool] | list[int] | list[float]


class DataType(enum.Enum):
    """What registers hold: how `struct` calls it, and how many registers one value takes (0: any number)."""

    INT16 = ("h", 1)
    UINT16 = ("H", 1)
    INT32 = ("i", 2)
    UINT32 = ("I", 2)
    INT64 = ("q", 4)
    UINT64 = ("Q", 4)
    FLOAT32 = ("f", 2)
    FLOAT64 = ("d", 4)
    STRING = ("s", 0)
    BITS = ("bits", 0)


def convert_from_registers(
    registers: Sequence[int],
    data_type: DataType | enum.Enum,
    word_order: WordOrder = "big",
    string_encoding: str = "utf-8",
) -> Value:
    """What registers hold: a value, or a list of them where there are more registers than one value takes.

    Args:
        registers: as a read returned them.
        data_type: a `DataType`; pymodbus' own will do.
        word_order: "little" where the lowest register of a value comes first.
        string_encoding: of a STRING.

    Raises:
        ValueError: the registers are not a multiple of what the type takes, or hold no text of that encoding.
        TypeError: `data_type` is none.
    """
    kind = _kind(data_type)
    code, size = kind.value
    words = list(registers)
    if not size:
        data = _packed(words[::-1] if _reversed(word_order) else words)
        if kind is DataType.STRING:
            return data.rstrip(b"\0").decode(string_encoding)
        return [bool(byte >> bit & 1) for byte in data for bit in range(8)]
    if len(words) % size:
        raise ValueError(f"{len(words)} registers hold no {kind.name} values: one takes {size}")
    values = [
        struct.unpack(f">{code}", _packed(_ordered(words[at : at + size], word_order)))[0]
        for at in range(0, len(words), size)
    ]
    return values if len(values) != 1 else values[0]


def convert_to_registers(
    value: Value,
    data_type: DataType | enum.Enum,
    word_order: WordOrder = "big",
    string_encoding: str = "utf-8",
) -> list[int]:
    """The registers that hold a value, or a list of values. Arguments as for `convert_from_registers`.

    Raises:
        ValueError: a number is out of the type's range.
        TypeError: the value is not of the type.
    """
    kind = _kind(data_type)
    code = kind.value[0]
    if kind is DataType.BITS:
        words = _bit_words(value)
        return words[::-1] if _reversed(word_order) else words
    if kind is DataType.STRING:
        if not isinstance(value, str):
            raise TypeError(f"a STRING must be text, not {value!r}")
        text = value.encode(string_encoding)
        words = _unpacked(text + b"\0" * (len(text) % 2))
        return words[::-1] if _reversed(word_order) else words
    words = []
    for number in value if isinstance(value, list) else [value]:
        try:
            words += _ordered(_unpacked(struct.pack(f">{code}", number)), word_order)
        except (struct.error, OverflowError) as error:
            wrong = ValueError if isinstance(number, int | float) else TypeError
            raise wrong(f"{number!r} does not fit {kind.name}: {error}") from None
    return words


def _kind(data_type: enum.Enum) -> DataType:
    if isinstance(data_type, DataType):
        return data_type
    try:
        return DataType[data_type.name]
    except (AttributeError, KeyError):
        raise TypeError(f"data_type must be made like DataType.FLOAT32, not {data_type!r}") from None


def _bit_words(value: Value) -> list[int]:
    if not isinstance(value, list):
        raise TypeError(f"BITS must be a list of bools, not {value!r}")
    data = bytearray(2 * ((len(value) + 15) // 16))
    for at, bit in enumerate(value):
        data[at // 8] |= bool(bit) << at % 8
    return _unpacked(bytes(data))


def _reversed(word_order: str) -> bool:
    if word_order not in ("big", "little"):
        raise ValueError(f"word_order {word_order!r} is neither 'big' nor 'little'")
    return word_order == "little"


def _ordered(words: list[int], word_order: str) -> list[int]:
    return words[::-1] if _reversed(word_order) else words


def _packed(words: Sequence[int]) -> bytes:
    return b"".join(word.to_bytes(2, "big") for word in words)


def _unpacked(data: bytes) -> list[int]:
    return [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]
