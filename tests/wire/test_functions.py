"""Requests by all public functions: what no frame can say is refused, and every reply is found in any stream."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus.wire import diagnostics, functions
from rs485bus.wire.answers import Answer
from rs485bus.wire.diagnostics import Diagnostic, ReadCode
from rs485bus.wire.frames import MAX_FRAME, Request, private, public, read_holding, read_input, write_multiple
from rs485bus.wire.frames import write_single as write_register
from tests.wire.support import closed, listening

REFUSED: list[tuple[Callable[[], Any], str]] = [
    (lambda: functions.read_coils(1, 0, 0), r"count 0 is outside 1\.\.2000"),
    (lambda: functions.read_coils(1, 0, 2001), r"count 2001 is outside 1\.\.2000"),
    (lambda: functions.read_coils(1, 65535, 2), r"coils 65535\.\.65536 are outside 0\.\.65535"),
    (lambda: functions.read_discrete(1, -1, 2), "input address -1 is outside"),
    (lambda: functions.read_coils(248, 0, 1), r"address 248 is outside 0\.\.247"),
    (lambda: functions.write_coil(1, 65536, True), "coil address 65536 is outside"),
    (lambda: functions.write_coil(1, 0, 2), "coil value must be True or False, not 2"),  # type: ignore[arg-type]
    (lambda: functions.write_coils(1, 0, []), r"0 coils in one write; 1\.\.1968 fit"),
    (lambda: functions.write_coils(1, 0, [True] * 1969), "1969 coils in one write"),
    (lambda: functions.write_coils(1, 0, 5), r"values must be a sequence of coil values"),  # type: ignore[arg-type]
    (lambda: functions.write_coils(1, 0, [5]), "coil value must be True or False, not 5"),  # type: ignore[list-item]
    (lambda: functions.write_coils(1, 65530, [True] * 7), r"coils 65530\.\.65536 are outside"),
    (lambda: functions.mask_write(1, 0, 0x10000, 0), "and_mask 65536 is outside"),
    (lambda: functions.mask_write(1, 0, 0, -1), "or_mask -1 is outside"),
    (lambda: functions.read_write(1, 0, 126, 0, [1]), r"count 126 is outside 1\.\.125"),
    (lambda: functions.read_write(1, 0, 1, 0, [1] * 122), "122 registers in one write"),
    (lambda: functions.read_fifo(1, 70000), "register address 70000 is outside"),
    (lambda: functions.read_files(1, []), "name the records"),
    (lambda: functions.read_files(1, [(0, 0, 1)]), "file number 0 is outside"),
    (lambda: functions.read_files(1, [(1, 10000, 1)]), r"record number 10000 is outside 0\.\.9999"),
    (lambda: functions.read_files(1, [(1, 0, 122)]), r"length 122 is outside 1\.\.121"),
    (lambda: functions.read_files(1, [(1, 0, 61), (1, 0, 60)]), "the reply would hold 246 bytes of records; 245 fit"),
    (lambda: functions.read_files(1, [(1, 0, 1)] * 36), "the request would hold 252 bytes"),
    (lambda: functions.write_files(1, []), "name the records"),
    (lambda: functions.read_files(1, [(1, 2)]), r"records must be made like \[\(file, record, length\)\]"),  # type: ignore[list-item]
    (lambda: functions.read_files(1, 5), r"records must be made like .*, not 5"),  # type: ignore[arg-type]
    (lambda: functions.write_files(1, [1]), r"records must be made like \[\(file, record, values\)\]"),  # type: ignore[list-item]
    (lambda: functions.write_files(1, [(1, 0, [1] * 123)]), "123 registers in one write"),
    (lambda: functions.write_files(1, [(1, 0, [1] * 61), (1, 0, [1] * 58)]), "the request would hold 252 bytes"),
    (lambda: diagnostics.diagnostic(1, 5), "subfunction 5 is none of QUERY_DATA"),  # type: ignore[arg-type]
    (lambda: diagnostics.diagnostic(1, Diagnostic.QUERY_DATA, b""), "0 data bytes in one query"),
    (lambda: diagnostics.diagnostic(1, Diagnostic.QUERY_DATA, bytes(251)), "251 data bytes in one query"),
    (lambda: diagnostics.diagnostic(1, Diagnostic.CLEAR_COUNTERS, 65536), "diagnostic data 65536 is outside"),
    (lambda: diagnostics.identification(1, 5), "read_code 5 is none of BASIC"),  # type: ignore[arg-type]
    (lambda: diagnostics.identification(1, ReadCode.SPECIFIC, 256), "object_id 256 is outside"),
    (lambda: public(1, 65, b""), "function 65 is no public one: say how it is answered"),
    (
        lambda: private(1, 65, bytes(253), Answer(b"\1\x41", 0), writes=True),
        "a frame of 257 bytes; the longest",
    ),
]


@pytest.mark.parametrize(("make", "said"), REFUSED)
def test_what_no_frame_can_say_is_refused_before_anything_is_sent(make: Callable[[], Any], said: str) -> None:
    with pytest.raises((ValueError, TypeError), match=said):
        make()


def test_the_largest_of_each_fits_a_frame() -> None:
    for request in (
        functions.read_coils(1, 0, 2000),
        functions.read_write(1, 0, 125, 0, [0xFFFF] * 121),
        functions.write_coils(1, 0, [True] * 1968),
        functions.read_files(1, [(1, 0, 121)]),
        functions.read_files(1, [(1, 0, 1)] * 35),
        functions.write_files(1, [(1, 0, [1] * 122)]),
        diagnostics.diagnostic(1, Diagnostic.QUERY_DATA, bytes(250)),
    ):
        assert max(len(request.adu), request.length) <= MAX_FRAME


def test_reserved_addresses_are_reached_where_they_are_allowed() -> None:
    assert write_register(250, 0x8B, 1, highest=255).adu[:2] == b"\xfa\x06"
    assert functions.read_coils(255, 0, 1, highest=255).address == 255
    with pytest.raises(ValueError, match=r"address 250 is outside 0\.\.247"):
        write_register(250, 0x8B, 1)
    with pytest.raises(ValueError, match=r"address 256 is outside 1\.\.255"):
        read_holding(256, 0, 1, highest=255)


def test_what_changes_nothing_is_told_from_what_may() -> None:
    asks = {Diagnostic.QUERY_DATA, Diagnostic.DIAGNOSTIC_REGISTER, *(item for item in Diagnostic if 11 <= item <= 19)}
    assert {item for item in Diagnostic if not diagnostics.diagnostic(1, item).writes} == asks
    assert not functions.read_fifo(1, 0).writes
    assert not functions.read_files(1, [(1, 0, 1)]).writes
    assert not diagnostics.identification(1).writes
    assert functions.write_files(1, [(1, 0, [1])]).writes
    assert functions.read_write(1, 0, 1, 0, [1]).writes


def test_nobody_answers_listen_only() -> None:
    request = diagnostics.diagnostic(1, Diagnostic.FORCE_LISTEN_ONLY)
    assert (request.length, request.sizer) == (0, None)


# Every reply in any stream

words = st.integers(0, 0xFFFF)
units = st.integers(1, 247)


def _packed(values: list[int]) -> bytes:
    return b"".join(value.to_bytes(2, "big") for value in values)


def _counted(data: bytes) -> bytes:
    return bytes((len(data),)) + data


@st.composite
def exchanges(draw: st.DrawFn) -> tuple[Request, bytes]:
    """A request by any public function, and a reply of a device that obeys the specification."""
    unit, at = draw(units), draw(st.integers(0, 60000))
    few = draw(st.lists(words, min_size=1, max_size=20))
    some = draw(st.binary(min_size=1, max_size=60))
    count = len(few)
    reads: dict[int, tuple[Request, bytes]] = {
        1: (functions.read_coils(unit, at, count), _counted(some.ljust(3, b"\0")[: (count + 7) // 8])),
        2: (functions.read_discrete(unit, at, count), _counted(some.ljust(3, b"\0")[: (count + 7) // 8])),
        3: (read_holding(unit, at, count), _counted(_packed(few))),
        4: (read_input(unit, at, count), _counted(_packed(few))),
        5: (functions.write_coil(unit, at, True), at.to_bytes(2, "big") + b"\xff\0"),
        6: (write_register(unit, at, few[0]), _packed([at, few[0]])),
        7: (diagnostics.exception_status(unit), some[:1]),
        8: (diagnostics.diagnostic(unit, Diagnostic.BUS_MESSAGE_COUNT), _packed([11, few[0]])),
        108: (diagnostics.diagnostic(unit, Diagnostic.QUERY_DATA, some), b"\0\0" + some),
        11: (diagnostics.event_counter(unit), _packed([0, few[0]])),
        12: (diagnostics.event_log(unit), _counted(_packed([0, 1, 2]) + some)),
        15: (functions.write_coils(unit, at, [True] * count), _packed([at, count])),
        16: (write_multiple(unit, at, few), _packed([at, count])),
        17: (diagnostics.server_id(unit), _counted(some)),
        20: (functions.read_files(unit, [(1, 2, count)]), _counted(_counted(b"\6" + _packed(few)))),
        21: (
            functions.write_files(unit, [(1, 2, few)]),
            _counted(b"\6" + _packed([1, 2, count, *few])),
        ),
        22: (functions.mask_write(unit, at, few[0], count), _packed([at, few[0], count])),
        23: (functions.read_write(unit, at, count, at, few), _counted(_packed(few))),
        24: (functions.read_fifo(unit, at), _packed([2 + 2 * count, count, *few])),
        43: (
            diagnostics.identification(unit),
            b"\x0e\x01\x81\0\0\2\0" + _counted(some) + b"\1" + _counted(some[:7]),
        ),
    }
    request, data = reads[draw(st.sampled_from(sorted(reads)))]
    return request, closed(bytes((unit, request.function)) + data)


@given(exchanges(), st.data())
def test_a_reply_in_pieces_is_found_once(exchange: tuple[Request, bytes], data: st.DataObject) -> None:
    request, reply = exchange
    receiver = listening(request)
    cut = data.draw(st.integers(0, len(reply)))
    found = receiver.feed(reply[:cut]) + receiver.feed(reply[cut:])
    assert found == [("reply", reply)]
    assert receiver.skipped == 0


@given(exchanges(), st.data())
def test_a_torn_reply_is_none_and_hides_no_whole_one(exchange: tuple[Request, bytes], data: st.DataObject) -> None:
    request, reply = exchange
    receiver = listening(request)
    torn = reply[: data.draw(st.integers(1, len(reply) - 1))]
    assert receiver.feed(torn) == []
    assert receiver.feed(reply + bytes(MAX_FRAME)) == [("reply", reply)]


@given(exchanges())
def test_a_doubled_reply_is_found_twice(exchange: tuple[Request, bytes]) -> None:
    request, reply = exchange
    assert listening(request).feed(reply + reply) == [("reply", reply)] * 2


@given(exchanges(), st.data())
def test_a_damaged_reply_is_none(exchange: tuple[Request, bytes], data: st.DataObject) -> None:
    request, reply = exchange
    flipped = int.from_bytes(reply, "big")
    for _ in range(data.draw(st.integers(1, 3))):
        flipped ^= 1 << data.draw(st.integers(0, 8 * len(reply) - 1))
    damaged = flipped.to_bytes(len(reply), "big")
    assert [frame for _, frame in listening(request).feed(damaged)] in ([], [reply])


@given(exchanges(), exchanges(), st.data())
def test_frames_of_others_around_a_reply_are_passed_over(
    exchange: tuple[Request, bytes], foreign: tuple[Request, bytes], data: st.DataObject
) -> None:
    request, reply = exchange
    other = foreign[1]
    if other[0] == request.address:
        other = closed(bytes((other[0] % 247 + 1,)) + other[1:-2])
    found = listening(request).feed(other + reply + other + reply)
    assert found == [("reply", reply)] * 2


@given(exchanges(), st.binary(max_size=300))
def test_noise_of_any_kind_neither_raises_nor_grows(exchange: tuple[Request, bytes], noise: bytes) -> None:
    request, reply = exchange
    receiver = listening(request)
    for piece in (reply[:2] + noise, noise, reply[:4]):
        receiver.feed(piece)
        assert receiver.pending <= 2 * MAX_FRAME
    assert ("reply", reply) in receiver.feed(bytes(MAX_FRAME) + reply)
