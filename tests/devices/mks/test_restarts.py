"""A drive that restarts counts from zero where it then stands. Nobody is to take that for the old zero."""

from collections.abc import Callable

import anyio
import pytest

from rs485bus.devices.mks import registers as r
from rs485bus.errors import OutcomeUnknown, RearmRequired, ReferenceLost
from tests.devices.mks.bench import Bench, FlakyMks, bench, on_virtual_clock, under_way


def sink_and_restart(on: Bench) -> Callable[[float], None]:
    """The supply breaks down, the load sinks by half a turn, and the drive is there again."""

    def happen(now: float) -> None:
        on.sim.turn_shaft(-0.5, now)
        on.sim.restart(now)

    return happen


@on_virtual_clock
async def test_a_drive_that_restarted_while_it_stood_at_its_home_does_not_travel() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.home()
        await anyio.sleep(1)
        sink_and_restart(on)(on.bus.now())
        await anyio.sleep(1)
        stands = on.shaft
        for start in (lambda: on.axis.move_to(2.0), lambda: on.axis.move_by_counts(9000), on.axis.return_to_zero):
            with pytest.raises(ReferenceLost, match="home"):
                await start()
        assert on.shaft == stands
        await on.axis.home()
        assert await on.axis.move_to(2.0) == pytest.approx(2.0, abs=1e-3)


@on_virtual_clock
async def test_a_drive_at_its_home_that_restarted_between_a_move_and_its_repetition_does_not_travel() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.home()
        on.sim.instead(r.MOVE_TO_COUNTS, sink_and_restart(on))
        with pytest.raises(ReferenceLost, match="forgotten that it was homed"):
            await on.axis.move_to(2.0)
        assert on.shaft == pytest.approx(-2.0 - 0.5)  # its switch is at -2
        assert len(on.sent(r.MOVE_TO_COUNTS)) == 1


@on_virtual_clock
async def test_enabling_does_not_hide_that_a_drive_at_its_home_restarted() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.home()
        await anyio.sleep(1)
        sink_and_restart(on)(on.bus.now())
        await anyio.sleep(1)
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(2.0)
        assert not on.sent(r.MOVE_TO_COUNTS)


@on_virtual_clock
async def test_a_new_zero_after_a_restart_is_as_good_as_a_home() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.home()
        await anyio.sleep(1)
        sink_and_restart(on)(on.bus.now())
        await anyio.sleep(1)
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(2.0)
        await on.axis.set_zero()
        for target in (2.0, 0.0, 1.0, 0.0):
            assert await on.axis.move_to(target) == pytest.approx(target, abs=1e-3)


@on_virtual_clock
async def test_a_drive_that_restarts_on_its_way_to_a_zero_that_was_set_is_found_out_by_its_enabling() -> None:
    async with bench(FlakyMks(enabled_at_power_on=False)) as on:
        await on.axis.set_zero()
        await on.axis.move_to(50.0, rpm=3000)
        move = on.axis.move_to(0.0, rpm=300)
        await anyio.sleep(6.0)
        on.sim.restart(on.bus.now())
        with pytest.raises(ReferenceLost, match="may have restarted"):
            await move
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(1.0)


@on_virtual_clock
async def test_a_drive_that_restarted_on_its_way_to_zero_is_not_taken_for_one_that_came_there() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        await on.axis.home()
        await on.axis.move_to(50.0, rpm=3000)
        move = on.axis.move_to(0.0, rpm=300)
        await under_way(move, 6.0)
        sim.restart(on.bus.now())  # it counts from zero, where it stands
        with pytest.raises(ReferenceLost, match=r"may have restarted|forgotten that it was homed"):
            await move


# Speeds of a motor that turns


@pytest.mark.parametrize("rpm", [200, -100, 0])
@pytest.mark.parametrize("lost", ["request", "reply"])
@on_virtual_clock
async def test_another_speed_whose_answer_is_lost_is_said_again_to_a_turning_motor(lost: str, rpm: float) -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(100)
        (on.sim.lose_request if lost == "request" else on.sim.lose_reply)(r.RUN)
        await on.axis.run(rpm)
        await anyio.sleep(0.1)
        before, at = on.shaft, on.bus.now()
        await anyio.sleep(1.0)
        assert (on.shaft - before) / (on.bus.now() - at) * 60 == pytest.approx(rpm)


@on_virtual_clock
async def test_another_speed_is_not_said_again_to_a_drive_that_restarted() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(100)
        on.sim.instead(r.RUN, on.sim.restart)
        with pytest.raises(ReferenceLost):
            await on.axis.run(200)
        stands = on.shaft
        await anyio.sleep(2)
        assert on.shaft == stands


@on_virtual_clock
async def test_a_motor_of_which_nobody_knows_how_fast_it_turns_is_stopped() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(100)
        on.sim.lose_request(r.RUN, times=3)
        with pytest.raises(OutcomeUnknown):
            await on.axis.run(200)
        assert not on.sim.moving(on.bus.now())
        with pytest.raises(RearmRequired):
            await on.axis.run(200)
        await on.axis.enable()
        await on.axis.run(200)


@on_virtual_clock
async def test_a_run_for_a_time_that_is_lost_on_a_turning_motor_ends_with_the_motor_standing() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(100)
        on.sim.lose_request(r.RUN_FOR)
        await on.axis.run(200, duration=1.0)  # its speed shows that it was not told
        assert len(on.sent(r.RUN_FOR)) == 2 + 1
        await anyio.sleep(2)
        assert not on.sim.moving(on.bus.now())


@on_virtual_clock
async def test_a_drive_that_restarted_while_the_port_was_lost_does_not_travel() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.set_zero()
        await on.axis.move_to(5.0)
        on.line.unplug()
        on.sim.restart(on.bus.now())
        await anyio.sleep(1)
        on.line.plug()
        await anyio.sleep(1)
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(6.0)
        assert on.shaft == pytest.approx(5.0, abs=1e-3)
