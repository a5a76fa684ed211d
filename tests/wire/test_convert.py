"""Values in registers: what pymodbus' converters say, and errors that help."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.client.mixin import ModbusClientMixin

from rs485bus.wire.convert import DataType, convert_from_registers, convert_to_registers

pymodbus_of: Any = ModbusClientMixin
words = st.integers(0, 0xFFFF)
orders = st.sampled_from(["big", "little"])
numeric = st.sampled_from([kind for kind in DataType if kind.value[1]])


def same(ours: Any, theirs: Any) -> bool:
    return repr(ours) == repr(theirs)  # NaN is not itself


@given(numeric, st.integers(0, 4), orders, st.data())
def test_numbers_are_read_as_pymodbus_reads_them(kind: DataType, count: int, order: Any, data: st.DataObject) -> None:
    size = count * kind.value[1]
    registers = data.draw(st.lists(words, min_size=size, max_size=size))
    theirs = pymodbus_of.convert_from_registers(registers, pymodbus_of.DATATYPE[kind.name], word_order=order)
    assert same(convert_from_registers(registers, kind, order), theirs)
    assert same(convert_from_registers(registers, pymodbus_of.DATATYPE[kind.name], order), theirs)


@given(numeric, orders, st.lists(st.integers(-(2**15), 2**15 - 1), min_size=1, max_size=3))
def test_numbers_are_written_as_pymodbus_writes_them(kind: DataType, order: Any, values: list[int]) -> None:
    if kind.name.startswith("U"):
        values = [abs(value) for value in values]
    theirs = pymodbus_of.convert_to_registers(list(values), pymodbus_of.DATATYPE[kind.name], word_order=order)
    assert convert_to_registers(values, kind, order) == theirs
    assert convert_to_registers(values[0], kind, order) == theirs[: kind.value[1]]


@pytest.mark.skipif(
    pymodbus_of.convert_to_registers([True], pymodbus_of.DATATYPE.BITS) == [1],
    reason="pymodbus had the bytes of bits the other way round before 3.12",
)
@given(st.lists(st.booleans(), min_size=1, max_size=40), orders)
def test_bits_are_as_pymodbus_has_them(bits: list[bool], order: Any) -> None:
    theirs = pymodbus_of.convert_to_registers(list(bits), pymodbus_of.DATATYPE.BITS, word_order=order)
    assert convert_to_registers(bits, DataType.BITS, order) == theirs
    back = convert_from_registers(theirs, DataType.BITS, order)
    assert back == pymodbus_of.convert_from_registers(theirs, pymodbus_of.DATATYPE.BITS, word_order=order)
    assert back[: len(bits)] == bits  # type: ignore[index] # a list it is


@given(st.text(alphabet=st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=20), orders)
def test_text_comes_back(text: str, order: Any) -> None:
    registers = convert_to_registers(text, DataType.STRING, order)
    assert registers == pymodbus_of.convert_to_registers(text, pymodbus_of.DATATYPE.STRING, word_order=order)
    assert convert_from_registers(registers, DataType.STRING, order) == text


def test_the_bits_of_a_caller_are_left_alone() -> None:
    bits = [True]
    convert_to_registers(bits, DataType.BITS)
    assert bits == [True]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: convert_from_registers([1, 2, 3], DataType.INT32), "3 registers hold no INT32 values: one takes 2"),
        (lambda: convert_from_registers([1], "INT16"), r"data_type must be made like DataType\.FLOAT32, not 'INT16'"),  # type: ignore[arg-type]
        (lambda: convert_from_registers([1], DataType.INT16, "middle"), "word_order 'middle' is neither"),  # type: ignore[arg-type]
        (lambda: convert_to_registers(70000, DataType.UINT16), "70000 does not fit UINT16"),
        (lambda: convert_to_registers(1e40, DataType.FLOAT32), "1e.40 does not fit FLOAT32"),
        (lambda: convert_to_registers("5", DataType.UINT16), "'5' does not fit UINT16"),
        (lambda: convert_to_registers(5, DataType.STRING), "a STRING must be text, not 5"),
        (lambda: convert_to_registers(5, DataType.BITS), "BITS must be a list of bools, not 5"),
    ],
)
def test_what_cannot_be_converted_is_said(call: Any, said: str) -> None:
    with pytest.raises((ValueError, TypeError), match=said):
        call()
