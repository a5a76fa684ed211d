"""Frames in words."""

import pytest

from rs485bus.bus.capture_lines import Exchange
from rs485bus.capture import words_of
from rs485bus.capture.pdu import spoken
from rs485bus.capture.vocabulary import family_of
from rs485bus.wire.crc import crc


def frame(text: str) -> bytes:
    data = bytes.fromhex(text)
    return data + crc(data)


def said(family: str | None, request: str, reply: str = "", outcome: str = "reply") -> tuple[str, str, bool, str]:
    adu = frame(request)
    return words_of(Exchange(0.0, 0.01, adu[0], adu, frame(reply) if reply else b"", outcome), family)


@pytest.mark.parametrize(
    ("family", "request_", "reply", "asked", "answered", "purpose"),
    [
        ("MKS", "01 04 0031 0003", "01 04 06 FFFFFFFFC000", "read position", "-16384 counts", "poll"),
        ("MKS", "01 04 00F1 0001", "01 04 02 0004", "read motor status", "full speed", "poll"),
        ("MKS", "01 06 00F3 0001", "01 06 00F3 0001", "write enable yes", "done", "command"),
        ("MKS", "01 06 00F7 0001", "01 06 00F7 0001", "write emergency stop 1", "done", "stop"),
        (
            "MKS",
            "01 10 00F6 0002 04 01 64 012C",
            "01 10 00F6 0002",
            "write speed, direction cw, acceleration 100, speed 300 rpm",
            "done",
            "command",
        ),
        (
            "MKS",
            "01 10 00F6 0002 04 00 64 0000",
            "01 10 00F6 0002",
            "write speed, direction ccw, acceleration 100, speed 0 rpm",
            "done",
            "stop",
        ),
        (
            "ZLAC",
            "03 03 20AB 0002",
            "03 03 04 0258 FF9C",
            "read left velocity, right velocity",
            "left velocity 60 rpm, right velocity -10 rpm",
            "poll",
        ),
        ("ZLAC", "03 06 200E 0005", "03 06 200E 0005", "write control word emergency stop", "done", "stop"),
        ("ZLAC", "03 10 2088 0002 04 0000 0000", "03 10 2088 0002", None, "done", "stop"),
        ("ZLAC", "03 06 2088 003C", "03 06 2088 003C", None, "done", "command"),
        ("TL-R", "04 06 004E 0020", "04 06 004E 0020", "write control word stop", "done", "stop"),
        ("TL-R", "04 03 0008 0002", "04 03 04 0000 0FA0", "read position", "4000 pulses", "poll"),
        ("TL-R", "04 03 0003 0002", "04 03 04 0007 0010", "read 0x03, status", "0x03 7, status enabled", "poll"),
        (None, "09 03 0000 0002", "09 03 04 0001 FFFF", "read 2 holding registers at 0x00", "1 65535", "poll"),
        (None, "09 01 0010 0004", "09 01 01 05", "read 4 coils at 0x10", "1010", "poll"),
        (None, "09 05 0010 FF00", "09 05 0010 FF00", "write coil at 0x10 = on", "done", "command"),
        (None, "09 10 0001 0002 04 0005 0006", "09 10 0001 0002", "write 2 registers at 0x01 = 5 6", "done", "command"),
        (None, "09 07", "09 07 05", "read exception status", "05", "command"),
    ],
)
def test_what_is_asked_and_answered_is_said_by_the_familys_names(
    family: str | None, request_: str, reply: str, asked: str | None, answered: str, purpose: str
) -> None:
    words = said(family, request_, reply)
    assert asked is None or words[0] == asked
    assert words[1:] == (answered, False, purpose)


@pytest.mark.parametrize(
    ("family", "request_", "reply", "outcome", "answered"),
    [
        (None, "09 06 0028 0001", "09 86 02", "refused", "REFUSED: exception 02, illegal register address"),
        ("MKS", "01 10 00F6 0002 04 01 64 012C", "01 10 00F6 0000", "refused", "REFUSED inside a normal reply"),
        ("ZLAC", "03 06 200E 0005", "03 86 03", "refused", "REFUSED: exception 03, illegal value"),
        (None, "09 03 0000 0002", "", "no reply", "NO REPLY"),
        (None, "09 03 0000 0002", "", "cut", "CUT for a stop"),
    ],
)
def test_what_went_wrong_is_marked(family: str | None, request_: str, reply: str, outcome: str, answered: str) -> None:
    words = said(family, request_, reply, outcome)
    assert words[1] == answered
    assert words[2]


def test_a_refused_stop_of_an_mks_drive_is_no_error() -> None:
    words = said("MKS", "01 10 00F6 0002 04 01 64 0000", "01 10 00F6 0000", "refused")
    assert words[1:] == ("it was not moving", False, "stop")


def test_a_value_that_no_manual_names_is_shown_as_bytes() -> None:
    assert said("MKS", "01 04 00F1 0001", "01 04 02 0063")[1] == "00 63"


def test_a_broadcast_stop_is_a_stop() -> None:
    assert said(None, "00 06 00F7 0001", outcome="broadcast")[3] == "stop"
    assert not said(None, "00 06 00F7 0001", outcome="broadcast")[2]


def test_the_bus_knows_better_what_a_frame_was_sent_for() -> None:
    adu = frame("01 04 00F1 0001")
    assert words_of(Exchange(0.0, 0.1, 1, adu, b"", "no reply", "feed"), "MKS").purpose == "feed"


def test_a_frame_that_nobody_asked_for_is_an_error() -> None:
    words = words_of(Exchange(0.0, 0.1, 5, b"", frame("05 04 02 0001"), "unasked"), None)
    assert words.error
    assert "05 04 02 00 01" in words.answered


@pytest.mark.parametrize(
    ("requests", "family"),
    [
        (["01 04 0031 0003"], "MKS"),
        (["01 04 00F1 0001", "01 06 00F3 0001"], "MKS"),
        (["03 03 20A2 000D"], "ZLAC"),
        (["04 06 004E 0000", "04 03 0004 0007"], "TL-R"),
        (["04 03 0004 0007"], None),
        (["09 03 0000 0002"], None),
        (["09 04 0000 0002", "09 04 0031 0003"], None),
        ([], None),
    ],
)
def test_a_drive_is_recognised_by_what_it_answers(requests: list[str], family: str | None) -> None:
    assert family_of(spoken(frame(request)) for request in requests) == family


@pytest.mark.parametrize("length", range(2, 16))
def test_a_request_of_any_bytes_is_said_somehow(length: int) -> None:
    for function in range(256):
        adu = bytes((1, function)) + bytes(length)
        for family in (None, "MKS", "ZLAC", "TL-R"):
            assert words_of(Exchange(0.0, 0.1, 1, adu, adu, "reply"), family).asked
