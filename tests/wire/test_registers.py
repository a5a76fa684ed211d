"""Typed registers: what may be written, and what it is in bytes."""

import enum

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus.errors import LimitExceeded
from rs485bus.wire.registers import (
    F32,
    F64,
    I16,
    I32,
    I48,
    I64,
    U8,
    U16,
    U32,
    U64,
    Block,
    Field,
    Number,
    Real,
    Register,
)


class Colour(enum.IntEnum):
    RED = 1
    BLUE = 2


class Bits(enum.IntFlag):
    A = 1
    B = 2


SPEED: Register[int] = Register("speed", U16, "rpm", 0, 3000, address=7)
SCALED: Register[float] = Register("voltage", U16, "V", step=0.01, address=8)
COLOUR: Register[Colour] = Register("colour", U16, into=Colour, address=9)
PAIR = Block("pair", 10, (Field("level", U8, low=0, high=1), Field("offset", I32, "counts")), count=3)

numbers = st.sampled_from([U8, U16, I16, U32, I32, I48, U64, I64])


@given(numbers, st.data())
def test_every_number_comes_back_from_its_bytes(number: Number, data: st.DataObject) -> None:
    value = data.draw(st.integers(number.low, number.high))
    assert number.decode(number.encode(value)) == value
    assert len(number.encode(value)) == number.size


def test_the_ends_of_the_numbers() -> None:
    assert [(number.low, number.high) for number in (U8, I16, U32)] == [(0, 255), (-32768, 32767), (0, 0xFFFFFFFF)]
    assert (I48.low, I48.high) == (-(2**47), 2**47 - 1)
    assert I48.encode(-1) == b"\xff" * 6


@pytest.mark.parametrize("value", [-1, 3001])
def test_a_value_out_of_range_names_the_range(value: int) -> None:
    with pytest.raises(LimitExceeded, match=rf"speed {value} rpm is outside 0\.\.3000 rpm"):
        SPEED.encode(value)


def test_a_fraction_where_whole_numbers_go_is_refused() -> None:
    with pytest.raises(LimitExceeded, match="not a whole number"):
        SPEED.encode(1.5)  # type: ignore[arg-type] # the point of the test


def test_the_range_of_the_number_holds_where_none_is_given() -> None:
    with pytest.raises(LimitExceeded, match=r"offset 2147483648 counts is outside -2147483648\.\.2147483647 counts"):
        PAIR.encode(0, 2**31)


def test_a_decimal_step_leaves_no_digits_behind() -> None:
    tenths: Register[float] = Register("x", I16, step=0.1, address=1)
    hundredths: Register[float] = Register("x", U16, step=0.01, address=1)
    thirds: Register[float] = Register("x", U16, step=2 / 3, address=1)
    for raw in range(0, 30000, 7):
        data = raw.to_bytes(2, "big")
        assert tenths.decode(data) == float(f"{raw // 10}.{raw % 10}")
        assert hundredths.decode(data) == float(f"{raw // 100}.{raw % 100:02}")
        assert thirds.decode(data) == raw * 2 / 3 or thirds.decode(data) == pytest.approx(raw * 2 / 3)
        for register in (tenths, hundredths, thirds):
            assert register.encode(register.decode(data)) == data


def test_scaled_values() -> None:
    assert SCALED.encode(24.5) == (2450).to_bytes(2, "big")
    assert SCALED.decode(b"\x09\x92") == pytest.approx(24.5)
    with pytest.raises(LimitExceeded, match=r"outside 0\.\.655\.35 V"):
        SCALED.encode(700.0)


def test_choices_are_named() -> None:
    assert COLOUR.decode(b"\x00\x02") is Colour.BLUE
    with pytest.raises(LimitExceeded, match=r"colour 3 is none of RED \(1\), BLUE \(2\)"):
        COLOUR.encode(3)  # type: ignore[arg-type] # the point of the test
    with pytest.raises(ValueError, match="3"):
        COLOUR.decode(b"\x00\x03")


def test_a_value_that_the_table_does_not_name_is_said_with_the_name_of_what_was_read() -> None:
    with pytest.raises(LimitExceeded, match="colour reads 65535, of which the manual says nothing"):
        COLOUR.decode(b"\xff\xff")


def test_flags_combine() -> None:
    flags: Register[Bits] = Register("bits", U16, into=Bits, address=1)
    assert flags.decode(b"\x00\x03") == Bits.A | Bits.B
    assert flags.encode(Bits.A | Bits.B) == b"\x00\x03"


def test_a_block_packs_its_values_in_order() -> None:
    assert PAIR.encode(1, -2) == b"\x01\xff\xff\xff\xfe"
    assert PAIR.decode(b"\x01\xff\xff\xff\xfe") == (1, -2)
    assert PAIR.size == 5


def test_a_block_wants_all_its_values() -> None:
    with pytest.raises(ValueError, match="zip"):
        PAIR.encode(1)


def test_how_many_registers_a_value_takes() -> None:
    assert (SPEED.count, Register("x", I48, address=1).count, Register("x", U8, address=1).count) == (1, 3, 1)


def test_floating_point_numbers() -> None:
    power: Register[float] = Register("power", F32, "W", address=52)
    assert power.encode(1.0) == b"\x3f\x80\0\0"
    assert power.decode(b"\x43\x66\x33\x34") == pytest.approx(230.2)
    energy: Register[float] = Register("energy", F64, "kWh", 0, step=0.001, address=60)
    assert energy.count == 4
    assert energy.decode(energy.encode(12.5)) == 12.5
    with pytest.raises(LimitExceeded, match=r"energy -1 kWh is outside 0\.\."):
        energy.encode(-1)
    with pytest.raises(LimitExceeded, match=r"power 1e\+39 W is outside -3\.40282346639e\+38\.\."):
        power.encode(1e39)
    with pytest.raises(LimitExceeded, match="power nan W is outside"):
        power.encode(float("nan"))


@given(st.sampled_from([F32, F64]), st.data())
def test_a_floating_point_number_comes_back_from_its_bytes(number: Real, data: st.DataObject) -> None:
    value = data.draw(st.floats(allow_nan=False, width=32 if number is F32 else 64))
    assert number.decode(number.encode(value)) == value


def test_the_lowest_register_may_come_first() -> None:
    swapped: Register[int] = Register("counter", U32, word_order="little", address=1)
    assert swapped.encode(0x01020304) == b"\x03\x04\x01\x02"
    assert swapped.decode(b"\x03\x04\x01\x02\xff\xff") == 0x01020304
    real: Register[float] = Register("power", F32, word_order="little", address=1)
    assert real.decode(b"\0\0\x3f\x80") == 1.0
