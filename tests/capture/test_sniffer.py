"""Requests and replies found in the bytes of somebody else's pair."""

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rs485bus.bus.capture_lines import Entry, Exchange, Stray
from rs485bus.bus.record import Record
from rs485bus.capture.sniffer import Sniffer
from rs485bus.errors import BusError
from rs485bus.sim import Noise
from rs485bus.wire.crc import crc
from rs485bus.wire.timing import LineSettings
from tests.capture.support import Listener, cell, work
from tests.integration.support import virtual

LINE = LineSettings(baudrate=115200)


def frame(text: str) -> bytes:
    data = bytes.fromhex(text)
    return data + crc(data)


READ, REPLY = frame("09 03 0000 0002"), frame("09 03 04 0001 0002")
WRITE = frame("09 06 0003 0007")


def heard(*pieces: tuple[float, bytes], end: float = 30.0) -> list[Entry]:
    """What a sniffer tells of pieces, each with its time."""
    found: list[Entry] = []
    sniffer = Sniffer(LINE, found.append)
    for at, data in pieces:
        while sniffer.wakes_at < at:
            sniffer.tick(sniffer.wakes_at)
        sniffer.feed(data, at)
    sniffer.end(end)
    return found


def outcomes(found: list[Entry]) -> list[str]:
    return [each.outcome if isinstance(each, Exchange) else "stray" for each in found]


@pytest.mark.parametrize("noise", [Noise(), Noise(lost_reply=0.03), Noise(lost_request=0.03)], ids=str)
@virtual
async def test_it_tells_of_a_bus_what_the_bus_itself_tells(noise: Noise) -> None:
    line = cell(noise, seed=2)
    listener = Listener(line)
    records: list[Record] = []
    with contextlib.suppress(BusError, ExceptionGroup):  # a lost reply may end the work early
        await work(line, records)
    assert len(records) > 100
    exchanges = await listener.finish()
    assert [(each.request, each.reply, each.outcome) for each in exchanges] == [
        (record.request, record.reply, record.outcome) for record in records
    ]
    assert all(abs(each.at - record.sent_at) < 1e-6 for each, record in zip(exchanges, records, strict=True))
    assert listener.sniffer.families == {1: "MKS", 3: "ZLAC", 4: "TL-R"}


def test_a_request_and_its_reply_are_one_exchange() -> None:
    (exchange,) = heard((1.0, READ), (1.005, REPLY))
    assert isinstance(exchange, Exchange)
    assert (exchange.request, exchange.reply, exchange.outcome) == (READ, REPLY, "reply")
    assert exchange.at == pytest.approx(1.0 - LINE.airtime(len(READ)))
    assert exchange.first == pytest.approx(1.005 - LINE.airtime(len(REPLY)))
    assert exchange.ended == pytest.approx(1.005)


def test_a_request_without_a_reply_is_told_when_the_next_one_comes_and_a_repetition_is_counted() -> None:
    found = heard((1.0, READ), (1.2, READ), (1.4, READ), (1.405, REPLY))
    assert outcomes(found) == ["no reply", "no reply", "reply"]
    assert [each.attempt for each in found if isinstance(each, Exchange)] == [1, 2, 3]


def test_exceptions_and_the_refusals_of_mks_drives_are_refusals() -> None:
    run, none = frame("01 10 00F6 0002 04 01 64 012C"), frame("01 10 00F6 0000")
    found = heard((1.0, READ), (1.005, frame("09 83 02")), (2.0, run), (2.005, none))
    assert outcomes(found) == ["refused", "refused"]


def test_a_write_and_the_same_bytes_soon_after_it_are_a_request_and_its_reply() -> None:
    found = heard((1.0, WRITE), (1.004, WRITE), (1.1, WRITE), (1.104, WRITE), (1.2, READ), (1.205, REPLY))
    assert outcomes(found) == ["reply", "reply", "reply"]


def test_a_write_that_is_repeated_after_the_masters_timeout_was_not_answered() -> None:
    found = heard((1.0, READ), (1.005, REPLY), (2.0, WRITE), (2.5, WRITE), (2.504, WRITE), (3.0, READ), (3.005, REPLY))
    assert outcomes(found) == ["reply", "no reply", "reply", "reply"]
    found = heard((1.0, READ), (1.005, REPLY), (2.0, WRITE), (2.5, WRITE), (3.0, WRITE), (4.0, READ), (4.005, REPLY))
    assert outcomes(found) == ["reply", "no reply", "no reply", "no reply", "reply"]


def test_a_late_reply_is_nobodys() -> None:
    other = frame("08 03 0000 0001")
    found = heard((1.0, READ), (1.2, other), (1.205, REPLY), (1.21, frame("08 03 02 0005")))
    assert outcomes(found) == ["no reply", "unasked", "reply"]


def test_a_broadcast_is_not_answered() -> None:
    assert outcomes(heard((1.0, frame("00 06 0001 0001")), (1.2, READ), (1.205, REPLY))) == ["broadcast", "reply"]


def test_what_is_no_frame_is_told_as_bytes_and_what_follows_is_found() -> None:
    found = heard((1.0, bytes.fromhex("00FF13")), (1.001, READ), (1.005, REPLY[:4]), (1.3, READ), (1.305, REPLY))
    assert outcomes(found) == ["stray", "stray", "no reply", "reply"]
    assert [each.data for each in found if isinstance(each, Stray)] == [bytes.fromhex("00FF13"), REPLY[:4]]


def test_frames_behind_garbage_are_found_on_a_pair_that_is_never_quiet_for_long() -> None:
    found: list[Entry] = []
    sniffer = Sniffer(LINE, found.append)
    sniffer.feed(bytes.fromhex("00FF13"), 1.0)
    for at in range(20):
        sniffer.feed(READ if at % 2 == 0 else REPLY, 1.003 + 0.003 * at)
    assert outcomes(found)[:3] == ["stray", "reply", "reply"]


def test_a_frame_of_a_function_that_nobody_knows_is_found_by_silence() -> None:
    own = frame("09 65 010203040506")
    found = heard((1.0, own), (1.5, READ), (1.505, REPLY))
    assert outcomes(found) == ["no reply", "reply"]


@settings(max_examples=60)
@given(st.lists(st.binary(min_size=1, max_size=40), max_size=12), st.data())
def test_no_byte_is_lost_and_none_told_twice_however_they_come(noise: list[bytes], data: st.DataObject) -> None:
    frames = [READ, REPLY, WRITE, WRITE, frame("01 10 0090 0003 05 0001000064"), frame("01 10 0090 0003")]
    pieces = [part for piece in noise for part in (piece, data.draw(st.sampled_from(frames)))]
    stream, at, cut = b"".join(pieces), 1.0, 0
    found: list[Entry] = []
    sniffer = Sniffer(LINE, found.append)
    while cut < len(stream):
        size = data.draw(st.integers(1, 30))
        at += data.draw(st.sampled_from([0.003, 0.1])) + LINE.airtime(size)
        sniffer.feed(stream[cut : cut + size], at)
        cut += size
    sniffer.end(at + 2)
    told = sum(
        len(each.data) if isinstance(each, Stray) else len(each.request) + len(each.reply)
        for each in found
        if isinstance(each, Stray | Exchange)
    )
    assert told == len(stream)
