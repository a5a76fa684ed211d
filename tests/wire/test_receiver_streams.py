"""The receiver beside a simple one that goes through all bytes again for each: the same frames, in linear time."""

import random
import time
import tracemalloc
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rs485bus.wire.answers import sized_as_fifo, sized_as_identification, sized_by_count
from rs485bus.wire.crc import crc, ends_in_crc
from rs485bus.wire.frames import MAX_FRAME
from rs485bus.wire.receiver import Pattern, Receiver

MIB = 1 << 20


def closed(*body: int) -> bytes:
    return bytes(body) + crc(bytes(body))


ANSWER = Pattern(b"\x01\x03\x08", 13, "answer", counts=True)
LONG = Pattern(b"\x01\x03\xfa", 255, "long", counts=True)
REFUSAL = Pattern(b"\x01\x83", 5, "refusal")
WRITTEN = Pattern(b"\x01\x10\x00\x05\x00\x02", 8, "written", counts=True)
LATE = Pattern(b"\x01\x03\x04", 9, "late")
FILE = Pattern(b"\x01\x14", 0, "file", sized_by_count, counts=True)
IDENTITY = Pattern(b"\x01\x2b\x0e", 0, "identity", sized_as_identification)
QUEUE = Pattern(b"\x01\x18", 0, "queue", sized_as_fifo)
OTHER = Pattern(b"\x02\x03\x08", 13, "other")
ECHO = Pattern(b"\x01\x10\x00\x05\x00\x02\x04\x83", 13, "echo", holds=True)
AWAITED = (ANSWER, LONG, WRITTEN, FILE)
BESIDES = (ECHO, REFUSAL, LATE, IDENTITY, QUEUE, OTHER)
EVERY = AWAITED + BESIDES


class Simple:
    """What the receiver should find, written down without a thought of time. It takes one byte at a time."""

    def __init__(self, patterns: Sequence[Pattern[str]]) -> None:
        self.patterns = patterns
        self.stream = b""
        self.start = 0
        self.later: list[tuple[int, int, int, int]] = []
        self.crc_errors = 0
        self.holds = True

    def take(self, byte: int) -> list[tuple[str, bytes]]:
        self.stream += bytes((byte,))
        now = len(self.stream)
        ending = [(begin, index, end) for until, begin, index, end in self.later if until == now]
        ending += [(begin, index, now) for begin, index in self.complete(now)]
        found = []
        for begin, index, end in sorted(ending):
            pattern = self.patterns[index]
            if begin < self.start:
                continue
            if not ends_in_crc(self.stream[begin:end]):
                self.crc_errors += pattern.counts
            elif end == now and (until := self.enclosed(pattern, begin, now)):
                self.later.append((until, begin, index, end))
            else:
                found.append((pattern.key, self.stream[begin:end]))
                self.start = end
                self.holds = self.holds and not pattern.holds
        return found

    def complete(self, now: int) -> list[tuple[int, int]]:
        frames = []
        for index, pattern in enumerate(self.patterns):
            for begin in range(max(self.start, now - MAX_FRAME), now):
                data = self.stream[begin:now]
                if data.startswith(pattern.prefix) and self.length(pattern, data) == len(data):
                    frames.append((begin, index))
        return frames

    def length(self, pattern: Pattern[str], data: bytes) -> int:
        if pattern.sizer is None:
            return pattern.length
        return pattern.sizer(data)

    def enclosed(self, inner: Pattern[str], begin: int, now: int) -> int:
        return max(
            (
                other + pattern.length
                for pattern in self.patterns
                if pattern.sizer is None and ((pattern.holds and self.holds) or (pattern.counts and not inner.counts))
                for other in range(self.start, begin + 1)
                if self.stream[other:now].startswith(pattern.prefix) and other + pattern.length > now
            ),
            default=0,
        )


def answer(data: bytes) -> bytes:
    return closed(*ANSWER.prefix, *data[:8].ljust(8, b"\0"))


def long_answer(data: bytes) -> bytes:
    return closed(*LONG.prefix, *data[:250].rjust(250, b"\0"))


def file(data: bytes) -> bytes:
    return closed(1, 0x14, len(data), *data)


def queue(words: Sequence[int]) -> bytes:
    told = b"".join(word.to_bytes(2, "big") for word in (2 + 2 * len(words), len(words), *words))
    return closed(1, 0x18, *told)


def identity(objects: Sequence[bytes]) -> bytes:
    told = b"".join(bytes((number, len(value))) + value for number, value in enumerate(objects))
    return closed(1, 0x2B, 0x0E, 1, 1, 0, 0, len(objects), *told)


simple_frames = st.one_of(
    st.just(closed(1, 0x83, 2)),
    st.just(closed(*WRITTEN.prefix)),
    st.binary(min_size=4, max_size=4).map(lambda data: closed(*LATE.prefix, *data)),
    st.binary(min_size=3, max_size=3).map(lambda data: closed(*ECHO.prefix, *data)),
    st.binary(min_size=8, max_size=8).map(answer),
)
frames = st.one_of(
    simple_frames,
    simple_frames.map(answer),
    simple_frames.map(lambda inside: closed(*OTHER.prefix, *inside[:8].ljust(8, b"\0"))),
    st.lists(simple_frames, min_size=1, max_size=6).map(lambda inside: long_answer(b"".join(inside))),
    st.lists(simple_frames, max_size=3).map(lambda inside: file(b"".join(inside))),
    st.lists(st.binary(max_size=20), max_size=5).map(identity),
    st.lists(st.integers(0, 0xFFFF), max_size=31).map(queue),
)
torn = st.tuples(frames, st.integers(1, 40)).map(lambda made: made[0][: made[1]])
beginnings = st.tuples(st.sampled_from(EVERY), st.integers(1, 60)).map(lambda made: made[0].prefix * made[1])
noise = st.one_of(st.binary(max_size=12), st.integers(0, 255).map(lambda byte: bytes((byte,)) * 30))
streams = st.lists(st.one_of(frames, frames, torn, beginnings, noise), min_size=1, max_size=8).map(b"".join)


@settings(max_examples=300, deadline=None)
@given(
    streams,
    st.lists(st.integers(1, 300), min_size=1, max_size=30),
    st.sampled_from(AWAITED),
    st.sets(st.sampled_from(BESIDES)),
)
def test_in_any_pieces_it_finds_what_a_simple_search_finds(
    stream: bytes, sizes: list[int], awaited: Pattern[str], besides: set[Pattern[str]]
) -> None:
    patterns = [awaited, *(pattern for pattern in BESIDES if pattern in besides)]
    simple = Simple(patterns)
    expected = [frame for byte in stream for frame in simple.take(byte)]
    whole, pieces = Receiver[str](), Receiver[str]()
    whole.expect(patterns)
    pieces.expect(patterns)
    assert whole.feed(stream) == expected
    found, at = [], 0
    while at < len(stream):
        size = sizes[at % len(sizes)]
        found += pieces.feed(stream[at : at + size])
        at += size
    assert found == expected
    for receiver in (whole, pieces):
        framed = sum(len(frame) for _, frame in expected)
        assert receiver.skipped + receiver.pending == len(stream) - framed
        assert receiver.crc_errors == simple.crc_errors


def test_a_frame_inside_an_awaited_answer_is_a_part_of_it() -> None:
    """A device may hold other frames in its registers: a bus analyser, or a gateway's buffer."""
    reply = answer(closed(1, 0x83, 2))
    for size in (1, 2, 5, 9, 13):
        receiver = Receiver[str]()
        receiver.expect([ANSWER, REFUSAL])
        found = [frame for at in range(0, 13, size) for frame in receiver.feed(reply[at : at + size])]
        assert found == [("answer", reply)]


def test_what_looks_like_an_answer_inside_an_echo_is_a_part_of_it() -> None:
    """It is the program that says what is written. Here the write begins like its own answer."""
    for inside in (closed(*WRITTEN.prefix), b"\0" + closed(1, 0x90, 2), b"\0" + closed(*WRITTEN.prefix)):
        body = inside if inside.startswith(WRITTEN.prefix) else WRITTEN.prefix + inside
        echo = closed(*body.ljust(20, b"\0"))
        answer = closed(*WRITTEN.prefix)
        patterns = [
            Pattern(echo[:8], len(echo), "echo", holds=True),
            WRITTEN,
            Pattern(b"\x01\x90", 5, "refusal"),
        ]
        for size in range(1, len(echo) + 9):
            receiver = Receiver[str]()
            receiver.expect(patterns)
            stream = echo + answer
            found = [frame for at in range(0, len(stream), size) for frame in receiver.feed(stream[at : at + size])]
            assert found == [("echo", echo), ("written", answer)]


def test_a_frame_inside_one_that_is_not_awaited_is_found_in_one_piece_as_in_many() -> None:
    refusal = closed(1, 0x83, 2)
    late = closed(*OTHER.prefix, 0, *refusal, 0, 0)
    for size in (1, 4, len(late)):
        receiver = Receiver[str]()
        receiver.expect([ANSWER, REFUSAL, OTHER])
        found = [frame for at in range(0, len(late), size) for frame in receiver.feed(late[at : at + size])]
        assert found == [("refusal", refusal)]


def test_a_beginning_that_is_not_whole_when_another_frame_ends_holds_nothing() -> None:
    refusal = closed(0x16, 0x96, 2)
    masked = Pattern(b"\x01" + refusal + b"\0\0", 10, "masked", counts=True)
    stream = b"\0" + closed(*masked.prefix)
    for size in (1, len(stream)):
        receiver = Receiver[str]()
        receiver.expect([masked, Pattern(refusal[:2], 5, "refusal")])
        found = [frame for at in range(0, len(stream), size) for frame in receiver.feed(stream[at : at + size])]
        assert found == [("refusal", refusal)]


def test_a_refusal_behind_an_answer_that_broke_off_is_found_once_that_is_clear() -> None:
    refusal = closed(1, 0x83, 2)
    receiver = Receiver[str]()
    receiver.expect([ANSWER, REFUSAL])
    assert receiver.feed(ANSWER.prefix + refusal) == []
    assert receiver.feed(bytes(5)) == [("refusal", refusal)]


def repeated(unit: bytes) -> bytes:
    return (unit * (MIB // len(unit) + 1))[:MIB]


_TABLE = tuple(range(256))

HOSTILE = {
    "beginnings of an answer": ([LONG, REFUSAL], repeated(LONG.prefix)),
    "beginnings of a refusal": ([ANSWER, REFUSAL], repeated(REFUSAL.prefix)),
    "beginnings of many": (
        [Pattern(bytes((unit, 3, 2)), 7, "late") for unit in range(1, 12)]
        + [Pattern(bytes((unit, 0x83)), 5, "late") for unit in range(1, 12)],
        repeated(bytes(byte for unit in range(1, 12) for byte in (unit, 3, 2))),
    ),
    "refusals inside answers": ([LONG, REFUSAL], repeated(LONG.prefix + closed(1, 0x83, 2))),
    "beginnings that claim any length": ([FILE, REFUSAL], repeated(FILE.prefix)),
    "beginnings that claim much": ([FILE, REFUSAL], repeated(FILE.prefix + b"\xf0")),
    "beginnings of queues": ([QUEUE, REFUSAL], repeated(b"\x01\x18\x00\xf0")),
    "beginnings of an identification": ([IDENTITY, REFUSAL], repeated(IDENTITY.prefix)),
    "identifications of many objects": ([IDENTITY, REFUSAL], repeated(bytes.fromhex("012b0e010100007c"))),
    "identifications of fewer objects": ([IDENTITY, REFUSAL], repeated(bytes.fromhex("012b0e010100"))),
    "noise": ([LONG, REFUSAL], random.Random(485).randbytes(MIB)),
    "zeros": ([LONG, REFUSAL], bytes(MIB)),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_mebibyte_of_anything_takes_less_than_a_second_in_one_piece_or_in_many(name: str) -> None:
    """A quarter of that in a quarter of the time. The machine may be busy: so once of three times is enough, and one
    that is slow just now has as much longer."""
    patterns, stream = HOSTILE[name]
    assert any(seconds(patterns, stream[: MIB // 4], MIB) < a_quarter() for _ in range(3))
    assert any(seconds(patterns, stream[: MIB // 16], 32) < a_quarter() for _ in range(3))


def a_quarter() -> float:
    """A quarter of a second, where a step for each byte of a quarter of a mebibyte takes the 24th part of it; or as
    much longer as that takes just now."""
    begun, state = time.process_time(), 0
    for byte in HOSTILE["noise"][1][: MIB // 4]:
        state = (state >> 8) ^ _TABLE[(state ^ byte) & 0xFF]
    return max(0.25, 24 * (time.process_time() - begun))


def seconds(patterns: Sequence[Pattern[str]], stream: bytes, piece: int) -> float:
    """What it takes to feed a stream in pieces of so many bytes."""
    receiver = Receiver[str]()
    receiver.expect(patterns)
    begun = time.process_time()
    for at in range(0, len(stream), piece):
        receiver.feed(stream[at : at + piece])
    return time.process_time() - begun


@pytest.mark.parametrize("name", ["beginnings of a refusal", "beginnings that claim much", "noise"])
def test_whatever_comes_in_one_piece_is_not_held(name: str) -> None:
    patterns, stream = HOSTILE[name]
    stream = stream[: MIB // 8]
    receiver = Receiver[str]()
    receiver.expect(patterns)
    tracemalloc.start()
    try:
        assert receiver.feed(stream) == []
        assert tracemalloc.get_traced_memory()[1] < MIB // 8
    finally:
        tracemalloc.stop()
    assert receiver.pending < MAX_FRAME


def test_a_piece_of_a_mebibyte_that_ends_in_the_answer_still_gives_it() -> None:
    reply = long_answer(b"\x01")
    receiver = Receiver[str]()
    receiver.expect([LONG, REFUSAL])
    assert receiver.feed(repeated(LONG.prefix) + reply) == [("long", reply)]
