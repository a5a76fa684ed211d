"""Modbus TCP frames: the specification's example, and answers that are late, torn, foreign or no Modbus TCP at all."""

import random

import pytest

from rs485bus.wire.crc import crc
from rs485bus.wire.frames import read_holding
from rs485bus.wire.mbap import Answer, Mbap, looks_like_mbap


def rtu(text: str) -> bytes:
    content = bytes.fromhex(text)
    return content + crc(content)


def answer(number: int, content: bytes) -> bytes:
    return number.to_bytes(2, "big") + b"\0\0" + len(content).to_bytes(2, "big") + content


JOB, OTHER = object(), object()


def test_a_request_has_the_header_of_the_specification() -> None:
    # Modbus Messaging on TCP/IP V1.0b, 3.1.2: unit FF reads one register.
    assert Mbap().wrap(rtu("FF 03 00 05 00 01"), JOB) == bytes.fromhex("0001 0000 0006 FF 03 00 05 00 01")


def test_an_answer_is_an_rtu_frame_again() -> None:
    mbap = Mbap()
    mbap.wrap(read_holding(1, 0, 1).adu, JOB)
    assert mbap.unwrap(answer(1, bytes.fromhex("01 03 02 12 34"))) == [Answer(rtu("01 03 02 12 34"), JOB)]
    assert mbap.skipped == 0


def test_an_answer_is_known_by_its_number_as_long_as_its_request_is_remembered() -> None:
    mbap = Mbap()
    content = bytes.fromhex("01 03 02 12 34")
    for asked in (OTHER, None, JOB, JOB):
        mbap.wrap(read_holding(1, 0, 1).adu, asked)
    assert [mbap.unwrap(answer(number, content))[0].asked for number in (4, 3, 2, 1, 77)] == [
        JOB,
        JOB,
        None,
        OTHER,
        None,
    ]
    for _ in range(64):
        mbap.wrap(read_holding(1, 0, 1).adu, OTHER)
    assert mbap.unwrap(answer(4, content))[0].asked is None


def test_numbers_begin_anew_after_65535() -> None:
    mbap = Mbap()
    numbers = [int.from_bytes(mbap.wrap(b"\1\3\0\0", JOB)[:2], "big") for _ in range(65_537)]
    assert numbers[65_534:] == [65_535, 1, 2]


def test_answers_may_come_in_any_pieces() -> None:
    content = bytes.fromhex("01 03 02 12 34")
    for size in range(1, 12):
        mbap = Mbap()
        stream = b"".join(answer(int.from_bytes(mbap.wrap(b"\1\3\0\0", JOB)[:2], "big"), content) for _ in range(5))
        pieces = [stream[at : at + size] for at in range(0, len(stream), size)]
        got = [frame for piece in pieces for frame in mbap.unwrap(piece)]
        assert got == [Answer(rtu("01 03 02 12 34"), JOB)] * 5


def test_what_follows_bytes_that_are_no_modbus_tcp_is_found() -> None:
    mbap = Mbap()
    mbap.wrap(read_holding(1, 0, 1).adu, JOB)
    good = answer(1, bytes.fromhex("01 03 02 12 34"))
    assert mbap.unwrap(b"login: " + good) == [Answer(rtu("01 03 02 12 34"), JOB)]
    assert mbap.skipped == 7
    looks_like_a_header = bytes.fromhex("FFFF 7777 0000 0030")
    assert mbap.unwrap(looks_like_a_header + good) == [Answer(rtu("01 03 02 12 34"), JOB)]
    assert mbap.unwrap(good) == [Answer(rtu("01 03 02 12 34"), JOB)]


def test_it_never_raises_and_holds_no_more_than_a_frame() -> None:
    source, mbap = random.Random(1), Mbap()
    mbap.wrap(read_holding(1, 0, 1).adu, JOB)
    for _ in range(3000):
        mbap.unwrap(source.randbytes(source.randrange(64)) if source.random() < 0.5 else bytes(source.randrange(64)))
        assert len(mbap._buffer) <= 6 + 254


@pytest.mark.parametrize("text", ["01 03 02 12 34", "01 83 02", "01 06 00 01 00 02"])
def test_a_gateway_that_answers_in_rtu_is_recognised(text: str) -> None:
    mbap = Mbap()
    assert not mbap.answers_in_rtu
    mbap.unwrap(rtu(text))
    assert mbap.answers_in_rtu
    assert not looks_like_mbap(rtu(text))


def test_a_frame_of_modbus_tcp_is_recognised() -> None:
    assert looks_like_mbap(answer(0x0103, bytes.fromhex("C5 C8 01")))
    assert not looks_like_mbap(b"")
    assert not looks_like_mbap(answer(1, bytes.fromhex("01 03 02 12 34"))[:-1])
