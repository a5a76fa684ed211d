"""Every parameter of the manual has its place, and what has none is refused."""

import pytest

from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.frames import read, words, write
from rs485bus.errors import LimitExceeded
from rs485bus.sim import SimTlr
from rs485bus.wire.frames import payload
from rs485bus.wire.registers import Register

ALL: tuple[Register[object], ...] = (*r.MONITORING, *r.COMMANDS, *r.SETTINGS, *r.MANUFACTURER)
ADDRESSES = [register.address + offset for register in ALL for offset in range(register.count)]
HOLES = {
    0x03,
    *range(0x0B, 0x10),
    *range(0x16, 0x1A),
    0x1E,
    0x27,
    *range(0x29, 0x30),
    *range(0x39, 0x40),
    *range(0x4B, 0x4E),
    *range(0x55, 0xB0, 6),
    *range(0xE0, 0x100),
    0x108,
}


def test_the_203_addresses_of_the_manual_are_named_once_each() -> None:
    assert len(ADDRESSES) == len(set(ADDRESSES)) == 203
    assert set(ADDRESSES) == set(range(1, 0x11A)) - HOLES


@pytest.mark.parametrize("register", ALL, ids=lambda register: register.name)
def test_a_drive_answers_it(register: Register[object]) -> None:
    sim = SimTlr(1)
    reply = sim.receive(read(1, register).adu, 1.0)
    assert reply is not None
    assert reply[1] == 3
    register.decode(payload(reply))


def test_what_is_only_read_is_not_written_and_a_hole_is_neither() -> None:
    sim = SimTlr(1)
    for address in (*HOLES, *(register.address for register in r.MONITORING)):
        reply = sim.receive(write(1, address, (0,)).adu, 1.0)
        assert reply is not None
        assert reply[1:3] == b"\x86\x02", address
    for address in HOLES:
        reply = sim.receive(read(1, Register("hole", r.STATUS.number, address=address)).adu, 1.0)
        assert reply is not None
        assert reply[1:3] == b"\x83\x02", address


@pytest.mark.parametrize(
    ("register", "wrong"),
    [
        (r.SUBDIVISION, 399),
        (r.SUBDIVISION, 51201),
        (r.MOVE_SPEED, 3001),
        (r.JOG_SPEED, -3001),
        (r.MOVE_UP, 2001),
        (r.INPUT_FILTER, 1025),
        (r.INPUT_FUNCTIONS[0], 7),
        (r.INPUT_FUNCTIONS[4], 18),
        (r.OUTPUT_FUNCTIONS[0], 6),
        (r.HOMING_MODE, 19),
        (r.OPERATING_MODE, 0),
        (r.CONTROL, 128),
        (r.AUXILIARY, 0x0700),
        (r.BAUD_RATE, 4),
    ],
    ids=lambda case: str(getattr(case, "name", case)),
)
def test_a_value_out_of_its_range_is_refused_on_both_sides(register: Register[int], wrong: int) -> None:
    with pytest.raises(LimitExceeded, match=register.name):
        register.encode(wrong)
    reply = SimTlr(1).receive(write(1, register.address, (wrong & 0xFFFF,)).adu, 1.0)
    assert reply is not None
    assert reply[1:3] == b"\x86\x03"


def test_the_high_word_comes_first() -> None:
    assert words(r.TARGET.encode(-2)) == (0xFFFF, 0xFFFE)
    assert r.TARGET.encode(0x12345678) == bytes.fromhex("12345678")


def test_paths_are_where_the_tables_have_them() -> None:
    assert [block.address for block in r.POSITION_PATHS] == list(range(80, 171, 6))
    assert [block.address for block in r.SPEED_PATHS] == list(range(176, 222, 3))
    assert (r.POSITIONING.address, r.POSITIONING.count) == (0x33, 6)
    assert (r.TELEMETRY.address, r.TELEMETRY.count) == (0x04, 7)
