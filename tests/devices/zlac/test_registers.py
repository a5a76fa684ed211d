"""The table of registers: whole, and every value in it can be said and read back."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.frames import read, write
from rs485bus.devices.zlac.telemetry import turned
from rs485bus.devices.zlac.values import REMEDIES, Fault, Side
from rs485bus.errors import LimitExceeded
from rs485bus.wire.registers import Register

GAPS = {0x2015, 0x2041, 0x2042, 0x2071, 0x2072, *range(0x2023, 0x2030), *range(0x204B, 0x2060)} | {
    *range(0x207B, 0x2080),
    *range(0x2092, 0x20A0),
}
"""The addresses that the directory leaves out."""
WRITABLE = [register for register in r.ALL if register.access != "r"]


def words(register: Register[Any]) -> range:
    return range(register.address, register.address + register.count)


def test_the_table_has_the_119_addresses_of_the_directory_once_each() -> None:
    addresses = [address for register in r.ALL for address in words(register)]
    assert len(addresses) == len(set(addresses)) == 119
    assert set(addresses) == set(range(r.FIRST, r.LAST + 1)) - GAPS


def test_blocks_lie_without_a_gap_over_the_registers_they_name() -> None:
    blocks = (r.MOTION, r.STATE, r.REPORT, r.PORTS, r.TERMINALS, r.SHAFT_AND_SPEED, r.MODES, r.CONTROL_BLOCK)
    for block in (*blocks, *r.PARAMETER_BLOCKS[Side.LEFT], *r.PARAMETER_BLOCKS[Side.RIGHT]):
        assert block.size == 2 * block.count
        at = 0
        for field in block.fields:
            if isinstance(field, Register):
                assert field.address == block.address + at // 2, field.name
            at += field.number.size


@pytest.mark.parametrize("twin", [*r.PARAMETERS, *r.CONTROLS], ids=lambda twin: twin.left.name[5:])
def test_left_and_right_differ_in_the_address_only(twin: r.Twin[Any]) -> None:
    left, right = twin.left, twin.right
    assert left.name.replace("left", "right") == right.name
    assert (left.number, left.low, left.high, left.step) == (right.number, right.low, right.high, right.step)
    # The directory prints 50 and 1000 for one of them.
    assert left.default == right.default or twin is r.POSITION_KF


@pytest.mark.parametrize("register", WRITABLE, ids=lambda register: f"{register.address:04X}")
def test_what_a_drive_is_shipped_with_is_within_its_range(register: Register[Any]) -> None:
    assert register.decode(register.encode(register.default)) == register.default


@given(st.sampled_from(WRITABLE), st.data())
def test_every_value_within_a_range_comes_back_as_it_was(register: Register[Any], data: st.DataObject) -> None:
    if register.into is not None:
        choices = [0, 1] if register.into is bool else [member.value for member in register.into]  # type: ignore[attr-defined] # an enum
        raw = data.draw(st.sampled_from(choices))
    else:
        low = register.number.low if register.low is None else round(register.low / register.step)
        high = register.number.high if register.high is None else round(register.high / register.step)
        raw = data.draw(st.integers(low, high))
    value = register.decode(register.number.encode(raw))
    assert register.raw(value) == raw
    request = write(1, register, value)
    assert request.adu[4 if register.count == 1 else 7 : -2] == register.number.encode(raw)


@pytest.mark.parametrize(
    ("register", "value"),
    [
        (r.WATCHDOG, 32768),
        (r.NODE_ID, 0),
        (r.NODE_ID, 128),
        (r.SPEED_LIMIT, 1001),
        (r.SPEED_RESOLUTION, 0),
        (r.ACCELERATION_TIME.left, 32768),
        (r.TARGET_TORQUE.right, 30001),
        (r.TARGET_POSITION.left, -0x8000_0000),
        (r.POSITION_SPEED.left, 0),
        (r.MODE, 5),
        (r.RATED_CURRENT.left, 15.1),
    ],
)
def test_what_a_register_does_not_take_is_refused_with_its_range(register: Register[Any], value: Any) -> None:
    with pytest.raises(LimitExceeded, match=register.name):
        write(1, register, value)


def test_reads_are_function_three() -> None:
    assert read(1, r.MOTION).adu[:6] == bytes.fromhex("01 03 20 A7 00 08")


def test_every_error_has_a_name_and_a_remedy_and_they_combine() -> None:
    assert set(REMEDIES) == set(Fault)
    described = (Fault.OVER_CURRENT | Fault.ENCODER | Fault(0x4000)).describe()
    assert "over current" in described
    assert "encoder cable" in described
    assert "0x4000" in described


def test_error_0x0800_is_the_encoder_though_one_of_the_two_lists_ends_before() -> None:
    assert r.ERRORS.of(Side.RIGHT).decode(b"\x08\x00") is Fault.ENCODER


@given(st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31) + 1, 2**31 - 1))
def test_the_way_between_two_counts_is_found_across_the_wrap(before: int, way: int) -> None:
    after = (before + way + 2**31) % 2**32 - 2**31
    assert turned(before, after) == way
