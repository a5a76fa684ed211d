"""Alarms say what to do, and whether the drive must be switched off (TL-R manual, 3.6)."""

import asyncio

import pytest

from rs485bus.devices.tlr import OperatingMode
from rs485bus.devices.tlr.alarms import ALARMS, alarm_of
from rs485bus.errors import DriveFault, ReferenceLost
from rs485bus.sim import SimTlr, TlrMachine
from tests.devices.tlr.support import TRIGGERS, now, stepper_on
from tests.integration.support import virtual


def test_the_five_alarms() -> None:
    assert [(alarm.code, alarm.power_cycle) for alarm in ALARMS.values()] == [
        (1, True),
        (2, True),
        (3, True),
        (4, False),
        (5, False),
    ]
    assert alarm_of(0) is None
    unknown = alarm_of(9)
    assert unknown is not None
    assert str(unknown).startswith("alarm 9, not described")


@pytest.mark.parametrize("code", [1, 2, 3, 4, 5])
@TRIGGERS
@virtual
async def test_an_alarm_fails_the_move_under_way_and_is_cleared_where_that_is_possible(code: int, trigger: str) -> None:
    sim = SimTlr(trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        x.enable()
        for _ in range(2):  # twice: the command must be taken again
            await x.set_zero()
            move = x.move_to(50.0)
            await asyncio.sleep(1.0)
            sim.fail(code, now())
            alarm = ALARMS[code]
            with pytest.raises(DriveFault, match=f"alarm {code}, {alarm.name}: {alarm.remedy}"):
                await move
            status = await x.status()
            assert (status.fault, status.alarm) == (True, alarm)
            with pytest.raises(ReferenceLost, match="raised an alarm"):
                await x.move_to(1.0)
            if alarm.power_cycle:
                with pytest.raises(DriveFault, match=r"still reports.*switch the drive off and on"):
                    await x.clear_alarm()
                sim.power_cycle(now())
                await asyncio.sleep(1.0)
            else:
                await x.clear_alarm()
            assert (await x.status()).alarm is None
            await x.enable()
            await x.set_zero()
            assert await x.move_to(1.0) == 1.0


@pytest.mark.parametrize("denies", [True, False])
@virtual
async def test_nothing_is_sent_to_a_drive_that_reports_a_fault(denies: bool) -> None:
    sim = SimTlr(denies=denies)
    async with stepper_on(sim) as x:
        await x.enable()
        await asyncio.sleep(1.0)
        sim.fail(2, now())
        before = len(sim.writes)
        with pytest.raises(DriveFault, match="overvoltage"):
            await x.move_to(1.0)
        with pytest.raises(DriveFault, match="overvoltage"):
            await x.run(60)
        with pytest.raises(DriveFault, match="overvoltage"):
            await x.home()
        assert len(sim.writes) == before


@virtual
async def test_a_closed_loop_notices_that_it_is_blocked_and_an_open_one_does_not() -> None:
    for mode in OperatingMode:
        sim = SimTlr(machine=TlrMachine(travel=(-10.0, 2.0)), operating_mode=mode)
        async with stepper_on(sim) as x:
            await x.enable()
            if mode is OperatingMode.CLOSED_LOOP:
                with pytest.raises(DriveFault, match="position error"):
                    await x.move_to(5.0)
            else:
                assert await x.move_to(5.0) == 5.0
                assert sim.shaft(now()) == pytest.approx(2.0)
                await x.move_to(4.0)
                assert sim.shaft(now()) == pytest.approx(1.0)
            assert sim.shaft(now()) <= 2.0 + 1e-6
