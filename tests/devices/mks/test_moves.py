"""Moves happen once, at the speed asked for, to where they were sent."""

import math
from collections.abc import Callable

import anyio
import pytest

from rs485bus import BusConfig
from rs485bus.devices.mks import MotionDirection, WorkMode
from rs485bus.devices.mks import registers as r
from rs485bus.errors import (
    LimitExceeded,
    MoveCancelled,
    NotSupported,
    OutcomeUnknown,
    RearmRequired,
    ReferenceLost,
)
from rs485bus.motion.move import Move
from rs485bus.sim import Machine
from rs485bus.wire.registers import Block
from tests.devices.mks.bench import FlakyMks, bench, on_virtual_clock, under_way

TURN = r.COUNTS_PER_TURN


# Speeds


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("microsteps", [8, 16, 32, 64, 128])
@on_virtual_clock
async def test_the_shaft_turns_at_the_rpm_asked_for_at_any_microsteps(microsteps: int, reverse: bool) -> None:
    async with bench(FlakyMks(microsteps=microsteps), microsteps=microsteps, reverse=reverse) as on:
        for rpm in (60, -120, 300):
            await on.axis.run(rpm)

            before, at = on.shaft, on.bus.now()
            await anyio.sleep(1.0)
            turned = (on.shaft - before) / (on.bus.now() - at) * 60
            assert turned == pytest.approx(-rpm if reverse else rpm)
            assert await on.axis.velocity() == rpm
        await on.axis.stop()
        move = on.axis.move_by(10.0, rpm=200, acceleration=math.inf)
        await move
        assert move.eta is not None
        assert move.started_at is not None
        assert move.eta - move.started_at == pytest.approx(3.0)  # ten turns at 200 rpm
        assert on.bus.now() - move.eta < 0.2


@pytest.mark.parametrize(("microsteps", "highest"), [(8, 3000), (16, 3000), (128, 375)])
@on_virtual_clock
async def test_the_highest_speed_is_what_the_drive_can_be_told(microsteps: int, highest: int) -> None:
    async with bench(FlakyMks(microsteps=microsteps), microsteps=microsteps) as on:
        await on.axis.run(highest, acceleration=20_000)
        assert await on.axis.velocity() == highest
        with pytest.raises(LimitExceeded, match=rf"above 0, up to {highest} \(mode SR_VFOC at {microsteps}"):
            on.axis.run(highest + 1)


@pytest.mark.parametrize(
    ("mode", "highest"), [(WorkMode.SR_OPEN, 400), (WorkMode.SR_CLOSE, 1500), (WorkMode.SR_VFOC, 3000)]
)
@on_virtual_clock
async def test_each_mode_has_its_highest_speed(mode: WorkMode, highest: int) -> None:
    async with bench(FlakyMks(mode=mode), mode=mode) as on:
        with pytest.raises(LimitExceeded, match=rf"above 0, up to {highest} \(mode {mode.name}"):
            on.axis.move_to(1, rpm=highest + 1)
        await on.axis.move_to(1, rpm=highest)


@on_virtual_clock
async def test_moves_behind_a_change_of_microsteps_reckon_with_it() -> None:
    async with bench(FlakyMks()) as on:
        on.axis.set_microsteps(128)
        move = on.axis.move_by(5.0, rpm=100, acceleration=math.inf)
        await move
        assert on.sent(r.MOVE_TO_COUNTS)[0][9:11] == (800).to_bytes(2, "big")
        assert move.eta is not None
        assert on.bus.now() == pytest.approx(move.eta, abs=0.2)
        with pytest.raises(LimitExceeded, match="up to 375 "):
            on.axis.move_to(0, rpm=400)


@on_virtual_clock
async def test_a_run_for_a_time_ends_by_itself() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(60, acceleration=math.inf, duration=2.5)
        assert on.shaft == pytest.approx(2.5)
        assert on.sent(r.RUN_FOR)[0][4:6] == b"\x00\x04"  # four registers, at the address of two


@on_virtual_clock
async def test_a_run_at_0_stops_a_motor_and_is_content_with_one_that_stands() -> None:
    async with bench(FlakyMks()) as on:
        await on.axis.run(0)  # refused: it was not turning
        await on.axis.run(300)
        await on.axis.run(0)
        assert not on.sim.moving(on.bus.now())


@on_virtual_clock
async def test_run_goes_the_way_of_move_to_whichever_direction_that_is() -> None:
    async with bench(FlakyMks(), positive=MotionDirection.CW) as on:
        await on.axis.run(60)
        assert on.sent(r.RUN)[0][7] == MotionDirection.CW


# Past the range of absolute targets


@on_virtual_clock
async def test_past_the_32_bits_of_absolute_targets_it_says_how_to_go_on() -> None:
    sim = FlakyMks(machine=Machine(home_switch=None))
    sim.motion.zero -= 120_000  # turns; it would take forty minutes to make them
    async with bench(sim) as on:
        axis = on.axis

        await axis.run(3000, acceleration=20_000)
        await anyio.sleep(4 * 60)
        await axis.stop()
        assert await axis.position() > 131_072
        assert await axis.counts() > 0x7FFF_FFFF
        with pytest.raises(LimitExceeded, match=r"set_zero\(\)") as refused:
            await axis.move_by(1.0)
        assert "-131072..131071.9999" in str(refused.value)
        with pytest.raises(LimitExceeded, match=r"set_zero\(\)"):
            axis.move_to(131_072.5)
        # A relative command goes on even there; and from a new zero everything does.
        before = on.shaft
        await axis.move_by_counts(TURN)
        assert on.shaft - before == pytest.approx(1, abs=1e-3)
        await axis.set_zero()
        assert await axis.move_by(1.0) == pytest.approx(1.0, abs=1e-3)


@on_virtual_clock
async def test_negative_coordinates_beyond_32_bits_are_read_right() -> None:
    async with bench(FlakyMks(machine=Machine(home_switch=None))) as on:
        on.sim.motion.zero += 200_000
        assert await on.axis.counts() == -200_000 * TURN
        assert await on.axis.position() == -200_000


# Exactly once


@pytest.mark.parametrize("lost", ["request", "reply"])
@on_virtual_clock
async def test_a_move_whose_start_is_lost_happens_once(lost: str) -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        (sim.lose_request if lost == "request" else sim.lose_reply)(r.MOVE_TO_COUNTS)
        assert await on.axis.move_by(3.0) == pytest.approx(3.0, abs=1e-3)
        assert sim.moves == 1
        assert len(on.sent(r.MOVE_TO_COUNTS)) == (2 if lost == "request" else 1)


@pytest.mark.parametrize("what", [r.MOVE_PULSES, r.MOVE_COUNTS], ids=lambda what: what.name)
@pytest.mark.parametrize("lost", ["request", "reply"])
@pytest.mark.parametrize("turns", [0.05, 3.0])
@on_virtual_clock
async def test_a_relative_move_whose_start_is_lost_happens_once(what: Block, lost: str, turns: float) -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        (sim.lose_request if lost == "request" else sim.lose_reply)(what)
        if what is r.MOVE_PULSES:
            await on.axis.move_by_pulses(round(turns * 3200))
        else:
            await on.axis.move_by_counts(round(turns * TURN))
        assert on.shaft == pytest.approx(turns, abs=1e-3)
        assert sim.moves == 1


@on_virtual_clock
async def test_a_relative_move_is_not_repeated_before_it_can_have_started() -> None:
    # Its reply is lost, and it starts only when the bus has given it up already.
    sim = FlakyMks(machine=Machine(start_delay=0.045))
    async with bench(sim) as on:
        on.axis.attached.reply_timeout = None
        on.bus.owner.units[1].reply_timeout = 0.005
        sim.lose_reply(r.MOVE_PULSES)
        await on.axis.move_by_pulses(3200)
        assert on.shaft == pytest.approx(1.0)
        assert sim.moves == 1


@pytest.mark.parametrize("lost", ["request", "reply"])
@on_virtual_clock
async def test_a_relative_move_too_short_to_be_seen_is_not_repeated_blindly(lost: str) -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        (sim.lose_request if lost == "request" else sim.lose_reply)(r.MOVE_PULSES)
        with pytest.raises(OutcomeUnknown):
            await on.axis.move_by_pulses(1)
        assert sim.moves == (0 if lost == "request" else 1)
        with pytest.raises(RearmRequired):
            await on.axis.move_by(1.0)
        await on.axis.enable()
        await on.axis.move_by(1.0)


@pytest.mark.parametrize("enabled_at_power_on", [True, False])
@pytest.mark.parametrize("way", ["absolute", "pulses", "counts"])
@on_virtual_clock
async def test_a_drive_that_restarted_between_a_move_and_its_repetition_does_not_travel(
    way: str, enabled_at_power_on: bool
) -> None:
    sim = FlakyMks(enabled_at_power_on=enabled_at_power_on)
    async with bench(sim) as on:
        await on.axis.move_to(5.0)
        what = {"absolute": r.MOVE_TO_COUNTS, "pulses": r.MOVE_PULSES, "counts": r.MOVE_COUNTS}[way]
        sim.instead(what, sim.restart)
        move = {
            "absolute": lambda: on.axis.move_to(8.0),
            "pulses": lambda: on.axis.move_by_pulses(9600),
            "counts": lambda: on.axis.move_by_counts(3 * TURN),
        }[way]()
        behind = on.axis.move_by(1.0)
        with pytest.raises(ReferenceLost, match="restarted"):
            await move
        with pytest.raises(MoveCancelled):
            await behind
        assert on.shaft == pytest.approx(5.0)
        assert sim.moves == 1
        await on.axis.enable()
        with pytest.raises(ReferenceLost, match=r"home\(\) it or set_zero\(\)"):
            await on.axis.move_to(8.0)
        assert on.shaft == pytest.approx(5.0)
        await on.axis.set_zero()
        await on.axis.move_to(1.0)
        assert on.shaft == pytest.approx(6.0, abs=1e-3)
        await on.bus_is_alive()


@on_virtual_clock
async def test_a_drive_that_restarted_is_not_taken_for_one_that_arrived_at_zero() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        await on.axis.move_to(50.0, rpm=3000)
        sim.instead(r.MOVE_TO_COUNTS, sim.restart)
        with pytest.raises(ReferenceLost, match="sooner than it can"):
            await on.axis.move_to(0.0, rpm=300)
        assert on.shaft == pytest.approx(50.0)


@on_virtual_clock
async def test_a_drive_that_stays_away_when_a_move_starts_has_lost_its_reference() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        await on.axis.move_to(5.0)
        sim.instead(r.MOVE_TO_COUNTS, sim.switch_off)
        with pytest.raises(OutcomeUnknown):
            await on.axis.move_to(8.0)
        sim.switch_on(on.bus.now())

        await anyio.sleep(10)
        await on.axis.enable()
        with pytest.raises(ReferenceLost):
            await on.axis.move_to(8.0)
        assert on.shaft == pytest.approx(5.0)


@on_virtual_clock
async def test_a_watched_drive_that_restarts_is_not_taken_for_one_that_arrived_at_zero() -> None:
    sim = FlakyMks()
    async with bench(sim) as on:
        await on.axis.move_to(50.0, rpm=3000)
        async with on.axis.watchdog(6.0):
            move = on.axis.move_to(0.0, rpm=150)
            await under_way(move, 1.0)
            sim.restart(on.bus.now())  # the next feed hears that it stands, and it reads zero there
            with pytest.raises(ReferenceLost, match="sooner than it can"):
                await move


@on_virtual_clock
async def test_a_drive_that_says_late_that_it_has_arrived_did_not_restart() -> None:
    sim = FlakyMks()
    async with bench(sim, config=BusConfig(reply_timeout=1.0)) as on:
        sim.lose_reply(r.MOVE_TO_COUNTS)
        sim.lose_reply(r.STATUS, times=2)
        await on.axis.move_to(28.0, rpm=600, acceleration=math.inf)  # 2.8 s, and it is heard of after 3
        assert sim.moves == 1


@on_virtual_clock
async def test_a_speed_that_the_mode_does_not_have_any_more_is_not_sent() -> None:
    async with bench(FlakyMks()) as on:
        on.axis.set_mode(WorkMode.SR_OPEN)
        move = on.axis.move_to(1.0, rpm=1000)  # checked against the mode in force
        with pytest.raises(LimitExceeded, match=r"above 0, up to 400 \(mode SR_OPEN"):
            await move
        assert not on.sent(r.MOVE_TO_COUNTS)


# In pulses and counts


@pytest.mark.parametrize("microsteps", [1, 16, 50, 128, 255])
@pytest.mark.parametrize("reverse", [False, True])
@on_virtual_clock
async def test_pulses_and_counts_go_as_far_as_they_say(microsteps: int, reverse: bool) -> None:
    sim = FlakyMks(microsteps=microsteps)
    async with bench(sim, microsteps=microsteps, reverse=reverse, rpm=100) as on:
        way = -1 if reverse else 1
        turn = 200 * microsteps
        move = on.axis.move_by_pulses(3 * turn)
        assert await move == pytest.approx(3, abs=1e-3)
        assert move.target == pytest.approx(3, abs=1e-3)
        assert on.shaft == pytest.approx(3 * way)
        await on.axis.move_by_pulses(-turn)
        assert on.shaft == pytest.approx(2 * way)
        await on.axis.move_to_pulses(-turn)
        assert on.shaft == pytest.approx(-1 * way)
        assert await on.axis.pulses() == -turn * way % 0x1_0000_0000
        await on.axis.move_by_counts(-TURN // 2)
        assert on.shaft == pytest.approx(-1.5 * way)
        assert await on.axis.position() == -1.5


@on_virtual_clock
async def test_limits_hold_for_pulses_and_counts_too() -> None:
    async with bench(FlakyMks(), limits=(-1.0, 2.0)) as on:
        starts: list[Callable[[], Move]] = [
            lambda: on.axis.move_by_pulses(3200 * 3),
            lambda: on.axis.move_to_pulses(-3200 * 2),
            lambda: on.axis.move_by_counts(TURN * 3),
        ]
        for start in starts:
            with pytest.raises(LimitExceeded, match=r"outside its limits -1\.\.2"):
                await start()
        assert on.sim.moves == 0


@on_virtual_clock
async def test_each_kind_of_move_is_stopped_by_its_own_stop_with_its_ramp() -> None:
    async with bench(FlakyMks()) as on:
        axis = on.axis
        kinds: list[tuple[Block, Callable[[], Move]]] = [
            (r.MOVE_PULSES, lambda: axis.move_by_pulses(320_000, acceleration=1000)),
            (r.MOVE_TO_PULSES, lambda: axis.move_to_pulses(320_000, acceleration=1000)),
            (r.MOVE_COUNTS, lambda: axis.move_by_counts(100 * TURN, acceleration=1000)),
            (r.MOVE_TO_COUNTS, lambda: axis.move_by(100, acceleration=1000)),
            (r.RUN, lambda: axis.run(900, acceleration=1000)),
        ]
        for what, start in kinds:
            move = start()
            await under_way(move, 0.5)
            await axis.stop()
            stop = on.sent(what)[-1]
            assert int.from_bytes(stop[9:11], "big") == 0, what.name  # speed
            assert stop[8] == 236, what.name  # the acceleration of 1000 rpm/s
            assert not on.sim.moving(on.bus.now())
        assert not on.sent(r.EMERGENCY_STOP)


# Modes


@on_virtual_clock
async def test_a_pulse_mode_is_not_moved_over_the_bus() -> None:
    async with bench(FlakyMks(mode=WorkMode.CR_VFOC), enable=False, mode=WorkMode.CR_VFOC) as on:
        for verb in (on.axis.enable, lambda: on.axis.move_to(1.0), lambda: on.axis.run(60), on.axis.home):
            with pytest.raises(NotSupported, match=r"set_mode\(WorkMode\.SR_VFOC\)"):
                await verb()
        on.axis.set_mode(WorkMode.SR_VFOC)
        on.axis.enable()
        await on.axis.move_to(1.0)
        assert on.shaft == pytest.approx(1.0)
