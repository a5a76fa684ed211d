"""Positioning (TL-R manual, 3.1): targets, blocks that arrive, triggers that are seen to work."""

import asyncio
import logging

import pytest

from rs485bus import BusConfig, MoveState
from rs485bus.devices.tlr import OperatingMode
from rs485bus.devices.tlr import registers as r
from rs485bus.errors import DeviceRefused, LimitExceeded, MotionError, MoveCancelled, MoveFailed, NotEnabled
from rs485bus.sim import SimTlr, TlrMachine
from tests.devices.tlr.support import TRIGGERS, lose, now, stepper_on, writes
from tests.integration.support import virtual

CONTROL = r.CONTROL.address
BLOCK = r.POSITIONING.address


@TRIGGERS
@virtual
async def test_position_mode(trigger: str) -> None:
    sim = SimTlr(shaft=0.5, trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        x.enable()
        assert await x.move_to(3.0, rpm=600, acceleration=3000) == 3.0
        assert await x.move_to(-2.5) == -2.5
        assert await x.move_by(1.5) == -1.0
        assert sim.shaft(now()) == pytest.approx(-0.5)
        assert (await x.status()).in_position
        assert sim.moves == 3
        # Start speed, 600/3000 s up and down, speed, and the target with its high word first.
        assert writes(sim, BLOCK)[1] == (0, 200, 200, 600, 0, 12000)
        assert writes(sim, CONTROL)[-2:] == [(0,), (3,)]


@TRIGGERS
@virtual
async def test_where_writing_starts_it_the_trigger_need_not_be_cleared(trigger: str) -> None:
    sim = SimTlr(trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim, clear_trigger=False) as x:
        await x.enable()
        assert await x.move_to(1.0) == 1.0
        if trigger == "write":
            assert await x.move_to(2.0) == 2.0
            assert writes(sim, CONTROL) == [(0,), (3,), (3,)]
            return
        with pytest.raises(MoveFailed, match="clear_trigger=True"):
            await x.move_to(2.0)
        assert sim.moves == 1


@pytest.mark.parametrize("admits", [False, True])
@virtual
async def test_firmware_that_truncates_is_noticed_and_written_singly_from_then_on(
    admits: bool, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    sim = SimTlr(truncates=4, admits_truncation=admits)
    async with stepper_on(sim) as x:
        await x.enable()
        assert await x.move_to(20.0) == 20.0
        assert sim.shaft(now()) == pytest.approx(20.0)
        assert "keeps only a part of a block" in caplog.text
        before = len(sim.writes)
        assert await x.move_to(-20.0) == -20.0
        assert {len(values) for _, _, values in sim.writes[before:]} == {1}


@virtual
async def test_nothing_is_triggered_before_the_target_was_read_back() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        await x.enable()
        write = sim.write

        def forgetful(register: int, values: tuple[int, ...], now: float) -> None:
            """It takes no target at all, however it is written."""
            if register not in range(0x33, 0x39):
                write(register, values, now)

        sim.write = forgetful  # type: ignore[method-assign]
        with pytest.raises(DeviceRefused, match="acknowledged positioning and reads back"):
            await x.move_to(5.0)
        assert sim.moves == 0


@virtual
async def test_a_trigger_that_is_taken_and_does_nothing_is_noticed_at_once() -> None:
    sim = SimTlr(denies=False)
    async with stepper_on(sim) as x:
        await x.enable()
        sim.motion.enabled = False
        begun = now()
        with pytest.raises(MoveFailed, match="stands 4000000 pulses short"):
            await x.move_to(1000.0)
        assert now() - begun < 0.5
        assert writes(sim, CONTROL)[-1][0] & 0x60  # it was stopped: it must not start after all


@pytest.mark.parametrize("subdivision", [400, 4000, 51200])
@virtual
async def test_pulses_a_turn_are_those_of_the_drive(subdivision: int) -> None:
    sim = SimTlr(subdivision=subdivision)
    async with stepper_on(sim, units_per_turn=8.0) as x:
        x.enable()
        assert await x.move_to(20.0) == pytest.approx(20.0)
        assert sim.shaft(now()) == pytest.approx(2.5)
        assert x.counts_per_turn == subdivision


@pytest.mark.parametrize("mode", list(OperatingMode))
@pytest.mark.parametrize("end", [-0x8000_0000, 0x7FFF_FFFF])
@virtual
async def test_targets_at_the_ends_of_32_bits(end: int, mode: OperatingMode) -> None:
    sim = SimTlr(subdivision=4000, operating_mode=mode)
    config = BusConfig(supervision=5.0)  # it takes three hours
    async with stepper_on(sim, config=config, units_per_turn=4000.0, rpm=3000) as x:
        x.enable()
        assert await x.move_to(end) == end
        assert sim.shaft(now()) == pytest.approx(end / 4000)
        words = (0x8000, 0x0000) if end < 0 else (0x7FFF, 0xFFFF)
        assert writes(sim, BLOCK)[-1][4:] == words
        beyond = -1 if end < 0 else 1
        with pytest.raises(LimitExceeded, match=r"outside -2147483648\.\.2147483647, which is what the drive can"):
            x.move_by(beyond)
        assert sim.moves == 1
        assert await x.move_by(-beyond) == pytest.approx(end - beyond, abs=0.01)


@virtual
async def test_a_target_out_of_range_is_refused_with_the_range_named() -> None:
    sim = SimTlr(subdivision=51200)
    async with stepper_on(sim) as x:
        with pytest.raises(LimitExceeded, match=r"position 6000000 is outside -5368709\.12\.\.5368709\.11\d"):
            x.move_to(6e6)
        # What is out of reach only for the subdivision that it turns out to have is refused then.
        x.enable()
        with pytest.raises(LimitExceeded, match=r"position 50000 is outside -41943\.04\.\.41943\.03998.*set_zero\(\)"):
            await x.move_to(50_000)
        assert sim.moves == 0


@pytest.mark.parametrize(("rpm", "acceleration"), [(0, None), (3001, None), (3000, 1000), (300, 0), (300, -1)])
@virtual
async def test_a_speed_or_a_ramp_out_of_range(rpm: float, acceleration: float | None) -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        with pytest.raises(LimitExceeded, match=r"above 0, up to 3000|a ramp takes 2000 ms at most"):
            x.move_to(1.0, rpm=rpm, acceleration=acceleration)
        assert not sim.writes


@virtual
async def test_a_move_tells_what_the_drive_makes_of_it() -> None:
    async with stepper_on(SimTlr(), start_rpm=400) as x:
        await x.enable()
        move = x.move_to(10.0, rpm=299.7, acceleration=1234)
        assert await move == 10.0
        assert move.rpm == 300.0
        assert move.acceleration == pytest.approx(300 / 0.243)
        jump = x.move_to(0.0, acceleration=float("inf"))
        await jump
        assert jump.acceleration == float("inf")


@pytest.mark.parametrize("ramp_rpm", [None, 1000.0, 3000.0])
@virtual
async def test_moves_end_when_they_should_whatever_speed_the_ramp_times_refer_to(ramp_rpm: float | None) -> None:
    sim = SimTlr(ramp_rpm=ramp_rpm)
    async with stepper_on(sim, ramp_rpm=ramp_rpm) as x:
        await x.enable()
        move = x.move_to(20.0, rpm=600, acceleration=1500)
        await move
        assert move.eta is not None
        assert 0 <= now() - move.eta < 0.1


@TRIGGERS
@virtual
async def test_a_running_move_is_given_another_target_without_a_stop(trigger: str) -> None:
    sim = SimTlr(trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        await x.enable()
        move = x.move_to(20.0, rpm=600)
        await asyncio.sleep(1.0)
        slowest = []
        changed = x.retarget(30.0, rpm=900)
        for _ in range(50):
            await asyncio.sleep(0.01)
            slowest.append(abs(sim.motion.motor.rpm(now())))
        await changed
        assert min(slowest) > 500
        assert writes(sim, CONTROL)[-2:] == [(6,), (7,)]
        assert await move == 30.0
        assert (move.target, move.rpm) == (30.0, 900.0)
        assert sim.shaft(now()) == pytest.approx(30.0)
        assert await x.move_by(1.0) == 31.0


@virtual
async def test_a_running_move_may_be_turned_round() -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        await x.enable()
        move = x.move_to(200.0, rpm=3000, acceleration=1500)
        await asyncio.sleep(2.5)
        await x.retarget(-10.0, rpm=3000, acceleration=1500)
        assert await move == -10.0
        assert move.eta is not None
        assert abs(now() - move.eta) < 0.1


@virtual
async def test_what_is_not_under_way_cannot_be_changed() -> None:
    async with stepper_on(SimTlr()) as x:
        x.enable()
        with pytest.raises(MotionError, match="no move_to"):
            x.retarget(1.0)
        await x.run(60)
        with pytest.raises(MotionError, match="no move_to"):
            x.retarget(1.0)
        move = x.move_to(10.0)
        await asyncio.sleep(0.5)
        assert move.state is MoveState.MOVING
        change = x.retarget(20.0)
        x.stop()
        with pytest.raises(MoveCancelled, match="its move ended before"):
            await change
        with pytest.raises(MoveCancelled):
            await move


@pytest.mark.parametrize("heard", [True, False])
@virtual
async def test_a_change_whose_answer_is_lost_is_made_once(heard: bool) -> None:
    sim = SimTlr()
    async with stepper_on(sim) as x:
        await x.enable()
        move = x.move_to(20.0)
        await asyncio.sleep(1.0)
        lost = lose(sim, CONTROL, heard=heard, value=7)
        await x.retarget(25.0)
        assert await move == 25.0
        assert sim.shaft(now()) == pytest.approx(25.0)
        assert len(lost) == 1


@virtual
async def test_it_moves_only_after_it_was_told_to_hold_its_motor() -> None:
    for enabled_bit in (True, False, None):
        sim = SimTlr(enabled_bit=enabled_bit)
        async with stepper_on(sim) as x:
            with pytest.raises(NotEnabled, match=r"enable\(\) it first"):
                await x.move_to(1.0)
            await x.enable()
            assert await x.move_to(1.0) == 1.0
            await x.release()
            assert not sim.enabled
            with pytest.raises(NotEnabled):
                await x.move_to(2.0)
            assert sim.moves == 1


@virtual
async def test_status_bit_4_is_relied_on_only_where_that_was_asked_for() -> None:
    sim = SimTlr(enabled_bit=False)
    async with stepper_on(sim, enabled_bit=True) as x:
        with pytest.raises(NotEnabled, match="says that it is not enabled"):
            await x.enable()
    sim = SimTlr(enabled_at_power_on=True)
    async with stepper_on(sim, enabled_bit=True) as x:
        assert await x.move_to(1.0) == 1.0


@virtual
async def test_a_closed_loop_that_stands_off_its_target_a_little_has_reached_it() -> None:
    sim = SimTlr(machine=TlrMachine(following_error=3))
    async with stepper_on(sim) as x:
        x.enable()
        x.set_zero()
        for _ in range(20):
            x.move_by(0.3)
        await x.drain()
        assert sim.shaft(now()) == pytest.approx(6.0, abs=0.002)


@virtual
async def test_an_axis_that_counts_the_other_way_round() -> None:
    sim = SimTlr()
    async with stepper_on(sim, reverse=True) as x:
        x.enable()
        assert await x.move_to(2.0) == 2.0
        assert sim.shaft(now()) == pytest.approx(-2.0)
        await x.run(60)
        assert await x.velocity() == 60.0
        assert (await x.status()).rpm == 60.0
        await x.stop()
