"""A drive that restarts counts from zero where it then stands. Nobody is to take that for the old zero."""

import random
from collections.abc import Callable
from contextlib import suppress

import anyio
import pytest

from rs485bus.devices.mks import Homed, SingleTurnHoming
from rs485bus.devices.mks import registers as r
from rs485bus.errors import NoReply, OutcomeUnknown, RearmRequired, ReferenceLost, StopUnconfirmed
from rs485bus.motion.silence import Silence
from rs485bus.sim.campaigns.faults.case import Case
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


# A drive that was set to zero, not homed, and is energised when it is switched on, shows nothing of a restart but that
# it counts from zero, and that it does not answer for a while.


@on_virtual_clock
async def test_a_drive_that_restarts_on_its_way_to_a_zero_that_was_set_has_not_arrived() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.set_zero()
        await on.axis.move_to(2.0)
        move = on.axis.move_to(0.0)
        await under_way(move, 0.2)
        on.sim.restart(on.bus.now())
        with pytest.raises(ReferenceLost, match="did not answer for a while"):
            await move
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_by(0.5)


@on_virtual_clock
async def test_a_drive_that_restarts_instead_of_starting_to_a_zero_that_was_set_has_not_arrived() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.set_zero()
        await on.axis.move_to(2.0)
        on.sim.instead(r.MOVE_TO_COUNTS, on.sim.restart)
        with pytest.raises(ReferenceLost, match="did not answer for a while"):
            await on.axis.move_to(0.0)
        assert on.shaft == pytest.approx(2.0, abs=1e-3)


@on_virtual_clock
async def test_a_drive_that_restarts_on_its_way_from_zero_is_not_said_to_stand_short_of_its_target() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.set_zero()
        move = on.axis.move_to(3.0)
        await under_way(move, 0.1)
        on.sim.restart(on.bus.now())
        with pytest.raises(ReferenceLost):
            await move
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(1.0)


@on_virtual_clock
async def test_a_drive_that_restarts_after_an_emergency_stop_does_not_travel() -> None:
    async with bench(FlakyMks()) as on:
        on.axis.move_to(9.0)
        await anyio.sleep(0.5)
        assert (await on.bus.emergency_stop()).all_standing
        on.bus.clear_emergency_stop()
        on.sim.restart(on.bus.now())
        await anyio.sleep(1)
        await on.axis.enable()
        stands = on.shaft
        with pytest.raises(ReferenceLost, match="nobody moved it"):
            await on.axis.move_to(0.5)
        assert on.shaft == stands


@on_virtual_clock
async def test_a_drive_that_restarts_during_a_relative_move_does_not_go_on_from_there() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.move_by_pulses(6400)
        move = on.axis.move_by_counts(-16384)
        await under_way(move, 0.06)
        on.sim.restart(on.bus.now())
        with pytest.raises(ReferenceLost):
            await move
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to_pulses(3200)


@on_virtual_clock
async def test_a_drive_that_restarts_on_its_direct_way_back_to_zero_has_not_returned() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.set_zero()
        await on.axis.move_to(4.0)
        move = on.axis.return_to_zero()
        await anyio.sleep(0.2)
        on.sim.restart(on.bus.now())
        with pytest.raises(ReferenceLost):
            await move


@on_virtual_clock
async def test_that_a_drive_homes_in_its_turn_when_it_is_switched_on_does_not_hide_that_it_was() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.home(SingleTurnHoming(set_zero_here=True))
        await on.axis.move_to(3.0)
        move = on.axis.move_to(0.0)
        await under_way(move, 0.2)
        on.sim.restart(on.bus.now())
        with pytest.raises(ReferenceLost):
            await move


@on_virtual_clock
async def test_a_few_lost_looks_on_the_way_to_zero_are_no_restart() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.set_zero()
        for _ in range(5):
            await on.axis.move_to(1.0)
            move = on.axis.move_to(0.0)
            await under_way(move, 0.05)
            on.sim.lose_request(r.POSITION, times=2)
            assert await move == pytest.approx(0.0, abs=1e-3)


@on_virtual_clock
async def test_a_drive_that_was_not_heard_for_a_while_and_is_not_near_zero_has_not_restarted() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.set_zero()
        move = on.axis.move_to(9.0)
        await under_way(move, 0.3)
        on.sim.lose_request(r.POSITION, times=3)
        assert await move == pytest.approx(9.0, abs=1e-3)


# A zero of which nobody knows whether it was set


@on_virtual_clock
async def test_a_zero_whose_answer_was_lost_again_and_again_is_settled_by_reading() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.move_to(1.0)
        on.sim.lose_reply(r.SET_ZERO, times=4)
        await on.axis.set_zero()
        await on.axis.move_by(0.5)
        assert on.shaft == pytest.approx(1.5, abs=1e-3)


@on_virtual_clock
async def test_a_zero_that_never_reached_the_drive_leaves_the_old_one() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.move_to(1.0)
        on.sim.lose_request(r.SET_ZERO, times=4)
        with pytest.raises(NoReply):
            await on.axis.set_zero()
        await on.axis.move_by(0.5)
        assert await on.axis.move_to(2.0) == pytest.approx(2.0, abs=1e-3)
        assert on.shaft == pytest.approx(2.0, abs=1e-3)


@on_virtual_clock
async def test_where_nobody_knows_whether_a_zero_was_set_no_position_is_gone_to() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.move_to(1.0)
        on.sim.lose_reply(r.SET_ZERO, times=4)
        on.sim.lose_request(r.POSITION, times=7)
        with pytest.raises(NoReply):
            await on.axis.set_zero()
        await anyio.sleep(2)
        await on.axis.enable()
        for start in (lambda: on.axis.move_to(2.0), lambda: on.axis.move_by(0.5)):
            with pytest.raises(ReferenceLost, match="whether its zero was set"):
                await start()
        await on.axis.set_zero()
        assert await on.axis.move_to(0.5) == pytest.approx(0.5, abs=1e-3)
        assert on.shaft == pytest.approx(1.5, abs=1e-3)


@on_virtual_clock
async def test_a_drive_that_restarts_while_it_is_stopped_on_its_first_way_from_zero_does_not_travel() -> None:
    """Where it is was not read between its start at zero and the restart, after which it counts from zero again."""
    async with bench(FlakyMks()) as on:
        on.axis.move_to(3.0)
        await anyio.sleep(0.04)
        on.sim.restart(on.bus.now())
        with suppress(StopUnconfirmed):
            await on.axis.stop()
        await anyio.sleep(1)
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(0.0)


@pytest.mark.parametrize("before", ["asked", "released"])
@on_virtual_clock
async def test_a_drive_that_restarts_before_its_first_move_or_while_it_is_released_does_not_travel(before: str) -> None:
    async with bench(FlakyMks()) as on:
        if before == "released":
            await on.axis.move_to(3.0)
            await on.axis.disable()
        else:
            on.sim.motion.zero -= 3.0  # it was there before this program
        assert await on.axis.position() == pytest.approx(3.0, abs=1e-3)
        await anyio.sleep(1)
        on.sim.restart(on.bus.now())
        await anyio.sleep(1)
        await on.axis.enable()
        stands = on.shaft
        with pytest.raises(ReferenceLost, match="stands at zero now"):
            await on.axis.move_to(2.0)
        assert on.shaft == stands


@on_virtual_clock
async def test_a_restart_is_not_taken_for_a_loss_of_the_line_by_which_the_next_one_is_excused() -> None:
    async with bench(FlakyMks()) as on:
        for _ in range(3):
            await on.axis.enable()
            await on.axis.set_zero()
            await on.axis.move_to(2.0)
            move = on.axis.move_to(0.0)
            await under_way(move, 0.2)
            on.sim.restart(on.bus.now())
            with pytest.raises(ReferenceLost):
                await move


def test_a_silence_is_one_that_the_line_does_not_explain() -> None:
    for share_lost, explained in ((0.0, 2), (0.1, 2), (0.3, 5)):
        silence, rng = Silence(), random.Random(1)
        for _ in range(500):
            if rng.random() < share_lost:
                silence.missed(0.0)
            else:
                silence.answered(0.1)
        silence.answered(0.1)
        for misses, is_silent in ((explained, False), (explained + 3, True)):
            for _ in range(misses):
                silence.missed(1.0)
            assert silence.answered(2.0) is is_silent
        for _ in range(9):
            silence.missed(3.0)
        assert not silence.answered(3.2)  # it was not waited for


def _unanswered(*sent_at: float) -> Silence:
    silence = Silence()
    for _ in range(50):
        silence.answered(0.0)
    for at in sent_at:
        silence.missed(at)
    return silence


def test_a_late_reply_shows_that_a_drive_has_not_restarted_since_it_was_asked() -> None:
    times = [1.0 + 0.1 * step for step in range(8)]
    silence = _unanswered(*times)
    silence.came_late(1.05)  # what was sent at 1.0
    assert not silence.answered(2.0)
    silence = _unanswered(*times)
    silence.came_late(1.65)  # it may have restarted before it was asked that
    assert silence.answered(2.0)
    silence = _unanswered(*times)
    silence.came_late(1.05)
    for at in (3.0, 3.1, 3.2, 3.3, 3.4):
        silence.missed(at)
    assert silence.answered(4.0)  # it restarts after that


def test_a_drive_that_answers_late_all_that_it_was_asked_has_not_restarted() -> None:
    silence = _unanswered(1.0, 1.1, 1.2, 1.3, 1.4)
    assert silence.answered(1.6)
    assert silence.came_late(1.4)  # one answer says little
    assert silence.came_late(1.4)
    assert silence.came_late(1.4)
    assert not silence.came_late(1.4)  # the first of as many answers was one to what was asked at 1.2 or before


def test_late_replies_to_what_was_missed_by_nobody_are_no_silence() -> None:
    silence = _unanswered()
    assert not any(silence.came_late(1.0) for _ in range(5))
    assert not silence.answered(2.0)


@pytest.mark.parametrize("frame", [5, 7, 9])
def test_a_late_reply_in_a_stream_near_zero_is_no_restart(frame: int) -> None:
    evidence = Case("mks", "stream-of-speeds", faults=(("reply-very-late", frame),)).run()
    assert not [call for call in evidence.calls if "ReferenceLost" in str(call)]


@on_virtual_clock
async def test_a_homed_drive_that_restarts_after_it_was_sent_back_to_zero_under_way_has_not_arrived() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.home()
        move = on.axis.move_to(3.0)
        await under_way(move, 0.3)
        await on.axis.retarget(0.0)
        await anyio.sleep(0.1)
        on.sim.restart(on.bus.now())
        with pytest.raises(ReferenceLost, match="forgotten that it was homed"):
            await move


@on_virtual_clock
async def test_the_mark_of_a_homed_drive_is_asked_for_where_it_stands_not_on_its_way() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.home()
        await on.axis.move_to(2.0)
        move = on.axis.move_to(0.0)
        await under_way(move, 0.2)
        assert (await on.axis.homed()).origin is Homed.DONE
        await on.axis.enabled()
        on.sim.restart(on.bus.now())
        with pytest.raises(ReferenceLost, match="forgotten that it was homed"):
            await move
