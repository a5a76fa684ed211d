"""Faults and the emergency-stop input: both wheels stop, and what was told before does not go on."""

import asyncio

import pytest

from rs485bus import Move
from rs485bus.devices.zlac.together import Both
from rs485bus.devices.zlac.values import Brake, ControlWord, Fault, Inputs, ShaftState, Side
from rs485bus.errors import DriveFault, MotionError, MoveFailed, NotEnabled
from tests.devices.zlac.plant import WatchedZlac, on_virtual_clock, plant, word
from tests.devices.zlac.test_stopping import under_way


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("how", ["velocity", "together", "one by one"])
@on_virtual_clock
async def test_a_fault_of_one_wheel_in_the_middle_of_a_motion_stops_both(side: Side, how: str) -> None:
    async with plant() as p:
        motions: list[Both[float] | Move]
        if how == "velocity":
            motions = [p.base.run(200, 200, acceleration=20)]
        elif how == "together":
            motions = [p.base.move_to(10.0, 10.0)]
        else:
            motions = [p.base.left.move_to(10.0), p.base.right.move_to(10.0)]
        await asyncio.sleep(1.0)
        p.sim.fail(side, Fault.OVER_CURRENT | Fault.OVER_LOAD, p.now)
        for motion in motions:
            with pytest.raises(DriveFault, match=f"{side.name.lower()} over current .*, over load"):
                await motion
        await asyncio.sleep(1.0)
        assert await p.standing_for(2.0)
        with pytest.raises(MotionError):
            await p.base.left.run(10)
        with pytest.raises(DriveFault):
            await p.base.enable()
        await p.base.clear_faults()
        await p.base.enable()
        assert await p.standing_for(2.0)
        there = p.shafts()
        await p.base.move_by(1.0, 1.0)
        assert p.shafts() == pytest.approx((there[0] + 1, there[1] + 1), abs=0.005)


@on_virtual_clock
async def test_a_failure_of_either_wheel_that_is_awaited_is_not_logged_as_one_that_nobody_waits_for(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with plant() as p:
        waiting = asyncio.ensure_future(p.base.move_to(10.0, 10.0).wait())
        await asyncio.sleep(1.0)
        p.sim.fail(Side.RIGHT, Fault.OVER_LOAD, p.now)
        with pytest.raises(DriveFault):
            await waiting
        assert "failed:" not in caplog.text
        await p.base.clear_faults()


@on_virtual_clock
async def test_a_fault_is_noticed_while_a_long_move_is_waited_for() -> None:
    async with plant() as p:
        move = p.base.left.move_to(100.0)
        await asyncio.sleep(1.0)
        p.sim.fail(Side.LEFT, Fault.OVER_VOLTAGE, p.now)
        began = p.now
        with pytest.raises(DriveFault, match="over voltage"):
            await move
        assert p.now - began < 1.0


@on_virtual_clock
async def test_a_fault_that_stays_is_not_cleared() -> None:
    async with plant() as p:
        p.sim.fail(Side.RIGHT, Fault.MOTOR_TEMPERATURE, p.now)
        p.sim.refuse(word(ControlWord.CLEAR_FAULT))
        with pytest.raises(Exception, match="Refused"):
            await p.base.clear_faults()
        p.sim.lasting = Fault.MOTOR_TEMPERATURE
        with pytest.raises(DriveFault, match="let it cool down"):
            await p.base.clear_faults()
        p.sim.lasting = Fault(0)
        await p.base.clear_faults()


@on_virtual_clock
async def test_a_fault_of_an_encoder_ends_the_trust_in_positions() -> None:
    async with plant() as p:
        move = p.base.left.move_to(10.0)
        await asyncio.sleep(1.0)
        p.sim.fail(Side.LEFT, Fault.ENCODER, p.now)
        with pytest.raises(DriveFault):
            await move
        await p.base.clear_faults()
        await p.base.enable()
        with pytest.raises(MotionError, match="set_zero"):
            await p.base.left.move_to(0.0)
        await p.base.right.move_to(1.0)


@on_virtual_clock
async def test_a_closed_brake_is_a_fault_that_names_it() -> None:
    async with plant() as p:
        await p.base.set_brakes(Brake.CLOSED, Brake.OPEN)
        with pytest.raises(DriveFault, match="open its brake"):
            await p.base.left.move_to(1.0)
        await p.base.clear_faults()
        await p.base.set_brakes(Brake.OPEN, Brake.OPEN)
        await p.base.enable()
        await p.base.left.move_to(1.0)


@on_virtual_clock
async def test_the_emergency_stop_input_ends_a_move_and_keeps_the_drive_from_being_enabled() -> None:
    async with plant() as p:
        move = p.base.move_to(10.0, 10.0)
        await asyncio.sleep(1.0)
        p.sim.press(Inputs.X0, p.now)
        with pytest.raises(MoveFailed, match="emergency stop"):
            await move
        status = await p.base.status()
        assert status.emergency_stop_input
        assert status.left.shaft is ShaftState.EMERGENCY_STOP
        with pytest.raises(NotEnabled, match="emergency-stop input"):
            await p.base.enable()
        p.sim.press(Inputs(0), p.now)
        await p.base.enable()
        assert await p.standing_for(3.0)
        await p.base.move_to(1.0, 1.0)


@on_virtual_clock
async def test_the_emergency_stop_input_ends_a_run_that_gets_up_to_speed() -> None:
    async with plant() as p:
        run = p.base.run(500, 500, acceleration=20)
        await asyncio.sleep(1.0)
        p.sim.press(Inputs.X0, p.now)
        with pytest.raises(MoveFailed, match="emergency stop"):
            await run
        p.sim.press(Inputs(0), p.now)
        await p.base.enable()
        assert await p.standing_for(3.0)


@on_virtual_clock
async def test_the_emergency_stop_input_of_a_standing_drive_costs_no_reference() -> None:
    async with plant() as p:
        await p.base.move_to(1.0, 1.0)
        p.sim.press(Inputs.X0, p.now)
        await asyncio.sleep(1.0)
        with pytest.raises(NotEnabled):
            await p.base.left.move_to(2.0)
        p.sim.press(Inputs(0), p.now)
        await p.base.enable()
        await p.base.move_to(2.0, 2.0)
        assert p.shafts() == (2.0, 2.0)


@pytest.mark.parametrize("how", ["velocity", "torque", "for a time"])
@on_virtual_clock
async def test_a_fault_of_one_wheel_stops_the_other_one_that_keeps_a_speed_though_nobody_looks(how: str) -> None:
    async with plant(WatchedZlac(watchdog=1000)) as p:
        if how == "for a time":
            run = p.base.run(100, 100, duration=60.0)
            await asyncio.sleep(2.0)
        else:
            await under_way(p, how)
        p.sim.fail(Side.LEFT, Fault.OVER_CURRENT, p.now)
        await asyncio.sleep(1.0)  # the next feed hears of it
        assert await p.standing_for(1.0)
        if how == "for a time":
            with pytest.raises(DriveFault, match="left over current"):
                await run
        with pytest.raises(DriveFault, match="left over current"):
            await p.base.right.run(10)
        await p.base.clear_faults()
        await p.base.enable()
        assert await p.standing_for(1.0)
        await p.base.run(10, 10)
