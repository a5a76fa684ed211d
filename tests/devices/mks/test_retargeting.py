"""A move under way gets another target, and never goes on from where nobody told it to."""

from collections.abc import Callable

import anyio
import pytest

from rs485bus.devices.mks import registers as r
from rs485bus.errors import DeviceRefused, MotionError, MoveCancelled, OutcomeUnknown, RearmRequired, ReferenceLost
from rs485bus.motion.move import Move, MoveState
from rs485bus.sim import Machine
from tests.devices.mks.bench import FlakyMks, bench, on_virtual_clock, under_way


@on_virtual_clock
async def test_a_move_under_way_gets_another_target_and_speed() -> None:
    async with bench(FlakyMks()) as on:
        move = on.axis.move_to(100.0, rpm=300, acceleration=1000)
        await under_way(move, 2.0)
        await on.axis.retarget(20.0, rpm=600)
        assert move.target == 20.0
        assert move.rpm == 600
        assert await move == pytest.approx(20.0, abs=1e-3)
        assert on.sim.moves == 2
        assert len(on.sent(r.RUN)) == 0
        assert move.eta is not None
        assert on.bus.now() == pytest.approx(move.eta, abs=0.2)


@on_virtual_clock
async def test_a_move_under_way_can_be_turned_round() -> None:
    async with bench(FlakyMks()) as on:
        move = on.axis.move_to(100.0, rpm=1200, acceleration=500)
        await under_way(move, 3.0)
        change = on.axis.retarget(-5.0, rpm=300)
        behind = on.axis.move_by(2.0)
        await change
        assert await move == pytest.approx(-5.0, abs=1e-3)
        assert await behind == pytest.approx(-3.0, abs=1e-3)
        assert move.eta is not None


@pytest.mark.parametrize("lost", ["request", "reply"])
@on_virtual_clock
async def test_a_change_of_target_whose_answer_is_lost_is_said_again_to_a_turning_motor(lost: str) -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        move = on.axis.move_to(50.0)
        await under_way(move, 1.0)
        (sim.lose_request if lost == "request" else sim.lose_reply)(r.MOVE_TO_COUNTS)
        await on.axis.retarget(10.0)
        assert await move == pytest.approx(10.0, abs=1e-3)


@on_virtual_clock
async def test_a_change_of_target_never_sets_a_drive_in_motion_that_restarted() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        await on.axis.move_to(5.0)
        move = on.axis.move_to(50.0)
        await under_way(move, 1.0)
        sim.restart(on.bus.now())
        stands = on.shaft

        await anyio.sleep(0.1)
        change = on.axis.retarget(10.0)  # nobody has noticed yet
        with pytest.raises(MoveCancelled, match="stood still"):
            await change
        with pytest.raises(ReferenceLost):
            await move
        assert on.shaft == stands


@on_virtual_clock
async def test_a_change_of_target_that_is_refused_leaves_the_move_alone() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        move = on.axis.move_to(10.0)
        await under_way(move, 0.5)
        sim.trip_latches = sim._tripped = True  # such a drive refuses everything
        with pytest.raises(DeviceRefused):
            await on.axis.retarget(20.0)
        assert await move == pytest.approx(10.0, abs=1e-3)


@on_virtual_clock
async def test_a_change_of_target_waits_until_the_motor_has_started() -> None:
    async with bench(FlakyMks(machine=Machine(start_delay=0.045))) as on:
        move = on.axis.move_to(10.0)
        for _ in range(100):
            await anyio.sleep(0.001)
            if move.state is MoveState.MOVING:
                break
        assert not on.sim.moving(on.bus.now())
        await on.axis.retarget(3.0)
        assert await move == pytest.approx(3.0, abs=1e-3)


@on_virtual_clock
async def test_a_change_of_target_is_not_said_again_to_a_drive_that_restarts_meanwhile() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        await on.axis.move_to(5.0)
        move = on.axis.move_to(50.0)
        await under_way(move, 1.0)
        sim.instead(r.MOVE_TO_COUNTS, sim.restart)
        stands = on.shaft
        change = on.axis.retarget(20.0)
        for handle in (change, move):
            with pytest.raises(ReferenceLost):
                await handle
        await anyio.sleep(2)
        assert on.shaft == pytest.approx(stands, abs=0.3)
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(1.0)


@on_virtual_clock
async def test_a_move_of_which_nobody_knows_where_it_goes_is_stopped() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        move = on.axis.move_to(100.0)
        await under_way(move, 1.0)
        sim.lose_reply(r.MOVE_TO_COUNTS, times=3)
        change = on.axis.retarget(50.0)
        for handle in (change, move):
            with pytest.raises(OutcomeUnknown):
                await handle
        assert not sim.moving(on.bus.now())
        with pytest.raises(RearmRequired):
            await on.axis.move_to(1.0)
        await on.axis.enable()
        await on.axis.move_to(1.0)


@on_virtual_clock
async def test_a_ramp_down_from_a_speed_that_was_changed_is_given_its_time() -> None:
    async with bench(FlakyMks()) as on:
        move = on.axis.move_to(1000.0, rpm=3000, acceleration=1000)
        await under_way(move, 4.0)
        await on.axis.retarget(1000.0, rpm=60, acceleration=1000)
        await on.axis.stop()
        assert not on.sent(r.EMERGENCY_STOP)


@on_virtual_clock
async def test_a_change_of_target_whose_answer_is_lost_is_done_where_the_axis_has_gone_there_meanwhile() -> None:
    async with bench(FlakyMks(), rpm=600, acceleration=20_000) as on:
        move = on.axis.move_to(2.0)
        await under_way(move, 0.06)
        on.sim.lose_reply(r.MOVE_TO_COUNTS)
        await on.axis.retarget(0.5)
        assert await move == pytest.approx(0.5, abs=1e-3)
        assert on.shaft == pytest.approx(0.5, abs=1e-3)


@on_virtual_clock
async def test_only_an_absolute_move_under_way_can_be_changed() -> None:
    async with bench(FlakyMks()) as on:
        axis = on.axis
        with pytest.raises(MotionError, match="under way"):
            axis.retarget(1.0)
        starts: list[Callable[[], Move]] = [
            lambda: axis.run(60, duration=3.0),
            lambda: axis.move_by_pulses(32_000),
        ]
        for start in starts:
            move = start()
            await under_way(move, 0.2)
            with pytest.raises(MotionError, match="under way"):
                axis.retarget(1.0)
            await axis.stop()
            with pytest.raises(MoveCancelled):
                await move


@on_virtual_clock
async def test_a_stop_ends_a_change_of_target_too() -> None:
    async with bench(FlakyMks()) as on:
        move = on.axis.move_to(50.0)
        await under_way(move, 1.0)
        change = on.axis.retarget(10.0)
        stop = on.axis.stop()
        with pytest.raises(MoveCancelled):
            await change
        with pytest.raises(MoveCancelled):
            await move
        await stop
        assert len(on.sent(r.MOVE_TO_COUNTS)) == 2  # the move, and its stop
