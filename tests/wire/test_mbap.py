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


def test_on_a_new_connection_numbers_go_on_and_answers_kept_of_the_one_before_answer_nothing() -> None:
    before = Mbap()
    before.wrap(read_holding(1, 0, 1).adu, JOB)
    mbap = Mbap(before)
    assert mbap.wrap(read_holding(1, 5, 1).adu, OTHER)[:2] == b"\0\2"
    stale, fresh = (answer(number, bytes.fromhex("01 03 02 12 34")) for number in (1, 2))
    assert [found.asked for found in mbap.unwrap(stale + fresh)] == [None, OTHER]


ANSWERED = bytes.fromhex("01 03 02 12 34")
COMPLAINTS = [
    (answer(2, ANSWERED), "under transaction numbers that were not asked under (2 was the latest)"),
    (answer(0, ANSWERED), "not asked under (0 was"),
    (b"\0\1\0\1\0\5" + ANSWERED, "no header of Modbus TCP (00 01 00 01 00 05 01 03 ...)"),
    (b"\0\1\0\0\0\0" + ANSWERED, "no header of Modbus TCP (00 01 00 00 00 00 01 03 ...)"),
    (b"\0\1\0\0\0\x09" + ANSWERED, "an answer says that 9 bytes follow its header, and 5 did"),
]


@pytest.mark.parametrize(("came", "said"), COMPLAINTS)
def test_an_answer_that_does_not_keep_to_modbus_tcp_is_described_until_one_does(came: bytes, said: str) -> None:
    mbap = Mbap()
    mbap.wrap(read_holding(1, 0, 1).adu, JOB)
    assert mbap.complaint == ""
    mbap.unwrap(came)
    assert said in mbap.complaint
    mbap.unwrap(bytes(8) + answer(1, ANSWERED) * 2)
    assert mbap.complaint == ""
