"""Every value in its range survives the way to the drive and back; every other one stays at home."""

import enum
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read, understand, write, write_block
from rs485bus.devices.mks.values import Homed
from rs485bus.errors import LimitExceeded
from rs485bus.sim import SimMks
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import payload
from rs485bus.wire.registers import Block, Field, Register

WRITES: tuple[Register[Any] | Block, ...] = (*r.SINGLE_WRITES, *r.BLOCK_WRITES)


def fields_of(what: Register[Any] | Block) -> tuple[Field[Any], ...]:
    return what.fields if isinstance(what, Block) else (what,)


def bounds(field: Field[Any]) -> tuple[int, int]:
    """The lowest and highest whole number that stands for a value."""
    low = field.number.low if field.low is None else round(field.low / field.step)
    high = field.number.high if field.high is None else round(field.high / field.step)
    return low, high


def typed(field: Field[Any], raw: int) -> Any:
    return field.decode(field.number.encode(raw))


def members(field: Field[Any]) -> list[Any] | None:
    """The values that can be chosen, where it is a choice."""
    into = field.into
    if isinstance(into, type) and issubclass(into, enum.Enum) and not issubclass(into, enum.Flag):
        return list(into)
    return None


def values_of(field: Field[Any]) -> st.SearchStrategy[Any]:
    """All typed values of a field."""
    choices = members(field)
    if choices is not None:
        return st.sampled_from(choices)
    low, high = bounds(field)
    return (st.integers(low, high) | st.sampled_from([low, high])).map(lambda raw: typed(field, raw))


@given(st.data())
def test_every_value_that_can_be_written_is_understood_as_itself(data: st.DataObject) -> None:
    what = data.draw(st.sampled_from(WRITES))
    address = data.draw(st.integers(1, 247))
    values = tuple(data.draw(values_of(field)) for field in fields_of(what))
    request = write_block(address, what, *values) if isinstance(what, Block) else write(address, what, values[0])
    assert understand(request.adu[1:-2]) == (what, values)
    assert request.adu[0] == address


@given(st.data())
def test_every_value_out_of_range_is_refused_with_the_range_named(data: st.DataObject) -> None:
    what = data.draw(st.sampled_from(WRITES))
    at = data.draw(st.integers(0, len(fields_of(what)) - 1))
    values = [data.draw(values_of(field)) for field in fields_of(what)]
    field = fields_of(what)[at]
    low, high = bounds(field)
    beyond, said = st.integers(max_value=low - 1) | st.integers(min_value=high + 1), r"is outside .*\.\."
    choices = members(field)
    if choices is not None:
        numbers = {int(choice) for choice in choices}
        beyond, said = st.integers().filter(lambda raw: raw not in numbers), "is none of"
    values[at] = data.draw(beyond) * field.step
    with pytest.raises(LimitExceeded, match=said) as refused:
        write_block(1, what, *values) if isinstance(what, Block) else write(1, what, values[0])
    assert field.name in str(refused.value)


@pytest.mark.parametrize(
    ("what", "value"),
    [
        (r.POSITION, st.integers(-(1 << 47), (1 << 47) - 1)),
        (r.SPEED, st.integers(-(1 << 15), (1 << 15) - 1)),
        (r.PULSES, st.integers(0, (1 << 32) - 1)),
        (r.VERSION, st.integers(0, (1 << 32) - 1)),
        (r.ANGLE_ERROR, values_of(r.ANGLE_ERROR)),
        (r.INPUTS, values_of(r.INPUTS)),
        (r.ENABLED, st.booleans()),
        (r.STALLED, st.booleans()),
        (r.STATUS, values_of(r.STATUS)),
    ],
    ids=lambda value: value.name if isinstance(value, Register) else "",
)
def test_every_answer_is_read_as_what_it_says(what: Register[Any], value: st.SearchStrategy[Any]) -> None:
    @given(value)
    def check(value: Any) -> None:
        assert what.decode(what.encode(value)) == value

    check()


@given(st.integers(-(1 << 31), (1 << 31) - 1), st.integers(0, 0x3FFF))
def test_carry_and_value_are_read_as_what_they_say(carry: int, value: int) -> None:
    assert r.ENCODER.decode(r.ENCODER.encode(carry, value)) == (carry, value)


@given(st.sampled_from(Homed), st.sampled_from(Homed))
def test_both_halves_of_the_homing_status_are_read(single: Homed, origin: Homed) -> None:
    assert r.HOMED.decode(r.HOMED.encode(single, origin)) == (single, origin)


@given(st.integers(-(1 << 46), 1 << 46), st.integers(-(1 << 40), 1 << 40))
def test_positions_of_48_bits_come_over_the_wire_negative_ones_too(counts: int, turns: int) -> None:
    sim = SimMks(shaft=float(turns % 1000))
    sim.motion.zero = sim.motion.motor.position(0.0) - counts / r.COUNTS_PER_TURN
    rig = Rig(sim)
    position = rig.submit(read(1, r.POSITION))
    encoder = rig.submit(read(1, r.ENCODER))
    rig.done(position, encoder)
    assert r.POSITION.decode(payload(position.reply)) == counts
    assert r.ENCODER.decode(payload(encoder.reply)) == (turns % 1000, 0)


def test_the_examples_of_carry_and_value_are_read() -> None:
    # 3.1.1: from 0x3FF0 one turn counter-clockwise is 0x13FF0, one clockwise (as it must read) 0xFFFFFFFF3FF0.
    assert r.ENCODER.decode(bytes.fromhex("00 00 00 01 3F F0")) == (1, 0x3FF0)
    assert r.ENCODER.decode(bytes.fromhex("FF FF FF FF 3F F0")) == (-1, 0x3FF0)
    # 3.1.2: the same as one number.
    assert r.POSITION.decode(bytes.fromhex("00 00 00 00 7F F0")) == 0x7FF0
    assert r.POSITION.decode(bytes.fromhex("FF FF FF FF FF F0")) == 0x3FF0 - 0x4000
