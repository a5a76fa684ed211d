"""What a command of several axes has in common with that of one."""

import logging
from typing import Any

import pytest

from rs485bus import AxisGroup, MksServo, Zlac8015d, open_bus
from rs485bus.errors import MotionError
from rs485bus.motion.look_budget import LookBudget
from rs485bus.sim import SimMks, SimZlac, VirtualLine
from tests.integration.support import virtual


@virtual
async def test_a_command_of_both_wheels_or_of_a_group_calls_back_once_all_have_ended_and_says_why_it_failed() -> None:
    async with open_bus(VirtualLine(SimZlac(1), SimMks(2), SimMks(3))) as bus:
        base, group = Zlac8015d(bus, 1), AxisGroup(x=MksServo(bus, 2), y=MksServo(bus, 3))
        told: list[object] = []
        for verb in (base.enable, group.enable, lambda: base.move_by(0.1, 0.3)):
            command: Any = verb()
            command.add_done_callback(told.append)
            assert not told
            await command
            assert told == [command]
            assert command.error is None
            command.add_done_callback(told.append)
            assert told == [command, command]
            told.clear()
        both = base.move_by(0.1, 0.3)
        both.add_done_callback(told.append)
        await base.stop()
        assert told == [both]
        with pytest.raises(MotionError) as raised:
            await both
        assert both.error is raised.value


def test_that_looks_are_further_apart_is_said_only_where_that_can_be_read(caplog: pytest.LogCaptureFixture) -> None:
    budget = LookBudget(0.25)
    with caplog.at_level(logging.WARNING):
        budget.enter(1, 0.0801)
        assert not caplog.text
        budget.enter(2, 0.03)
        assert "0.34 s only, instead of every 0.25 s" in caplog.text
        caplog.clear()
        for _ in range(3):  # axes start and stop
            budget.leave(2)
            budget.enter(2, 0.031)
        assert not caplog.text
        budget.enter(3, 0.03)
    assert "0.44 s only" in caplog.text
