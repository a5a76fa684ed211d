"""The transactions in minimalmodbus' own test suite: the same bytes go out, and its replies are taken or refused.

Where both do not agree, the test says who is right.
"""

import json
import struct
from pathlib import Path
from typing import Any

import pytest

from rs485bus.wire import functions
from rs485bus.wire.frames import Request, crc, read_holding, read_input, registers, write_multiple, write_single
from tests.wire.support import listening

RECORDED: dict[str, Any] = json.loads((Path(__file__).parents[1] / "vectors" / "minimalmodbus.json").read_text())

OF_ANOTHER_SLAVE = "011000360001020063e3ef"
"""It stands among the good ones, though slave 2 answers what slave 1 was asked. A driver of a pair must refuse it."""
HALF_SAID = {"140301210001d739", "1403012200012739"}
"""An adapter that echoes (the second of them wrongly): the echo is passed over, and what follows it is the answer."""


def asked(frame: bytes) -> Request:
    """The same request, made anew from what it says."""
    unit, function = frame[:2]
    first, second = struct.unpack(">HH", frame[2:6])
    values = list(struct.unpack(f">{frame[6] // 2}H", frame[7:-2])) if function == 16 else []
    bits = [bool(int.from_bytes(frame[7:-2], "little") >> at & 1) for at in range(second)] if function == 15 else []
    made = {
        1: lambda: functions.read_coils(unit, first, second),
        2: lambda: functions.read_discrete(unit, first, second),
        3: lambda: read_holding(unit, first, second),
        4: lambda: read_input(unit, first, second),
        5: lambda: functions.write_coil(unit, first, second == 0xFF00),
        6: lambda: write_single(unit, first, second),
        15: lambda: functions.write_coils(unit, first, bits),
        16: lambda: write_multiple(unit, first, values),
    }
    return made[function]()


@pytest.mark.parametrize(("request_hex", "reply_hex"), RECORDED["answered"])
def test_a_recorded_transaction_is_asked_and_answered_alike(request_hex: str, reply_hex: str) -> None:
    request, reply = asked(bytes.fromhex(request_hex)), bytes.fromhex(reply_hex)
    assert request.adu.hex() == request_hex
    expected = [] if request_hex == OF_ANOTHER_SLAVE else [("reply", reply)]
    assert listening(request).feed(reply) == expected
    if expected and request.function in (3, 4):
        assert len(registers(reply)) == int.from_bytes(request.adu[4:6], "big")


@pytest.mark.parametrize(("request_hex", "reply_hex"), RECORDED["not an answer"])
def test_what_minimalmodbus_refuses_is_no_answer(request_hex: str, reply_hex: str) -> None:
    request, reply = asked(bytes.fromhex(request_hex)), bytes.fromhex(reply_hex)
    assert request.adu.hex() == request_hex
    found = listening(request).feed(reply)
    if request_hex in HALF_SAID:
        assert found == [("reply", reply[len(request.adu) :])]
    elif reply[1:2] == bytes((request.function | 0x80,)):
        assert found == []  # an exception has five bytes; this one has eight
    else:
        assert found == []


def test_there_are_as_many_as_were_recorded() -> None:
    assert (len(RECORDED["answered"]), len(RECORDED["not an answer"])) == (96, 14)
    for frames in (*RECORDED["answered"], *RECORDED["not an answer"]):
        frame = bytes.fromhex(frames[0])
        assert crc(frame[:-2]) == frame[-2:]
