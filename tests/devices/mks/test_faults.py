"""What goes wrong ends in its documented exception, with the queue cancelled and the bus alive."""

import itertools
from contextlib import suppress
from typing import Any

import anyio
import pytest

from rs485bus.bus.handle import Handle
from rs485bus.devices.mks import Status, WorkMode
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.homing import StopHoming, SwitchHoming
from rs485bus.errors import (
    DeviceRefused,
    HomingFailed,
    LineBusy,
    MotionError,
    MotorStalled,
    MoveCancelled,
    MoveFailed,
    MoveTimeout,
    NotEnabled,
    RearmRequired,
    ReferenceLost,
)
from rs485bus.motion.move import Move
from rs485bus.sim import Machine, SimMks
from rs485bus.sim.treatment import Treatment
from tests.bus.test_noisy_line import bytes_without_end
from tests.devices.mks.bench import Bench, FlakyMks, bench, on_virtual_clock, under_way


async def fails(on: Bench, move: Move, error: type[Exception], match: str) -> str:
    """The move fails so, what is queued behind it is cancelled, and everybody on the bus still answers."""
    behind: list[Handle[Any]] = [on.axis.move_by(1.0), on.axis.enable()]
    with pytest.raises(error, match=match) as raised:
        await move
    for handle in behind:
        with pytest.raises(MoveCancelled, match="failed before it"):
            await handle
    await on.bus_is_alive()
    return str(raised.value)


@on_virtual_clock
async def test_a_stop_of_a_standing_motor_is_done_when_it_was_seen_standing() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.stop()
        await on.axis.emergency_stop()
        await on.axis.move_to(1.0)
        await on.axis.stop()  # the stop of the move that has ended: the drive refuses it (9.3.3)
        assert on.records[-1].outcome == "reply"
        assert any(record.outcome == "refused" for record in on.records)
        await on.axis.move_to(2.0)
        assert on.shaft == pytest.approx(2.0)


@on_virtual_clock
async def test_a_refused_move_is_said_to_be_so() -> None:
    async with bench(FlakyMks()) as on:
        # Somebody has changed its mode at its keys.
        on.sim.settings[r.WORK_MODE.address] = WorkMode.CR_VFOC
        await fails(on, on.axis.move_to(1.0), DeviceRefused, "Refused, in its reply")
        assert on.sim.moves == 0


@on_virtual_clock
async def test_a_move_of_a_motor_that_is_not_enabled_is_not_sent() -> None:
    async with bench(FlakyMks(enabled_at_power_on=False), enable=False) as on:
        await fails(on, on.axis.move_to(1.0), NotEnabled, r"enable\(\) it first")
        assert not on.sent(r.MOVE_TO_COUNTS)


@on_virtual_clock
async def test_a_motor_that_cannot_be_enabled_is_explained_by_what_its_screen_may_show() -> None:
    sim = FlakyMks(enabled_at_power_on=False)
    async with bench(sim, enable=False) as on:
        sim.motion.enable = lambda on, now: None  # type: ignore[method-assign] # a drive that cannot
        with pytest.raises(NotEnabled, match=r"Low Voltage Error!.*12 to 24 V"):
            await on.axis.enable()


@pytest.mark.parametrize("protected", [False, True])
@on_virtual_clock
async def test_a_stall_in_the_middle_of_a_move(protected: bool) -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.set_overcurrent_protection(protected)
        move = on.axis.move_to(20.0, rpm=600)
        on.bus.after(1.0, lambda: on.sim.put_load(9000, on.bus.now()))
        said = await fails(on, move, MotorStalled, "reports a stall")
        assert "release_stall()" in said
        assert "Wrong Protect!" in said
        # Freed, it must not jump to where it was sent.
        stands = on.shaft
        assert 0 < stands < 20
        on.sim.put_load(0, on.bus.now())
        await anyio.sleep(3)
        assert on.shaft == stands
        await on.axis.release_stall()
        await on.axis.enable()
        await on.axis.move_to(20.0)
        assert on.shaft == pytest.approx(20.0, abs=1e-3)  # it has counted on: nothing was lost


@on_virtual_clock
async def test_a_stall_that_cannot_be_released_says_so() -> None:
    sim = FlakyMks(machine=Machine(load=9000))
    async with bench(sim) as on:
        with pytest.raises(MotorStalled):
            await on.axis.move_to(1.0)
        sim.motion.release_stall = lambda: None  # type: ignore[method-assign] # a drive that cannot
        with pytest.raises(MotorStalled, match="still reports a stall"):
            await on.axis.release_stall()


@on_virtual_clock
async def test_a_stall_that_lasts_is_not_released() -> None:
    async with bench(FlakyMks(machine=Machine(load=9000))) as on:
        await on.axis.set_overcurrent_protection(True)
        with pytest.raises(MotorStalled):
            await on.axis.move_to(1.0)
        with pytest.raises(NotEnabled, match=r"Wrong Protect!.*release_stall\(\)"):
            await on.axis.enable()
        await on.axis.release_stall()
        await on.axis.enable()
        with pytest.raises(MotorStalled):
            await on.axis.move_to(1.0)


@on_virtual_clock
async def test_a_mechanical_stop_in_the_way_is_a_stall() -> None:
    async with bench(FlakyMks(machine=Machine(travel=(-5.0, 3.0)))) as on:
        await fails(on, on.axis.move_to(5.0), MotorStalled, "counts short of where it was sent")


@on_virtual_clock
async def test_a_limit_switch_in_the_way_fails_the_move_and_leaves_the_reference() -> None:
    async with bench(FlakyMks(machine=Machine(home_switch=-2.0))) as on:
        await on.axis.home(SwitchHoming(end_limits=True, rpm=600))
        await on.axis.move_to(5.0)
        await fails(on, on.axis.move_to(-3.0), MoveFailed, "at zero, with inputs")
        await on.axis.set_zero()
        await on.axis.move_to(5.0)
        on.sim.motion.machine.home_switch = 0.0  # two turns up: not where it counts from
        await fails(on, on.axis.move_to(1.0), MoveFailed, "limit switch")
        assert await on.axis.move_to(5.0) == pytest.approx(5.0, abs=1e-3)


@on_virtual_clock
async def test_a_homing_that_never_finds_its_switch() -> None:
    async with bench(FlakyMks(machine=Machine(home_switch=None))) as on:
        await fails(on, on.axis.home(timeout=5.0), HomingFailed, "within 5 s and was stopped")
        await anyio.sleep(1)
        assert not on.sim.moving(on.bus.now())
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(1.0)


@on_virtual_clock
async def test_a_homing_that_stalls() -> None:
    async with bench(FlakyMks(machine=Machine(home_switch=None, travel=(-3.0, 3.0)))) as on:
        await fails(on, on.axis.home(), HomingFailed, "without having found the origin. It reports a stall.")
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(1.0)


@on_virtual_clock
async def test_a_homing_is_not_taken_for_done_because_another_one_was() -> None:
    sim = FlakyMks(machine=Machine(home_switch=None, travel=(-3.0, 3.0)))
    async with bench(sim) as on:
        await on.axis.home(StopHoming(rpm=300))
        sim.motion.homed = (sim.motion.homed[1], sim.motion.homed[0])  # as after a single-turn homing
        await fails(on, on.axis.home(SwitchHoming(rpm=300)), HomingFailed, "without having found")


@on_virtual_clock
async def test_a_drive_that_goes_away_while_it_homes() -> None:
    sim = FlakyMks(machine=Machine(home_switch=-50.0))
    async with bench(sim, FlakyMks(2)) as on:
        move = on.axis.home(SwitchHoming(rpm=60))
        on.bus.after(2.0, lambda: sim.switch_off(on.bus.now()))
        with pytest.raises(HomingFailed, match="stopped answering"):
            await move
        await on.axes[1].move_to(1.0)
        sim.switch_on(on.bus.now())
        await anyio.sleep(10)
        with pytest.raises(RearmRequired):
            await on.axis.move_to(1.0)
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(1.0)


@pytest.mark.parametrize("enabled_at_power_on", [False, True])
@pytest.mark.parametrize("start", [0.0, 2.0])
@on_virtual_clock
async def test_a_drive_restarted_in_the_middle_of_a_queue(start: float, enabled_at_power_on: bool) -> None:
    sim = FlakyMks(enabled_at_power_on=enabled_at_power_on)
    async with bench(sim) as on:
        await on.axis.move_to(start)
        move = on.axis.move_to(20.0, rpm=600)
        on.bus.after(1.0, lambda: sim.restart(on.bus.now()))
        # From zero, too: it was seen on its way before.
        await fails(on, move, ReferenceLost, "may have restarted")
        stands = on.shaft
        await on.axis.enable()
        with pytest.raises(ReferenceLost, match=r"home\(\) it or set_zero\(\)"):
            await on.axis.move_to(1.0)
        await anyio.sleep(1)
        assert on.shaft == stands
        await on.axis.home()
        await on.axis.move_to(1.0)


@on_virtual_clock
async def test_a_drive_that_goes_away_in_the_middle_of_a_move_leaves_the_others_alone() -> None:
    sims = FlakyMks(1), FlakyMks(2)
    async with bench(*sims) as on:
        gone, other = on.axes
        moves = gone.move_to(20.0), other.move_to(20.0)
        on.bus.after(1.0, lambda: sims[0].switch_off(on.bus.now()))
        with pytest.raises(MoveFailed, match="stopped answering"):
            await moves[0]
        await moves[1]
        sims[0].switch_on(on.bus.now())
        await anyio.sleep(10)
        await gone.enable()
        with pytest.raises(ReferenceLost):
            await gone.move_to(1.0)
        await gone.set_zero()
        await gone.move_to(1.0)


@on_virtual_clock
async def test_a_move_that_does_not_end_in_time_is_stopped() -> None:
    async with bench(FlakyMks()) as on:
        # It turns at a tenth of the speed: its microsteps are not what was said.
        on.sim.settings[r.MICROSTEPS.address] = 160
        await fails(on, on.axis.move_to(20.0), MoveTimeout, "twice its time")
        await anyio.sleep(1)
        assert not on.sim.moving(on.bus.now())


@pytest.mark.parametrize("stuck", [Status.SLOWING_DOWN, Status.FULL_SPEED])
@on_virtual_clock
async def test_a_drive_whose_status_is_stuck_moves_stops_and_is_set_up_all_the_same(stuck: Status) -> None:
    async with bench(FlakyMks(stuck_status=stuck)) as on:
        await on.axis.move_to(1.0)
        await on.axis.move_by(1.0)
        await on.axis.stop()
        await on.axis.set_microsteps(32)
        await on.axis.home()
        assert on.shaft == pytest.approx(-2.0)


@on_virtual_clock
async def test_a_drive_whose_status_is_stuck_from_the_beginning_can_be_set_up() -> None:
    sim = FlakyMks(stuck_status=Status.SLOWING_DOWN)
    sim.motion.has_moved = True
    async with bench(sim, enable=False) as on:
        await on.axis.set_microsteps(32)


@on_virtual_clock
async def test_a_failure_nobody_has_seen_keeps_the_axis_from_going_on() -> None:
    async with bench(SimMks(machine=Machine(load=9000))) as on:
        move = on.axis.move_to(1.0)
        await anyio.sleep(5)
        with pytest.raises(MotionError, match="nobody has seen it"):
            on.axis.move_to(0.0)
        with pytest.raises(MotorStalled):
            await move


@on_virtual_clock
async def test_a_held_shaft_is_not_seen_to_stand_by_its_position_before_its_drive_has_heard_a_stop() -> None:
    for silent in (0.3, 0.4, 0.45, 0.5, 0.6, 1.0):
        async with bench(FlakyMks(), rpm=600, acceleration=20_000) as on:
            move = on.axis.move_to(9.0)
            await under_way(move, 0.1)
            on.sim.put_load(9000, on.bus.now())
            since = on.bus.now()

            def deaf(frame: bytes, now: float, until: float = since + silent) -> Treatment:
                return Treatment(heard=now > until)

            on.line.pair.script = deaf
            with suppress(MotionError):
                await on.axis.stop()
            await on.axis.enable()
            stands = on.shaft
            on.sim.put_load(0, on.bus.now())
            await anyio.sleep(2)
            assert on.shaft == pytest.approx(stands, abs=1e-3)


@on_virtual_clock
async def test_a_run_is_told_done_with_the_answer_that_shows_its_speed_and_asks_nothing_more() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        run = on.axis.run(150, acceleration=20_000)
        while run.started_at is None:
            assert not run.done()
            await anyio.sleep(0.001)
        sim.lose_request(r.POSITION, times=100)
        begun = on.bus.now()
        await run
        assert on.bus.now() - begun < 0.1
        sim.lose_nothing()


@on_virtual_clock
async def test_a_stop_on_a_line_that_is_never_quiet_is_seen_by_positions_too_and_told_within_a_second() -> None:
    async with bench(FlakyMks(), rpm=600, acceleration=20_000) as on:
        on.line.pair.lenient = True  # it hunts for frames
        await on.axis.run(300)
        on.line.babble(itertools.islice(bytes_without_end(1), 2000))
        await anyio.sleep(0.05)
        asked, begun = len(on.sent(r.POSITION)), on.bus.now()
        await on.axis.stop()
        assert on.bus.now() - begun < 0.9
        assert len(on.sent(r.POSITION)) == asked + 2
        await anyio.sleep(3)


@on_virtual_clock
async def test_a_motor_whose_command_fails_for_noise_is_stopped_without_asking_first_whether_it_stands() -> None:
    async with bench(FlakyMks(), rpm=600, acceleration=20_000) as on:
        on.line.pair.lenient = True
        await on.axis.run(300)
        on.line.babble(itertools.islice(bytes_without_end(2), 2000))
        await anyio.sleep(0.05)
        begun = on.bus.now()
        with pytest.raises(LineBusy):
            await on.axis.run(-300)
        await anyio.sleep(0.1)
        assert not on.sim.moving(on.bus.now())
        assert on.bus.now() - begun < 1.2
        await anyio.sleep(3)


@pytest.mark.parametrize("verb", ["run", "move"])
@on_virtual_clock
async def test_one_that_falls_silent_while_it_turns_is_told_soon_and_as_not_seen_standing(verb: str) -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        motion = on.axis.move_to(40.0) if verb == "move" else on.axis.run(60, duration=30)
        await anyio.sleep(2.0)
        receive, sim.receive = sim.receive, lambda frame, now: None  # type: ignore[method-assign]
        fell_silent = on.bus.now()
        with pytest.raises(MoveFailed, match=r"stopped answering .* could not be seen standing\. Look at the machine"):
            await motion
        assert on.bus.now() - fell_silent < 2.2
        assert on.sim.moving(on.bus.now())
        sim.receive = receive  # type: ignore[method-assign]
        await anyio.sleep(2.0)
        assert not on.sim.moving(on.bus.now())
