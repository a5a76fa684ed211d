"""Requests, and which replies fit them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.pdu.bit_message import ReadCoilsRequest, ReadCoilsResponse
from pymodbus.pdu.file_message import ReadFifoQueueRequest, ReadFifoQueueResponse
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersResponse,
    WriteMultipleRegistersRequest,
)

from rs485bus.wire.frames import (
    crc,
    from_pdu,
    payload,
    read_holding,
    read_input,
    registers,
    write_bytes,
    write_multiple,
    write_single,
)

units = st.integers(1, 247)
words = st.integers(0, 0xFFFF)


def test_a_read_expects_its_unit_function_and_byte_count() -> None:
    request = read_input(1, 0x31, 3)
    assert request.adu == bytes.fromhex("01 04 00 31 00 03 E1 C4")
    assert (request.prefix, request.length, request.writes) == (b"\x01\x04\x06", 11, False)


def test_a_write_expects_its_echo() -> None:
    single = write_single(1, 0x82, 5)
    assert (single.prefix, single.length, single.writes) == (single.adu[:6], 8, True)
    many = write_multiple(1, 0xF6, [2, 300])
    assert many.prefix == bytes.fromhex("01 10 00 F6 00 02")


def test_three_registers_in_five_bytes_can_be_written() -> None:
    request = write_bytes(1, 0x90, 3, bytes.fromhex("00 00 00 64 00"))
    assert request.adu == bytes.fromhex("01 10 00 90 00 03 05 00 00 00 64 00 78 92")
    assert request.prefix == bytes.fromhex("01 10 00 90 00 03")


def test_a_hidden_refusal_is_part_of_the_request() -> None:
    assert write_single(1, 0x82, 5, hidden_refusal=True).refusal == bytes.fromhex("01 06 00 82 FF FF")
    assert write_multiple(1, 0xF6, [2, 300], hidden_refusal=True).refusal == bytes.fromhex("01 10 00 F6 00 00")
    assert write_single(1, 0x82, 5).refusal is None


def test_nobody_answers_a_broadcast() -> None:
    assert write_single(0, 1, 2).length == 0


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: read_holding(0, 0, 1), "address 0 is outside 1..247"),
        (lambda: read_holding(248, 0, 1), "address 248 is outside"),
        (lambda: write_single(248, 0, 1), "address 248 is outside 0..247"),
        (lambda: read_holding(1, 0, 0), "count 0 is outside 1..125"),
        (lambda: read_holding(1, 0, 126), "count 126 is outside 1..125"),
        (lambda: read_holding(1, 65535, 2), "registers 65535..65536 are outside"),
        (lambda: read_holding(1, -1, 2), "register address -1 is outside 0..65535"),
        (lambda: write_single(1, 0, 65536), "value 65536 is outside 0..65535"),
        (lambda: write_single(1, 0, -1), "value -1 is outside"),
        (lambda: write_multiple(1, 0, []), "0 registers in one write"),
        (lambda: write_multiple(1, 0, [0] * 124), "124 registers in one write"),
        (lambda: write_bytes(1, 0, 1, b""), "0 data bytes"),
    ],
)
def test_what_no_frame_can_say_is_refused(make: object, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        make()  # type: ignore[operator]


@given(units, words, st.lists(words, min_size=1, max_size=123))
def test_any_write_is_what_pymodbus_makes_of_it(unit: int, register: int, values: list[int]) -> None:
    if register + len(values) > 0x10000:
        return
    request = write_multiple(unit, register, values)
    pdu = WriteMultipleRegistersRequest(address=register, registers=values)
    body = bytes((unit, 16)) + pdu.encode()
    assert request.adu == body + crc(body)


@given(units, st.lists(words, min_size=1, max_size=125))
def test_the_registers_of_any_reply_are_read(unit: int, values: list[int]) -> None:
    body = bytes((unit, 3)) + ReadHoldingRegistersResponse(registers=values).encode()
    reply = body + crc(body)
    assert registers(reply) == values
    assert payload(reply) == body[3:]
    request = read_holding(unit, 0, len(values))
    assert reply.startswith(request.prefix)
    assert len(reply) == request.length


@given(units, units, words, words, words)
def test_only_what_could_be_mistaken_may_answer(one: int, other: int, register: int, value: int, second: int) -> None:
    first, later = write_single(one, register, value), write_single(other, register, second)
    assert first.may_answer(later) is (one == other and value == second)
    assert not first.may_answer(read_holding(one, 0, 1))


def test_other_functions_come_from_pymodbus_with_the_shape_of_their_replies() -> None:
    coils = from_pdu(3, ReadCoilsRequest(address=0, count=10), ReadCoilsResponse)
    assert (coils.prefix, coils.length, coils.writes) == (b"\x03\x01\x02", 7, False)
    fifo = from_pdu(3, ReadFifoQueueRequest(address=7), ReadFifoQueueResponse)
    assert fifo.length == 0
    assert fifo.sizer is not None
    assert not fifo.writes


def test_what_was_asked_before_does_not_excuse_another_type() -> None:
    read_holding(1, 0, 1)
    for address, register, count in ((True, 0, 1), (1, False, 1), (1, 0, 1.0)):
        with pytest.raises(TypeError, match="must be a whole number"):
            read_holding(address, register, count)  # type: ignore[arg-type] # the point of the test
