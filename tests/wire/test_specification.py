"""The examples of the specification (Modbus Application Protocol V1.1b3, chapter 6 and 7), byte for byte."""

from collections.abc import Callable
from typing import Any, NamedTuple

import pytest

from rs485bus.wire import diagnostics, functions
from rs485bus.wire.diagnostics import Diagnostic, EventCounter, EventLog
from rs485bus.wire.frames import Request, read_holding, read_input, registers, write_multiple, write_single
from rs485bus.wire.functions import FileData, FileRange
from tests.wire.support import closed, listening

UNIT = 17


class Example(NamedTuple):
    section: str
    request: Request
    asked: str
    answered: str
    decode: Callable[[bytes], Any] = lambda _: None
    value: Any = None


def on(*numbers: int, first: int, count: int) -> list[bool]:
    return [number in numbers for number in range(first, first + count)]


EXAMPLES = [
    Example(
        "6.1 coils 20 to 38",
        functions.read_coils(UNIT, 19, 19),
        "01 0013 0013",
        "01 03 CD 6B 05",
        lambda reply: functions.bits(reply, 19),
        on(20, 22, 23, 26, 27, 28, 29, 31, 33, 34, 36, 38, first=20, count=19),
    ),
    Example(
        "6.2 discrete inputs 197 to 218",
        functions.read_discrete(UNIT, 196, 22),
        "02 00C4 0016",
        "02 03 AC DB 35",
        lambda reply: functions.bits(reply, 22),
        on(199, 200, 202, 204, 205, 206, 208, 209, 211, 212, 213, 215, 217, 218, first=197, count=22),
    ),
    Example(
        "6.3 registers 108 to 110",
        read_holding(UNIT, 107, 3),
        "03 006B 0003",
        "03 06 022B 0000 0064",
        registers,
        [555, 0, 100],
    ),
    Example("6.4 input register 9", read_input(UNIT, 8, 1), "04 0008 0001", "04 02 000A", registers, [10]),
    Example("6.5 coil 173 on", functions.write_coil(UNIT, 172, True), "05 00AC FF00", "05 00AC FF00"),
    Example("6.6 register 2 to 3", write_single(UNIT, 1, 3), "06 0001 0003", "06 0001 0003"),
    Example("6.7", diagnostics.exception_status(UNIT), "07", "07 6D", lambda reply: reply[2], 0x6D),
    Example(
        "6.8 query data",
        diagnostics.diagnostic(UNIT, Diagnostic.QUERY_DATA, b"\xa5\x37"),
        "08 0000 A537",
        "08 0000 A537",
        diagnostics.diagnostic_data,
        b"\xa5\x37",
    ),
    Example(
        "6.9",
        diagnostics.event_counter(UNIT),
        "0B",
        "0B FFFF 0108",
        diagnostics.counted_events,
        EventCounter(busy=True, events=264),
    ),
    Example(
        "6.10",
        diagnostics.event_log(UNIT),
        "0C",
        "0C 08 0000 0108 0121 20 00",
        diagnostics.logged_events,
        EventLog(busy=False, events=264, messages=289, log=b"\x20\x00"),
    ),
    Example(
        "6.11 ten coils from 20 on",
        functions.write_coils(UNIT, 19, [bool(int(bit)) for bit in "1011001110"]),
        "0F 0013 000A 02 CD 01",
        "0F 0013 000A",
    ),
    Example(
        "6.12 two registers from 2 on",
        write_multiple(UNIT, 1, [10, 0x102]),
        "10 0001 0002 04 000A 0102",
        "10 0001 0002",
    ),
    Example(
        "6.14 two groups",
        functions.read_files(UNIT, [FileRange(4, 1, 2), FileRange(3, 9, 2)]),
        "14 0E 06 0004 0001 0002 06 0003 0009 0002",
        "14 0C 05 06 0DFE 0020 05 06 33CD 0040",
        functions.file_records,
        [[0x0DFE, 0x20], [0x33CD, 0x40]],
    ),
    Example(
        "6.15",
        functions.write_files(UNIT, [FileData(4, 7, [0x06AF, 0x04BE, 0x100D])]),
        "15 0D 06 0004 0007 0003 06AF 04BE 100D",
        "15 0D 06 0004 0007 0003 06AF 04BE 100D",
    ),
    Example("6.16", functions.mask_write(UNIT, 4, 0xF2, 0x25), "16 0004 00F2 0025", "16 0004 00F2 0025"),
    Example(
        "6.17 six registers from 4 on, three written from 15 on",
        functions.read_write(UNIT, 3, 6, 14, [0xFF, 0xFF, 0xFF]),
        "17 0003 0006 000E 0003 06 00FF 00FF 00FF",
        "17 0C 00FE 0ACD 0001 0003 000D 00FF",
        registers,
        [0xFE, 0x0ACD, 1, 3, 0x0D, 0xFF],
    ),
    Example(
        "6.18 the queue at 1246",
        functions.read_fifo(UNIT, 1246),
        "18 04DE",
        "18 0006 0002 01B8 1284",
        functions.fifo,
        [440, 4740],
    ),
]

COMPANY = b"Company identification"
LONG_CODE = b"Product code XXXXXXXXXXXXXXXX"


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.section)
def test_an_example_is_asked_and_understood_as_printed(example: Example) -> None:
    assert example.request.adu == closed(bytes([UNIT]) + bytes.fromhex(example.asked))
    reply = closed(bytes([UNIT]) + bytes.fromhex(example.answered))
    assert listening(example.request).feed(reply) == [("reply", reply)]
    assert example.decode(reply) == example.value


def test_6_21_identification_in_one_reply() -> None:
    """The specification prints a length of 0D for "Product code XX", which has 15 letters: the text is taken."""
    request = diagnostics.identification(UNIT)
    assert request.adu == closed(bytes((UNIT,)) + bytes.fromhex("2B 0E 01 00"))
    head = bytes((UNIT,)) + bytes.fromhex("2B 0E 01 01 00 00 03")
    reply = closed(head + b"\x00\x16" + COMPANY + b"\x01\x0fProduct code XX" + b"\x02\x05V2.11")
    assert listening(request).feed(reply) == [("reply", reply)]
    conformity, follows, objects = diagnostics.identified(reply)
    assert (conformity, follows) == (1, None)
    assert objects == {0: COMPANY, 1: b"Product code XX", 2: b"V2.11"}


def test_6_21_identification_in_two_replies() -> None:
    """It prints 03 objects in both replies, which have two and one: 6.21 itself says those in the reply."""
    first = closed(
        bytes((UNIT,)) + bytes.fromhex("2B 0E 01 01 FF 02 02") + b"\x00\x16" + COMPANY + b"\x01\x1d" + LONG_CODE
    )
    assert listening(diagnostics.identification(UNIT)).feed(first) == [("reply", first)]
    assert diagnostics.identified(first).follows == 2
    request = diagnostics.identification(UNIT, number=2)
    assert request.adu == closed(bytes((UNIT,)) + bytes.fromhex("2B 0E 01 02"))
    second = closed(bytes((UNIT,)) + bytes.fromhex("2B 0E 01 01 00 00 01") + b"\x02\x05V2.11")
    assert listening(request).feed(second) == [("reply", second)]
    assert diagnostics.identified(second) == (1, None, {2: b"V2.11"})


def test_7_an_exception() -> None:
    request = functions.read_coils(UNIT, 0x4A1, 1)
    assert request.adu == closed(bytes((UNIT,)) + bytes.fromhex("01 04A1 0001"))
    reply = closed(bytes((UNIT,)) + bytes.fromhex("81 02"))
    assert listening(request).feed(reply) == [("exception", reply)]
