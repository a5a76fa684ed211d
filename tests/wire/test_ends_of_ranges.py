"""What lies exactly at an end of a range, and what lies one step behind it."""

from __future__ import annotations

import pytest

from rs485bus.errors import LimitExceeded
from rs485bus.wire import convert, functions
from rs485bus.wire.frames import public, read_holding, write_bytes, write_multiple
from rs485bus.wire.registers import I16, Register


def test_the_last_register_can_be_read_and_written_but_none_behind_it() -> None:
    assert read_holding(1, 0xFFFF, 1).adu[2:6] == bytes.fromhex("FF FF 00 01")
    assert read_holding(1, 0xFF83, 125).adu[2:6] == bytes.fromhex("FF 83 00 7D")
    assert write_multiple(1, 0xFFFE, [1, 2]).adu[2:6] == bytes.fromhex("FF FE 00 02")
    for register, count in ((0xFFFF, 2), (0xFF84, 125)):
        with pytest.raises(ValueError, match=r"outside 0\.\.65535"):
            read_holding(1, register, count)


@pytest.mark.parametrize(("coils", "data"), [(7, "01 7F"), (8, "01 FF"), (9, "02 FF 01"), (16, "02 FF FF")])
def test_coils_fill_whole_bytes_and_no_more(coils: int, data: str) -> None:
    assert functions.write_coils(1, 0, [True] * coils).adu[6:-2] == bytes.fromhex(data)


def test_as_many_bytes_are_written_as_fit_a_frame() -> None:
    assert len(write_bytes(1, 0, 123, bytes(246)).adu) == 255
    for size in (0, 247):
        with pytest.raises(ValueError, match=r"1\.\.246 fit a frame"):
            write_bytes(1, 0, 123, bytes(size))


def test_a_register_in_steps_takes_what_its_number_holds() -> None:
    register = Register("angle", I16, "°", step=0.1, address=0)
    assert register.encode(-3276.8) == (-32768).to_bytes(2, "big", signed=True)
    assert register.encode(3276.7) == (32767).to_bytes(2, "big")
    for value in (-3276.9, 3276.8):
        with pytest.raises(LimitExceeded, match=r"-3276\.8\.\.3276\.7"):
            register.encode(value)


def test_bits_and_words_lie_where_pymodbus_puts_them() -> None:
    bits = [False] * 16
    bits[1] = bits[8] = True
    assert convert.convert_to_registers(bits, convert.DataType.BITS) == [0x0201]
    assert convert.convert_to_registers(0x11112222, convert.DataType.UINT32, word_order="little") == [0x2222, 0x1111]
    assert convert.convert_to_registers(0x11112222, convert.DataType.UINT32, word_order="big") == [0x1111, 0x2222]


def test_only_the_echo_of_a_loopback_is_its_answer_and_a_counter_is_any_number() -> None:
    loopback, counter = public(1, 8, b"\0\0\xa5\x37"), public(1, 8, b"\0\x0b\0\0")
    assert loopback.prefix == loopback.adu[:-2]
    assert counter.prefix == counter.adu[:4]
