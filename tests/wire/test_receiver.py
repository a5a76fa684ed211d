"""The receiver: what is waited for is found, whatever stands around it."""

import random
import time

from hypothesis import given
from hypothesis import strategies as st

from rs485bus.wire.frames import MAX_FRAME, crc, read_holding, read_input, write_single
from rs485bus.wire.receiver import Pattern, Receiver


def closed(body: bytes) -> bytes:
    return body + crc(body)


def waiting_for(*bodies: bytes) -> Receiver[int]:
    receiver: Receiver[int] = Receiver()
    receiver.expect([Pattern(body[:3], len(body) + 2, index, counts=True) for index, body in enumerate(bodies)])
    return receiver


BODY = bytes.fromhex("01 04 06 00 00 00 02 7F FF")
REPLY = closed(BODY)


def test_a_reply_is_found_whole() -> None:
    assert waiting_for(BODY).feed(REPLY) == [(0, REPLY)]


def test_a_reply_is_found_byte_by_byte() -> None:
    receiver = waiting_for(BODY)
    found = [frame for byte in REPLY for frame in receiver.feed(bytes([byte]))]
    assert found == [(0, REPLY)]
    assert receiver.skipped == 0


def test_a_reply_glued_behind_a_foreign_frame_is_found() -> None:
    foreign = closed(bytes.fromhex("02 04 06 00 00 00 02 7F FF"))
    receiver = waiting_for(BODY)
    assert receiver.feed(foreign + REPLY) == [(0, REPLY)]
    assert receiver.skipped == len(foreign)


def test_a_reply_behind_a_torn_copy_of_itself_is_found() -> None:
    receiver = waiting_for(BODY)
    assert receiver.feed(REPLY[:7]) == []
    assert receiver.feed(REPLY) == [(0, REPLY)]
    assert receiver.crc_errors == 1


def test_a_wrong_length_is_not_accepted() -> None:
    shorter = closed(bytes.fromhex("01 04 04 00 00 02 7F"))
    assert waiting_for(BODY).feed(shorter + bytes(20)) == []


def test_a_bad_crc_is_counted_and_passed_over() -> None:
    receiver = waiting_for(BODY)
    assert receiver.feed(REPLY[:-1] + b"\0") == []
    assert receiver.crc_errors == 1
    assert receiver.feed(REPLY) == [(0, REPLY)]


def test_two_frames_in_one_chunk_come_in_their_order() -> None:
    other = closed(bytes.fromhex("07 04 02 00 01"))
    receiver = waiting_for(BODY, other[:-2])
    assert [key for key, _ in receiver.feed(other + REPLY + other)] == [1, 0, 1]


def test_what_came_before_expecting_is_given_up() -> None:
    receiver = waiting_for(BODY)
    receiver.feed(REPLY[:5])
    receiver.expect([Pattern(BODY[:3], len(REPLY), 0)])
    assert receiver.feed(REPLY[5:]) == []
    assert receiver.skipped >= 5


def test_only_what_begins_like_a_frame_waited_for_has_begun() -> None:
    receiver = waiting_for(BODY)
    for noise in (b"\0\0\0\0", REPLY[1:]):
        receiver.feed(noise)
        assert receiver.begun == 0
    assert receiver.rest == b"\0\0\0\0" + REPLY[1:]
    receiver.feed(REPLY[:4])
    assert receiver.begun == 4
    receiver.feed(REPLY[4:])
    assert receiver.begun == 0


def test_what_began_inside_a_frame_has_not_begun_once_that_is_found() -> None:
    body = BODY[:3] + BODY[:3] + bytes(3)
    receiver = waiting_for(BODY)
    assert receiver.feed(closed(body)[:7]) == []
    assert receiver.feed(closed(body)[7:] + b"\0") == [(0, closed(body))]
    assert receiver.begun == 0


def test_a_variable_reply_is_found_behind_a_beginning_that_never_ends() -> None:
    def told(data: bytes) -> int:
        return data[2] + 5 if len(data) > 2 else 0

    receiver: Receiver[str] = Receiver()
    receiver.expect([Pattern(b"\x01\x18", 0, "fifo", told)])
    reply = closed(b"\x01\x18\x02\x12\x34")
    assert receiver.feed(b"\x01\x18\xf0" + reply) == [("fifo", reply)]


def test_a_sizer_that_fails_on_bytes_never_raises_out() -> None:
    def told(data: bytes) -> int:
        raise ValueError(data)

    receiver: Receiver[str] = Receiver()
    receiver.expect([Pattern(b"\x01\x18", 0, "fifo", told)])
    for _ in range(100):
        assert receiver.feed(b"\x01\x18" * 10) == []
    assert len(receiver._buffer) <= MAX_FRAME


@given(st.lists(st.binary(max_size=40), max_size=8), st.binary(max_size=30))
def test_any_noise_in_any_pieces_before_the_reply_leaves_it_found(pieces: list[bytes], last: bytes) -> None:
    receiver = waiting_for(BODY)
    found = [frame for piece in [*pieces, last, REPLY] for frame in receiver.feed(piece)]
    assert found[-1:] == [(0, REPLY)]


@given(st.binary(max_size=200), st.integers(0, 200))
def test_the_pieces_in_which_bytes_arrive_change_nothing(data: bytes, cut: int) -> None:
    stream = data[:cut] + REPLY + data[cut:] + REPLY
    whole, bytewise = waiting_for(BODY), waiting_for(BODY)
    once = whole.feed(stream)
    assert [frame for byte in stream for frame in bytewise.feed(bytes([byte]))] == once
    assert bytewise.crc_errors == whole.crc_errors


@given(st.integers(0, 8 * len(REPLY) - 1), st.integers(0, 8 * len(REPLY) - 1), st.integers(0, 8 * len(REPLY) - 1))
def test_up_to_three_flipped_bits_are_never_accepted(a: int, b: int, c: int) -> None:
    value = int.from_bytes(REPLY, "big")
    for bit in {a, b, c}:
        value ^= 1 << bit
    assert waiting_for(BODY).feed(value.to_bytes(len(REPLY), "big")) == []


def test_ten_million_random_bytes_neither_raise_nor_slow_down_nor_grow() -> None:
    request = read_holding(1, 0, 3)
    echo = write_single(1, 2, 3)
    receiver: Receiver[int] = Receiver()
    receiver.expect(
        [Pattern(request.prefix, request.length, 0), Pattern(echo.prefix, 8, 1), Pattern(b"\x01\x83", 5, 2)]
    )
    rng = random.Random(485)
    chunk = rng.randbytes(1_000_000)
    times = []
    for _ in range(10):
        start = time.process_time()
        for at in range(0, len(chunk), 4096):
            receiver.feed(chunk[at : at + 4096])
        times.append(time.process_time() - start)
        assert len(receiver._buffer) <= MAX_FRAME
    assert min(times[5:]) < 3 * min(times[:5])


def test_bytes_that_all_look_like_beginnings_stay_bounded() -> None:
    request = read_input(1, 0, 60)
    receiver: Receiver[int] = Receiver()
    receiver.expect([Pattern(request.prefix, request.length, 0)])
    for _ in range(200):
        receiver.feed(request.prefix * 50)
        assert len(receiver._buffer) <= MAX_FRAME
