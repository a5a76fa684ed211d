"""Homing finds what it looks for, once, and counts from there."""

import anyio
import pytest

from rs485bus.devices.mks import Homed, Level, Model, ParameterDirection, SingleTurnHoming, StopHoming, SwitchHoming
from rs485bus.devices.mks import registers as r
from rs485bus.errors import HomingFailed, LimitExceeded, MotorStalled, NotEnabled, OutcomeUnknown, ReferenceLost
from rs485bus.sim import Machine
from tests.devices.mks.bench import FlakyMks, bench, on_virtual_clock


@on_virtual_clock
async def test_it_homes_by_a_switch() -> None:
    async with bench(FlakyMks(machine=Machine(home_switch=-3.0))) as on:
        assert await on.axis.home(SwitchHoming(rpm=300)) == 0.0
        assert on.shaft == pytest.approx(-3.0)
        assert await on.axis.position() == 0.0
        assert (await on.axis.homed()).origin is Homed.DONE
        await on.axis.move_by(1.0)
        assert on.shaft == pytest.approx(-2.0)


@on_virtual_clock
async def test_it_homes_by_a_switch_on_remapped_ports_of_the_other_level() -> None:
    async with bench(FlakyMks(machine=Machine(home_switch=-1.0, remapped=True))) as on:
        with pytest.raises(HomingFailed):
            await on.axis.home(SwitchHoming(rpm=300), timeout=3.0)
        await on.axis.set_limit_remap(True)
        await on.axis.enable()
        await on.axis.home(SwitchHoming(rpm=300, trigger=Level.HIGH))
        assert on.shaft == pytest.approx(-1.0)


@on_virtual_clock
async def test_it_homes_against_a_mechanical_stop_and_goes_back_by_an_offset() -> None:
    async with bench(FlakyMks(machine=Machine(home_switch=None, travel=(-4.0, 4.0)))) as on:
        await on.axis.home(StopHoming(rpm=300, current=800, offset_turns=0.25))
        assert on.shaft == pytest.approx(-3.75)
        await on.axis.home(StopHoming(direction=ParameterDirection.CCW, rpm=300))
        assert on.shaft == pytest.approx(3.5)


@on_virtual_clock
async def test_it_homes_to_the_zero_of_the_turn() -> None:
    async with bench(FlakyMks()) as on:
        begun = on.bus.now()
        await on.axis.set_homing(SingleTurnHoming(set_zero_here=True, speed=4))
        assert on.bus.now() - begun > 1.6  # the drive takes its time, and is waited for
        assert len(on.sent(r.SINGLE_TURN)) == 1
        await on.axis.move_by(2.3)
        await on.axis.home()
        assert on.shaft == pytest.approx(2.0)
        assert await on.axis.homed() == (Homed.DONE, Homed.NOT_DONE)


@on_virtual_clock
async def test_it_goes_straight_back_to_the_coordinate_zero() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.home()
        await on.axis.move_to(5.0)
        assert await on.axis.return_to_zero() == 0.0
        assert on.shaft == pytest.approx(-2.0)
        assert on.sent(r.GO_HOME)[-1] == bytes.fromhex("01 06 00 91 00 02 59 E6")


@pytest.mark.parametrize("way", ["home", "return_to_zero"])
@on_virtual_clock
async def test_a_motor_that_is_not_enabled_does_not_home(way: str) -> None:
    async with bench(FlakyMks(enabled_at_power_on=False), enable=False) as on:
        with pytest.raises(NotEnabled):
            await getattr(on.axis, way)()
        assert not on.sent(r.GO_HOME)


@pytest.mark.parametrize("lost", ["request", "reply"])
@pytest.mark.parametrize("way", ["home", "return_to_zero"])
@on_virtual_clock
async def test_a_homing_whose_start_is_lost_is_begun_once(way: str, lost: str) -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        await on.axis.move_to(3.0)
        moves = sim.moves
        (sim.lose_request if lost == "request" else sim.lose_reply)(r.GO_HOME)
        await getattr(on.axis, way)()
        assert sim.moves == moves + 1
        assert on.shaft == pytest.approx(0.0 if way == "return_to_zero" else -2.0)


@on_virtual_clock
async def test_a_homing_that_was_over_before_anybody_could_look_is_not_begun_again() -> None:
    sim = FlakyMks(shaft=-1.999, machine=Machine(home_switch=-2.0))
    async with bench(sim) as on:
        sim.lose_reply(r.GO_HOME)
        await on.axis.home(SwitchHoming(rpm=300))
        assert sim.moves == 1


@on_virtual_clock
async def test_a_return_to_zero_that_starts_late_is_waited_for() -> None:
    async with bench(FlakyMks(machine=Machine(start_delay=0.045))) as on:
        await on.axis.move_to(3.0)
        await on.axis.return_to_zero()
        assert on.shaft == pytest.approx(0.0)


@on_virtual_clock
async def test_a_drive_that_restarted_before_it_returned_to_zero_does_not_pretend_to_be_there() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        await on.axis.home()
        await on.axis.move_to(3.0)
        sim.instead(r.GO_HOME, sim.restart)
        with pytest.raises((ReferenceLost, OutcomeUnknown)):
            await on.axis.return_to_zero()
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(1.0)
        assert on.shaft == pytest.approx(1.0)  # where it stood: three turns above the switch at -2


@on_virtual_clock
async def test_homing_can_be_stopped_and_is_an_emergency_stop() -> None:
    async with bench(FlakyMks(machine=Machine(home_switch=None))) as on:
        move = on.axis.home()
        await anyio.sleep(1.0)
        await on.axis.stop()
        assert move.state.value == "cancelled"
        assert len(on.sent(r.EMERGENCY_STOP)) == 1
        assert not on.sim.moving(on.bus.now())


@on_virtual_clock
async def test_a_shaft_that_is_held_on_its_direct_way_back_does_not_go_on_when_it_is_free() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.move_to(2.0)
        way = on.axis.return_to_zero()
        await anyio.sleep(0.1)
        on.sim.put_load(9000, on.bus.now())
        with pytest.raises(MotorStalled, match="counts from zero"):
            await way
        stands = on.shaft
        on.sim.put_load(0, on.bus.now())
        await anyio.sleep(2)
        assert on.shaft == stands


@on_virtual_clock
async def test_homing_values_out_of_range_queue_nothing() -> None:
    async with bench(FlakyMks(), FlakyMks(2, model=Model.SERVO57D)) as on:
        for homing, said in (
            (SwitchHoming(rpm=3001), r"homing speed 3001 rpm is outside 0\.\.3000 rpm"),
            (StopHoming(current=3001), r"homing current 3001 mA is outside 0\.\.3000 mA of a SERVO42D"),
            (StopHoming(offset_turns=-1), r"origin offset -16384 counts is outside 0\.\.4294967295 counts"),
            (SingleTurnHoming(speed=5), r"homing speed 5 is outside 0\.\.4"),
        ):
            for verb in (on.axis.home, on.axis.set_homing):
                with pytest.raises(LimitExceeded, match=said):
                    verb(homing)
        await on.axes[1].set_homing(StopHoming(current=5200))
        assert not on.sent(r.GO_HOME)
        assert len(on.sent(r.HOMING)) == 1
