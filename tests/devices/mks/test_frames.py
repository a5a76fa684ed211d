"""Every frame that the manual prints, from typed values and back."""

from typing import Any

import pytest

from rs485bus.bus.line.transaction import Kind, Transaction
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import current, native, read, understand, write, write_block
from rs485bus.devices.mks.values import BaudRate, Boot, Model, MotionDirection
from rs485bus.errors import LimitExceeded
from rs485bus.wire.frames import Request, crc, payload
from rs485bus.wire.registers import Block, Register
from tests.devices.mks.manual import ANSWERS, LOGGED, READS, SAYS, VECTORS, logged, request

REQUESTS = [pytest.param(vector["hex"], id=vector["id"]) for vector in VECTORS if vector["direction"] == "request"]
RESPONSES = [pytest.param(vector["hex"], id=vector["id"]) for vector in VECTORS if vector["direction"] == "response"]


def kind_of(request: Request, reply: bytes) -> Kind | None:
    """What the bus takes a frame for after a request."""
    exchange = Transaction(False)
    exchange.begin(request, ())
    received = exchange.feed(reply)
    return received[0].kind if received else None


def test_all_frames_of_the_manual_are_here() -> None:
    assert len(VECTORS) == 185
    assert len(REQUESTS) + len(RESPONSES) == 185
    assert all(crc(frame[:-2]) == frame[-2:] for frame in (bytes.fromhex(vector["hex"]) for vector in VECTORS))


@pytest.mark.parametrize("printed", REQUESTS)
def test_each_printed_request_is_made_of_typed_values(printed: str) -> None:
    assert request(*SAYS[printed]).adu == bytes.fromhex(printed)


@pytest.mark.parametrize("printed", REQUESTS)
def test_each_printed_request_is_understood_as_typed_values(printed: str) -> None:
    said = understand(bytes.fromhex(printed)[1:-2])
    assert said == SAYS[printed]
    assert [type(value) for value in said.values] == [type(value) for value in SAYS[printed][1]]


@pytest.mark.parametrize("printed", RESPONSES)
def test_each_printed_response_is_taken_for_what_it_says(printed: str) -> None:
    frame = bytes.fromhex(printed)
    if printed in READS:
        what, value = READS[printed]
        assert what.decode(payload(frame)) == value
        assert frame[:-2] == bytes((1, 4, len(payload(frame)))) + what.encode(value)
        assert kind_of(read(1, what), frame) is Kind.NORMAL
        return
    # An acknowledgement repeats the head of its request; so does a refusal, but for the values or the count.
    asked = [request(*said) for said in (*SAYS.values(), *ANSWERS.values())]
    kinds = {kind_of(each, frame) for each in asked} - {None}
    assert kinds == {Kind.REFUSAL if frame[1] == 16 and frame[4:6] == b"\0\0" else Kind.NORMAL}


@pytest.mark.parametrize("printed", ANSWERS)
def test_requests_of_which_only_the_answer_is_printed_fit_it(printed: str) -> None:
    asked = request(*ANSWERS[printed])
    assert asked.prefix + crc(asked.prefix) == bytes.fromhex(printed)
    assert understand(asked.adu[1:-2]) == ANSWERS[printed]


@pytest.mark.parametrize("section", LOGGED)
def test_each_logged_reply_answers_its_logged_request(section: str) -> None:
    for sent, reply in logged(section):
        asked = request(*SAYS[sent.hex(" ").upper()])
        refused = reply[1] == 16 and reply[4:6] == b"\0\0"
        assert kind_of(asked, reply) is (Kind.REFUSAL if refused else Kind.NORMAL)


def test_the_five_misprints_are_no_frames() -> None:
    misprints = [bytes.fromhex(vector["misprint"]) for vector in VECTORS if "misprint" in vector]
    assert len(misprints) == 5
    assert all(crc(frame[:-2]) != frame[-2:] for frame in misprints)


def test_a_refused_single_write_answers_ffff() -> None:
    asked = write(1, r.RESTART, 1)
    refused = bytes.fromhex("01 06 00 41 FF FF")
    assert kind_of(asked, refused + crc(refused)) is Kind.REFUSAL


def test_the_frame_that_switches_modbus_on_is_native() -> None:
    asked = native(1, r.MODBUS.address, 1)
    assert asked.adu == bytes.fromhex("FA 01 8E 01 8A")
    assert asked.length == 0  # nobody answers it in Modbus


def test_the_bit_that_spares_the_flash_is_in_the_current() -> None:
    assert current(1, Model.SERVO42D, 3000, save=True).adu[4:6] == (3000).to_bytes(2, "big")
    assert current(1, Model.SERVO42D, 3000, save=False).adu[4:6] == (3000 | 0x8000).to_bytes(2, "big")


def test_the_frames_of_which_the_manual_prints_no_crc_are_right() -> None:
    # 3.6 prints the CRC of command 1 for all of them; 3.2.14 and 8.1 print none.
    assert write(1, r.BOOT, Boot.ENTER_SILENCE).adu == bytes.fromhex("01 06 00 50 00 02 08 1A")
    assert write(1, r.BOOT, Boot.LEAVE_SILENCE).adu == bytes.fromhex("01 06 00 50 00 03 C9 DA")
    assert kind_of(write(1, r.WATCHDOG, 1000), bytes.fromhex("01 10 00 98 00 02 C0 27")) is Kind.NORMAL
    timed = write_block(1, r.RUN_FOR, MotionDirection.CCW, 2, 300, 100)
    assert kind_of(timed, bytes.fromhex("01 10 00 F6 00 04 21 F8")) is Kind.NORMAL


@pytest.mark.parametrize(
    "pdu",
    [
        "03 00 31 00 03",  # function 03, though 2.4 names it for 32-bit values
        "04 00 30 00 06",  # two commands in one window (2.1)
        "04 00 31 00 01",
        "06 00 31 00 01",
        "06 00 82 00 09",
        "10 00 90 00 03 06 00 00 00 64 00 00",  # 0x90 has five bytes
        "10 00 F5 00 02 04 00 00 00 00",
        "10 00 F6 00 02 08 00 02 01 2C",
        "",
    ],
)
def test_what_no_drive_understands_is_said_to_be_so(pdu: str) -> None:
    with pytest.raises(ValueError, match=r"no request to an MKS drive|of which the manual says nothing"):
        understand(bytes.fromhex(pdu))


def test_each_command_has_one_place_in_the_tables() -> None:
    whats: tuple[Register[Any] | Block, ...] = (*r.READS, *r.SINGLE_WRITES, *r.BLOCK_WRITES)
    assert len({(what.address, what.count) for what in whats}) == len(whats) == 50  # 49 commands; 0xF6 has two forms


def test_the_codes_of_the_baud_rates_are_those_printed() -> None:
    assert {code.value: code.baudrate for code in BaudRate} == {
        1: 9600, 2: 19200, 3: 25000, 4: 38400, 5: 57600, 6: 115200, 7: 256000,
    }  # fmt: skip


def test_a_current_beyond_the_model_is_refused_with_its_range() -> None:
    with pytest.raises(LimitExceeded, match=r"3001 mA is outside 0\.\.3000 mA of a SERVO42D"):
        current(1, Model.SERVO42D, 3001, save=True)
    with pytest.raises(LimitExceeded, match=r"5201 mA is outside 0\.\.5200 mA of a SERVO57D"):
        current(1, Model.SERVO57D, 5201, save=False)
    assert current(1, Model.SERVO57D, 5200, save=True).adu[4:6] == (5200).to_bytes(2, "big")
