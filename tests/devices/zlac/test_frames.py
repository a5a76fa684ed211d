"""Every printed frame is what typed values make, and says the values it should."""

import json
from pathlib import Path
from typing import Any

import pytest

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.frames import control, read, write, write_together, write_twins
from rs485bus.devices.zlac.values import Brake, ControlMode, ControlWord, Synchrony
from rs485bus.wire.frames import Request, crc, payload
from rs485bus.wire.registers import Block, Register

FRAMES: list[dict[str, str]] = json.loads((Path(__file__).parents[2] / "vectors" / "zlac.json").read_text("utf-8"))
PAIRS = {
    pair: (
        next(frame for frame in FRAMES if frame.get("pair") == pair and frame["direction"] == "request"),
        next(frame for frame in FRAMES if frame.get("pair") == pair and frame["direction"] == "response"),
    )
    for pair in dict.fromkeys(frame["pair"] for frame in FRAMES)
}
Values = list[tuple[Register[Any], Any]]

TURNS_5 = 20480
"""5 turns in counts."""

# What each request is, from typed values, and the values it carries.
MEANINGS: dict[str, tuple[Request, Values]] = {}


def means(text: str, request: Request, *values: tuple[Register[Any], Any]) -> None:
    MEANINGS[text] = (request, list(values))


def single(text: str, register: Register[Any], value: Any) -> None:
    means(text, write(1, register, value), (register, value))


def both(text: str, twin: r.Twin[Any], left: Any, right: Any) -> None:
    means(text, write_twins(1, (twin, left, right)), (twin.left, left), (twin.right, right))


def command(text: str, word: ControlWord) -> None:
    means(text, control(1, word), (r.CONTROL, word))


means("01 03 20 AB 00 02 BE 2B", read(1, Block("velocities", 0x20AB, (r.VELOCITY.left, r.VELOCITY.right), 2)))
single("01 06 20 0D 00 01 D2 09", r.MODE, ControlMode.POSITION_RELATIVE)
single("01 06 20 0D 00 03 53 C8", r.MODE, ControlMode.VELOCITY)
single("01 06 20 0D 00 04 12 0A", r.MODE, ControlMode.TORQUE)
command("01 06 20 0E 00 05 23 CA", ControlWord.EMERGENCY_STOP)
command("01 06 20 0E 00 06 63 CB", ControlWord.CLEAR_FAULT)
command("01 06 20 0E 00 07 A2 0B", ControlWord.RELEASE)
command("01 06 20 0E 00 08 E2 0F", ControlWord.ENABLE)
command("01 06 20 0E 00 10 E2 05", ControlWord.START_BOTH)
command("01 06 20 0E 00 11 23 C5", ControlWord.START_LEFT)
command("01 06 20 0E 00 12 63 C4", ControlWord.START_RIGHT)
single("01 06 20 0F 00 00 B2 09", r.SYNCHRONY, Synchrony.ASYNCHRONOUS)
single("01 06 20 0F 00 01 73 C9", r.SYNCHRONY, Synchrony.SYNCHRONOUS)
single("01 06 20 1A 00 01 62 0D", r.BRAKE.left, Brake.CLOSED)
single("01 06 20 80 01 F4 83 F5", r.ACCELERATION_TIME.left, 500)
single("01 06 20 81 01 F4 D2 35", r.ACCELERATION_TIME.right, 500)
single("01 06 20 82 01 F4 22 35", r.DECELERATION_TIME.left, 500)
single("01 06 20 83 01 F4 73 F5", r.DECELERATION_TIME.right, 500)
single("01 06 20 86 01 F4 63 F4", r.TORQUE_SLOPE.left, 500)
single("01 06 20 87 01 F4 32 34", r.TORQUE_SLOPE.right, 500)
single("01 06 20 88 00 64 03 CB", r.TARGET_VELOCITY.left, 100)
single("01 06 20 88 FF 9C 43 B9", r.TARGET_VELOCITY.left, -100)
single("01 06 20 89 00 64 52 0B", r.TARGET_VELOCITY.right, 100)
single("01 06 20 89 FF 9C 12 79", r.TARGET_VELOCITY.right, -100)
single("01 06 20 8E 00 32 63 F4", r.POSITION_SPEED.left, 50)
single("01 06 20 8F 00 32 32 34", r.POSITION_SPEED.right, 50)
single("01 06 20 90 07 D0 81 8B", r.TARGET_TORQUE.left, 2000)
single("01 06 20 90 F8 30 C1 F3", r.TARGET_TORQUE.left, -2000)
single("01 06 20 91 07 D0 D0 4B", r.TARGET_TORQUE.right, 2000)
single("01 06 20 91 F8 30 90 33", r.TARGET_TORQUE.right, -2000)
means(
    "01 10 20 30 00 02 04 04 00 00 00 68 4A",
    write_together(1, (r.ENCODER_LINES.left, 1024), (r.HALL_OFFSET.left, 0)),
    (r.ENCODER_LINES.left, 1024),
    (r.HALL_OFFSET.left, 0),
)
both("01 10 20 88 00 02 04 00 64 00 64 23 9C", r.TARGET_VELOCITY, 100, 100)
both("01 10 20 88 00 02 04 FF 9C FF 9C D2 0B", r.TARGET_VELOCITY, -100, -100)
single("01 10 20 8A 00 02 04 00 00 50 00 DE 71", r.TARGET_POSITION.left, TURNS_5)
single("01 10 20 8A 00 02 04 FF FF B0 00 97 95", r.TARGET_POSITION.left, -TURNS_5)
both("01 10 20 8A 00 04 08 00 00 50 00 00 00 50 00 E3 2C", r.TARGET_POSITION, TURNS_5, TURNS_5)
both("01 10 20 8A 00 04 08 FF FF B0 00 FF FF B0 00 FC A3", r.TARGET_POSITION, -TURNS_5, -TURNS_5)
single("01 10 20 8C 00 02 04 00 00 50 00 5E 5B", r.TARGET_POSITION.right, TURNS_5)
single("01 10 20 8C 00 02 04 FF FF B0 00 17 BF", r.TARGET_POSITION.right, -TURNS_5)
both("01 10 20 90 00 02 04 07 D0 07 D0 60 23", r.TARGET_TORQUE, 2000, 2000)
both("01 10 20 90 00 02 04 F8 30 F8 30 11 B9", r.TARGET_TORQUE, -2000, -2000)


def decoded(address: int, data: bytes) -> Values:
    """The typed values in registers from an address on."""
    values: Values = []
    while data:
        register = r.BY_ADDRESS[address]
        values.append((register, register.decode(data)))
        address, data = address + register.count, data[2 * register.count :]
    return values


def test_there_are_134_printed_frames_in_67_exchanges_and_all_are_whole() -> None:
    assert len(FRAMES) == 134
    assert len(PAIRS) == 67
    for frame in FRAMES:
        data = bytes.fromhex(frame["hex"])
        assert crc(data[:-2]) == data[-2:], frame["id"]


@pytest.mark.parametrize(("request_frame", "response_frame"), PAIRS.values(), ids=PAIRS)
def test_a_printed_exchange_is_made_of_typed_values_and_says_them(
    request_frame: dict[str, str], response_frame: dict[str, str]
) -> None:
    request, values = MEANINGS[request_frame["hex"]]
    adu, reply = bytes.fromhex(request_frame["hex"]), bytes.fromhex(response_frame["hex"])
    assert request.adu == adu
    assert reply.startswith(request.prefix)
    assert len(reply) == request.length
    if request.function == 3:
        assert decoded(request.register, payload(reply)) == [(r.VELOCITY.left, 10.0), (r.VELOCITY.right, 10.0)]
    elif request.function == 6:
        assert decoded(request.register, adu[4:-2]) == values
        assert decoded(request.register, reply[4:-2]) == values
    else:
        assert decoded(request.register, adu[7:-2]) == values
        assert int.from_bytes(reply[4:6], "big") == sum(register.count for register, _ in values)


def test_registers_of_one_frame_must_lie_one_behind_the_other() -> None:
    with pytest.raises(ValueError, match="does not lie behind"):
        write_together(1, (r.TARGET_VELOCITY.left, 0), (r.TARGET_TORQUE.left, 0))
