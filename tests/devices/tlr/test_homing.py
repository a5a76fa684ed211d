"""Homing in five modes (TL-R manual, 3.4), and the soft limits that count after it (3.5.3)."""

import asyncio

import pytest

from rs485bus import TlrStepper
from rs485bus.devices.tlr import DiFunction, Homing, HomingMode, LimitStop
from rs485bus.devices.tlr import registers as r
from rs485bus.errors import (
    DriveFault,
    HomingFailed,
    LimitExceeded,
    MoveFailed,
    NotEnabled,
    OutcomeUnknown,
    RearmRequired,
    ReferenceLost,
)
from rs485bus.sim import SimTlr, TlrMachine
from tests.devices.tlr.support import TRIGGERS, lose, now, stepper_on, writes
from tests.integration.support import virtual

CONTROL = r.CONTROL.address
HERE = Homing(mode=HomingMode.HERE)
FAST = {"rpm": 300, "creep_rpm": 30, "ramp_ms": 50}
ORIGIN = (-2.0, -1.9)
SWITCH = {
    HomingMode.NEGATIVE_LIMIT: -5.0,
    HomingMode.POSITIVE_LIMIT: 6.0,
    HomingMode.POSITIVE_ORIGIN: -2.0,
    HomingMode.NEGATIVE_ORIGIN: -2.0,
}


def machine() -> TlrMachine:
    return TlrMachine(origin=ORIGIN, limits=(-5.0, 6.0))


@TRIGGERS
@pytest.mark.parametrize("mode", list(HomingMode))
@pytest.mark.parametrize("from_manual", [False, True])
@virtual
async def test_homing_in_each_mode(trigger: str, mode: HomingMode, from_manual: bool) -> None:
    # From below the origin up to it, and from above it down; the limits from anywhere.
    shaft = -4.0 if mode is HomingMode.POSITIVE_ORIGIN else 1.0
    sim = SimTlr(shaft=shaft, machine=machine(), trigger=trigger)  # type: ignore[arg-type] # as parametrised
    async with stepper_on(sim) as x:
        await x.enable()
        if from_manual:  # what the drive is set to
            for register, value in zip(r.HOMING.fields, (mode, 300, 30, 50, 0), strict=True):
                await x.write(register, value)  # type: ignore[arg-type] # all of them are registers
            assert await x.home() == pytest.approx(0.0, abs=0.002)
        else:
            assert await x.home(Homing(mode=mode, **FAST)) == pytest.approx(0.0, abs=0.002)
        assert sim.shaft(now()) == pytest.approx(SWITCH.get(mode, shaft), abs=0.01)
        assert (await x.status()).homed
        assert sim.moves == 1
        # Both again, now that it says that it is homed already: it is not taken at its word.
        await x.move_by(1.0 if mode in (HomingMode.NEGATIVE_LIMIT, HomingMode.NEGATIVE_ORIGIN) else -1.0)
        shaft = sim.shaft(now())
        await x.home()
        assert sim.shaft(now()) == pytest.approx(SWITCH.get(mode, shaft), abs=0.01)


@pytest.mark.parametrize("mode", [HomingMode.NEGATIVE_LIMIT, HomingMode.POSITIVE_ORIGIN, HomingMode.NEGATIVE_ORIGIN])
@virtual
async def test_homing_that_begins_on_its_switch(mode: HomingMode) -> None:
    shaft = -5.5 if mode is HomingMode.NEGATIVE_LIMIT else -1.95
    sim = SimTlr(shaft=shaft, machine=machine())
    async with stepper_on(sim) as x:
        await x.enable()
        await x.home(Homing(mode=mode, **FAST))
        assert sim.shaft(now()) == pytest.approx(SWITCH[mode], abs=0.01)


@pytest.mark.parametrize("goes_to_offset", [True, False])
@virtual
async def test_whatever_the_drive_makes_of_an_offset_positions_are_what_it_says(goes_to_offset: bool) -> None:
    sim = SimTlr(shaft=1.0, machine=machine(), goes_to_offset=goes_to_offset)
    async with stepper_on(sim, units_per_turn=10.0) as x:
        await x.enable()
        homing = Homing(mode=HomingMode.NEGATIVE_LIMIT, offset=5.0, **FAST)
        reached = await x.home(homing)
        assert reached == pytest.approx(0.0 if goes_to_offset else 5.0, abs=0.02)
        assert sim.shaft(now()) == pytest.approx(-4.5 if goes_to_offset else -5.0, abs=0.01)
        assert await x.move_by(1.0) == pytest.approx(reached + 1.0)
        assert writes(sim, r.HOMING.address)[-1] == (17, 300, 30, 50, 0, 2000)


@virtual
async def test_the_homing_block_is_written_singly_where_it_is_truncated() -> None:
    sim = SimTlr(shaft=1.0, machine=machine(), truncates=4)
    async with stepper_on(sim, units_per_turn=10.0) as x:
        await x.enable()
        await x.home(Homing(mode=HomingMode.NEGATIVE_LIMIT, offset=5.0, **FAST))
        assert sim.memory.get(r.HOME_OFFSET) == 2000


@pytest.mark.parametrize("heard", [True, False])
@pytest.mark.parametrize("mode", [HomingMode.NEGATIVE_LIMIT, HomingMode.HERE])
@virtual
async def test_a_homing_whose_trigger_or_answer_is_lost_happens_once(heard: bool, mode: HomingMode) -> None:
    sim = SimTlr(shaft=1.0, machine=machine())
    async with stepper_on(sim) as x:
        x.enable()
        await x.move_by(0.5)
        lose(sim, CONTROL, heard=heard, value=0x10)
        await x.home(Homing(mode=mode, **FAST))
        assert sim.moves == 2
        assert (await x.status()).homed


@virtual
async def test_a_homing_that_is_lost_three_times_fails_and_moves_nothing() -> None:
    sim = SimTlr(shaft=1.0, machine=machine())
    async with stepper_on(sim) as x:
        await x.enable()
        lose(sim, CONTROL, 3, heard=False, value=0x10)
        with pytest.raises(OutcomeUnknown):
            await x.home(Homing(mode=HomingMode.NEGATIVE_LIMIT, **FAST))
        assert sim.moves == 0


@virtual
async def test_a_homing_that_does_not_start_is_noticed_though_the_drive_says_that_it_is_homed() -> None:
    sim = SimTlr(shaft=1.0, machine=machine(), denies=False)
    async with stepper_on(sim) as x:
        await x.enable()
        await x.home(Homing(mode=HomingMode.NEGATIVE_LIMIT, **FAST))
        sim.motion.enabled = False
        with pytest.raises(HomingFailed, match="did not start"):
            await x.home()


@virtual
async def test_one_that_goes_on_saying_that_it_is_homed_is_not_taken_at_its_word() -> None:
    sim = SimTlr(shaft=1.0, machine=machine())
    async with stepper_on(sim) as x:
        await x.enable()
        await x.home(Homing(mode=HomingMode.NEGATIVE_LIMIT, **FAST))
        await x.move_by(3.0)
        sim.motion.machine.stays_homed = True
        sim.motion.machine.homing_pause = 0.5
        assert await x.home() == pytest.approx(0.0, abs=0.002)
        assert sim.shaft(now()) == pytest.approx(-5.0, abs=0.01)


@virtual
async def test_a_homing_without_its_input_is_refused_before_it_runs_away() -> None:
    sim = SimTlr(machine=machine())
    async with stepper_on(sim) as x:
        x.enable()
        await x.inputs.assign(DiFunction.ORIGIN)
        with pytest.raises(HomingFailed, match=r"no input has the function NEGATIVE_LIMIT.*inputs\[0\]"):
            await x.home(Homing(mode=HomingMode.NEGATIVE_LIMIT))
        assert sim.moves == 0


@virtual
async def test_a_homing_that_finds_nothing_is_stopped_when_its_time_is_over() -> None:
    sim = SimTlr(machine=TlrMachine(origin=None))
    async with stepper_on(sim) as x:
        x.enable()
        with pytest.raises(HomingFailed, match="within 5 s"):
            await x.home(Homing(mode=HomingMode.POSITIVE_ORIGIN, **FAST), timeout=5.0)
        await x.drain()
        assert not sim.moving(now())


@virtual
async def test_a_homing_that_a_limit_switch_ends_has_failed() -> None:
    sim = SimTlr(shaft=1.0, machine=machine())
    async with stepper_on(sim) as x:
        await x.enable()
        with pytest.raises(HomingFailed, match=r"stands without having found its origin, with inputs <Ports\.PORT_1"):
            await x.home(Homing(mode=HomingMode.POSITIVE_ORIGIN, **FAST))
        assert sim.shaft(now()) == pytest.approx(6.0, abs=0.3)


@virtual
async def test_an_alarm_ends_a_homing() -> None:
    sim = SimTlr(machine=machine())
    async with stepper_on(sim) as x:
        x.enable()
        home = x.home(Homing(mode=HomingMode.NEGATIVE_LIMIT))
        await asyncio.sleep(1.0)
        sim.fail(5, now())
        with pytest.raises(DriveFault, match="position error"):
            await home


@virtual
async def test_a_restart_in_the_middle_of_homing() -> None:
    sim = SimTlr(machine=machine())
    async with stepper_on(sim) as x:
        x.enable()
        home = x.home(Homing(mode=HomingMode.NEGATIVE_LIMIT))
        await asyncio.sleep(1.0)
        sim.power_cycle(now())
        with pytest.raises((ReferenceLost, HomingFailed)):
            await home
        with pytest.raises((ReferenceLost, NotEnabled, RearmRequired)):
            await x.move_to(1.0)
        x.enable()
        assert await x.home(Homing(mode=HomingMode.NEGATIVE_LIMIT, **FAST)) == pytest.approx(0.0, abs=0.002)
        assert await x.move_to(1.0) == 1.0


@virtual
async def test_a_homing_first_stops_what_runs() -> None:
    sim = SimTlr(machine=machine())
    async with stepper_on(sim) as x:
        x.enable()
        await x.run(-60)
        await x.home(HERE)
        assert not sim.moving(now())
        assert await x.position() == 0.0


@virtual
async def test_it_is_not_homed_before_it_is_enabled_or_at_no_speed() -> None:
    async with stepper_on(SimTlr()) as x:
        with pytest.raises(NotEnabled):
            await x.home(HERE)
        with pytest.raises(LimitExceeded, match="0 rpm"):
            x.home(Homing(mode=HomingMode.NEGATIVE_LIMIT, creep_rpm=0))
        with pytest.raises(LimitExceeded, match=r"homing ramp 2001 ms is outside 0\.\.2000 ms"):
            x.home(Homing(mode=HomingMode.HERE, ramp_ms=2001))


# Limits


async def limited(x: TlrStepper) -> None:
    x.enable()
    await x.set_soft_limits(-1.0, 2.0)


@virtual
async def test_soft_limits_count_only_after_homing() -> None:
    sim = SimTlr(machine=machine())
    async with stepper_on(sim) as x:
        await limited(x)
        assert await x.move_to(3.0) == 3.0
        await x.home(HERE)
        with pytest.raises(MoveFailed, match="at its positive soft limit"):
            await x.move_to(3.0)
        assert sim.shaft(now()) == pytest.approx(5.0, abs=0.001)
        assert (await x.status()).word & 32
        assert await x.move_to(-0.5) == -0.5
        with pytest.raises(MoveFailed, match="at its negative soft limit"):
            await x.move_to(-3.0)
        sim.power_cycle(now())
        await asyncio.sleep(1.0)
        assert not (await x.status()).homed


@virtual
async def test_soft_limits_of_an_axis_that_counts_the_other_way_round_and_without_any() -> None:
    sim = SimTlr(machine=machine())
    async with stepper_on(sim, reverse=True) as x:
        await limited(x)
        assert sim.memory.get(r.POSITIVE_SOFT_LIMIT) == 4000
        assert sim.memory.get(r.NEGATIVE_SOFT_LIMIT) == -8000
        await x.home(HERE)
        with pytest.raises(MoveFailed, match="soft limit"):
            await x.move_to(3.0)
        assert await x.position() == pytest.approx(2.0)
        await x.set_soft_limits()
        assert await x.move_to(3.0) == 3.0
        with pytest.raises(ValueError, match="wrong way round"):
            x.set_soft_limits(2.0, 1.0)
        with pytest.raises(ValueError, match="both limits"):
            x.set_soft_limits(2.0)


@pytest.mark.parametrize("how", list(LimitStop))
@virtual
async def test_a_limit_switch_stops_it_as_it_is_set_to(how: LimitStop) -> None:
    sim = SimTlr(machine=machine())
    async with stepper_on(sim) as x:
        x.enable()
        await x.set_limit_stop(how)
        with pytest.raises(MoveFailed, match=r"with inputs <Ports\.PORT_1: 2>\. A limit switch"):
            await x.move_to(20.0, rpm=600, acceleration=1200)
        past = 0.0 if how is LimitStop.EMERGENCY else 10 * 0.5 / 2
        assert sim.shaft(now()) - 6.0 == pytest.approx(past, abs=0.01)
        # Away from it, it goes; and it still knows where it is.
        assert await x.move_to(1.0) == 1.0
        assert sim.shaft(now()) == pytest.approx(1.0)
