"""What came instead of an answer is told, with what to do about it."""

import time
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus import BusConfig, MksServo, open_bus
from rs485bus.bus.failure import failure
from rs485bus.bus.line.diagnosis import Heard, tell
from rs485bus.bus.schedule.job import Outcome
from rs485bus.devices.mks.frames import is_native, native
from rs485bus.errors import NoReply, OutcomeUnknown
from rs485bus.sim import Noise, SimDevice, VirtualLine
from rs485bus.sim.rig import Rig
from rs485bus.wire.crc import crc
from rs485bus.wire.frames import Request, public, read_holding, read_input, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from tests.integration.support import virtual


def closed(text: str) -> bytes:
    body = bytes.fromhex(text)
    return body + crc(body)


class Says(SimDevice):
    """Answers everything by the same bytes, whomever that was sent to."""

    def __init__(self, *says: bytes) -> None:
        super().__init__(1)
        self.says = says
        self.at = 0

    def receive(self, frame: bytes, now: float) -> bytes | None:
        self.at += 1
        return self.says[min(self.at, len(self.says)) - 1] or None

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        raise NotImplementedError


def said(
    request: Request, *says: bytes, echo: bool = False, retries: int = 0, explain: Callable[[bytes], str] | None = None
) -> str:
    """The message of a request that is answered so."""
    config = BusConfig(echo=echo, retries=retries)
    rig = Rig(Says(*says), noise=Noise(echo=echo), config=config)
    job = rig.submit(request)
    rig.done(job)
    assert job.outcome in (Outcome.NO_REPLY, Outcome.UNKNOWN)
    return str(failure(job, [], explain=explain or (lambda heard: "")))


READ = read_holding(1, 0, 1)
USUAL = "Check the device's power, address, baud rate and parity, and the wires A and B."

FRAMES = [
    (READ, closed("01 04 04 00 01 00 02"), "an answer of 9 bytes by function 04 where 7 were expected"),
    (READ, closed("01 03 04 00 01 00 02"), "an answer of 9 bytes by function 03 where 7 were expected"),
    (READ, closed("01 04 02 00 01"), "an answer of 7 bytes by function 04 where function 03 was expected"),
    (
        public(1, 24, b"\0\1"),
        closed("01 03 02 00 01"),
        "an answer of 7 bytes by function 03 where another was expected",
    ),
    (READ, closed("05 03 02 00 01"), "address 5 answered"),
    (READ, closed("05 83 02"), "address 5 answered"),
    (READ, closed("01 84 02"), "exception (02, illegal register address) came to function 04, which was not asked"),
    (write_single(1, 3, 7), closed("01 06 00 03 00 63"), "repeats other values than were sent (01 06 00 03 00 63"),
    (write_multiple(1, 3, [7, 8]), closed("01 10 00 03 00 01"), "repeats other values than were sent"),
    (READ, read_input(9, 0x31, 2).adu, "Somebody else asks on this pair (09 04 00 31 00 02"),
    (READ, b"\0\0" + closed("05 03 02 00 01") + b"\xff", "address 5 answered"),
    (READ, closed("00 03 02 00 01"), "address 0 answered"),
    (READ, closed("FF 03 02 00 01"), "address 255 answered"),
    (READ, closed("01 83"), "An exception came without its code (01 83 41 81): the device refuses function 03"),
    (READ, closed("05 18 00 06 00 02 01 B8 12 84"), "address 5 answered"),
    (READ, closed("05 2B 0E 01 01 00 00 01 00 02 41 42"), "address 5 answered"),
]


@pytest.mark.parametrize(("request_", "came", "told"), FRAMES)
def test_a_frame_that_is_no_answer_is_told(request_: Request, came: bytes, told: str) -> None:
    message = said(request_, came)
    assert told in message
    assert USUAL not in message


def test_a_modbus_tcp_frame_shows_which_language_the_gateway_speaks() -> None:
    message = said(READ, bytes.fromhex("01 03 00 00 00 03 84 8A 01"))
    assert "this gateway speaks Modbus TCP" in message
    assert "tcp://host:port" in message


@pytest.mark.parametrize("parity", [False, True])
def test_modbus_ascii_is_known_by_its_line_also_where_its_parity_stands_in_the_eighth_bit(parity: bool) -> None:
    line = b":010302000AF0\r\n"
    if parity:
        line = bytes(byte | (0x80 if bin(byte).count("1") % 2 else 0) for byte in line)
    assert "A line of Modbus ASCII came" in said(READ, line)
    assert "ASCII" not in said(READ, b":010302000AF1\r\n")


def test_a_protocol_that_ends_in_a_sum_is_told() -> None:
    assert "another protocol" in said(READ, bytes.fromhex("FB 01 F1 01 EE"))


def test_an_answer_that_was_damaged_is_told_with_the_cable() -> None:
    message = said(READ, closed("01 03 02 00 01")[:-1] + b"\0")
    assert "An answer came whose CRC is wrong" in message
    assert "termination" in message


@pytest.mark.parametrize("size", [2, 3, 6])
def test_an_answer_that_broke_off_is_told(size: int) -> None:
    assert f"broke off after {size} of 7 bytes" in said(READ, closed("01 03 02 00 01")[:size])


def test_noise_points_to_the_baud_rate() -> None:
    message = said(READ, bytes.fromhex("F8 00 FE 86 1E 00 78 80 C0 E6"))
    assert "10 bytes came that are no frame of Modbus (F8 00 FE 86 1E 00 78 80 ...)" in message
    assert "Check the baud rate and the parity first" in message
    assert "A byte came that is no frame of Modbus (00)" in said(READ, b"\0")


def test_an_echo_alone_says_that_nobody_answered() -> None:
    message = said(READ, b"", echo=True)
    assert "Only the request itself came back" in message
    assert USUAL in message


def test_what_came_behind_an_echo_is_told_too() -> None:
    assert "address 5 answered" in said(READ, closed("05 03 02 00 01"), echo=True)


def test_what_came_behind_an_echo_that_lost_its_first_byte_is_told() -> None:
    assert "Only the request itself" in tell(READ, Heard(READ.adu[1:]))
    assert "address 5" in tell(READ, Heard(READ.adu[1:] + closed("05 03 02 00 01")))


def test_what_begins_like_the_request_and_is_another_is_no_echo() -> None:
    rig = Rig(Says(closed("01 10 00 03 00 02 04 00 07 00 09")), config=BusConfig(echo=True))
    job = rig.submit(write_multiple(1, 3, [7, 8]), repeat=Repeat.NEVER)
    rig.done(job)
    assert "Only the request itself" not in str(failure(job, []))


def test_where_nothing_came_the_usual_things_are_to_be_checked() -> None:
    assert USUAL in said(READ, b"")
    assert tell(READ, None) == ""


def test_what_came_in_one_of_several_attempts_is_told() -> None:
    assert "address 5 answered" in said(READ, closed("05 03 02 00 01"), b"", retries=1)


def test_a_job_that_is_submitted_again_forgets_what_came_before() -> None:
    rig = Rig(Says(closed("05 03 02 00 01"), b""), config=BusConfig(echo=False, retries=0))
    job = rig.submit(READ)
    rig.done(job)
    rig.owner.submit(job, rig.now)
    rig.done(job)
    assert USUAL in str(failure(job, []))


def test_a_write_whose_outcome_is_unknown_tells_it_too() -> None:
    rig = Rig(Says(closed("05 06 00 03 00 07")), config=BusConfig(echo=False))
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    message = str(failure(job, []))
    assert "Instead, address 5 answered" in message
    assert message.endswith("Read back what the device did before you repeat it.")


def test_an_answer_that_may_be_an_echo_says_what_would_show_which() -> None:
    rig = Rig(noise=Noise(echo=True), config=BusConfig(retries=0))
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    message = str(failure(job, []))
    assert "What came back is the request itself" in message
    assert "BusConfig(echo=False)" in message


def test_an_exception_that_decided_nothing_is_told() -> None:
    rig = Rig(Says(b"", closed("01 83 02")), config=BusConfig(echo=False, retries=0, reply_timeout=0.03))
    rig.done(rig.submit(read_holding(1, 0, 3)))
    job = rig.submit(read_holding(1, 0, 2))
    rig.done(job)
    message = str(failure(job, []))
    assert "An exception (02, illegal register address) came that may belong to an older request" in message


@given(st.binary(max_size=300), st.booleans())
def test_it_never_raises_on_bytes(rest: bytes, echoed: bool) -> None:
    for request in (READ, write_single(1, 3, 7), public(1, 24, b"\0\1"), public(1, 43, bytes((14, 1, 0)))):
        assert isinstance(tell(request, Heard(rest, echoed)), str)


def test_it_takes_no_time_that_would_hold_up_the_bus() -> None:
    worst = bytes((1, 3, 0xFA)) * 85
    begun = time.process_time()
    for _ in range(20):
        tell(READ, Heard(worst))
    assert time.process_time() - begun < 20 * 0.01


# By the face that users see


@virtual
async def test_the_message_of_a_call_tells_it() -> None:
    async with open_bus(VirtualLine(Says(closed("05 03 02 00 01")))) as bus:
        with pytest.raises(NoReply, match="address 5 answered"):
            await bus.unit(1).read_holding_registers(0)
        with pytest.raises(OutcomeUnknown, match="address 5 answered"):
            await bus.unit(1).write_register(0, 1)


@virtual
async def test_an_mks_drive_whose_modbus_is_off_is_told() -> None:
    reply = bytes.fromhex("FB 01 F1 01")
    async with open_bus(VirtualLine(Says(reply + bytes([sum(reply) % 256])))) as bus:
        with pytest.raises(NoReply, match=r"its own protocol .*Modbus is switched off in it.*enable_modbus"):
            await MksServo(bus, 1).position()


@virtual
async def test_an_mks_drive_that_never_answered_may_have_its_modbus_off() -> None:
    async with open_bus(VirtualLine()) as bus:
        with pytest.raises(NoReply, match="Modbus is switched off in it"):
            await MksServo(bus, 1).position()


def test_only_a_drives_own_address_and_sum_are_taken_for_its_own_protocol() -> None:
    frame = native(1, 0x8E, 1).adu
    assert is_native(1, frame)
    assert not is_native(2, frame)
    assert not is_native(1, frame[:-1])
    assert not is_native(1, b"\xfb")
