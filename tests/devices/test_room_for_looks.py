"""How often slow drives can be looked at is known before they move."""

from collections.abc import Awaitable

import pytest

from rs485bus import BusConfig, MksServo, open_bus
from rs485bus.errors import LimitExceeded
from rs485bus.motion.look_budget import LookBudget, LookOutcomes
from rs485bus.sim import SimMks, VirtualLine
from tests.devices.mks.bench import on_virtual_clock


def slow(count: int) -> VirtualLine:
    """A look at one of these takes a tenth of a second."""
    return VirtualLine(*(SimMks(address) for address in range(1, count + 1)), baudrate=9600, turnaround=0.06)


@on_virtual_clock
async def test_a_slow_drive_too_many_is_refused_before_it_moves() -> None:
    async with open_bus(slow(5)) as bus:
        axes = [MksServo(bus, address) for address in range(1, 6)]
        for axis in axes:
            await axis.enable()
        starts = [axis.run(120, acceleration=2000) for axis in axes]  # at once: none of them was looked at before
        refused = [start for start in starts if await fails(start)]
        assert len(refused) == 2
        for axis in axes:
            await axis.stop()


async def fails(start: Awaitable[object]) -> bool:
    try:
        await start
    except LimitExceeded:
        return True
    return False


@on_virtual_clock
async def test_looks_at_a_slow_drive_leave_the_wire_to_others_from_the_first_one_on() -> None:
    async with open_bus(slow(1), config=BusConfig(supervision=0.1)) as bus:
        axis = MksServo(bus, 1)
        await axis.enable()
        await axis.run(120, acceleration=2000)
        assert bus.keep(LookBudget, pytest.fail).shortest == pytest.approx(1.25 * 0.085 / 0.4, rel=0.15)
        await axis.stop()


def test_looks_are_in_vain_once_the_line_cannot_have_lost_them_all() -> None:
    looks = LookOutcomes()
    for missed in range(1, 13):
        looks.missed(0.0, 0.1, telling=True)
        assert looks.in_vain((0, 100)) == (missed >= 4, False)
        assert looks.in_vain((30, 70)) == (missed >= 12, False)  # 0.3 ** 12 is below one in a million
    looks.answered(0.0, 0.01, told=True, telling=False, where=False)
    assert looks.in_vain((0, 100)) == (False, True)  # it answers, and did not say where it is
    looks.answered(0.0, 0.01, told=True, telling=False, where=True)
    assert looks.in_vain((0, 100)) == (False, False)


def test_a_drive_that_answers_and_does_not_say_where_it_is_is_looked_at_in_vain() -> None:
    looks = LookOutcomes()
    for untold in range(1, 6):
        looks.answered(0.0, 0.01, told=False, telling=True, where=False)
        assert looks.in_vain((0, 100)) == (False, untold >= 4)


def test_the_first_look_after_a_missed_one_goes_at_once_and_later_ones_leave_the_wire_to_others() -> None:
    looks = LookOutcomes()
    pauses = []
    for took in (0.1, 0.01, 0.1):
        looks.missed(1.0, took, telling=True)
        pauses.append(looks.not_before - 1.0)
    assert pauses == pytest.approx([0.0, 0.015, 0.05])
    looks.answered(2.0, 0.01, told=False, telling=True, where=False)
    assert looks.not_before == pytest.approx(2.015)
