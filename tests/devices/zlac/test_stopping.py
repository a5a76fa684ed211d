"""Stops, emergency stops and faults: what moves is stopped, what was told before does not go on."""

import asyncio

import pytest

from rs485bus import Move, MoveState
from rs485bus.devices.zlac.together import Both
from rs485bus.devices.zlac.values import ControlMode, ControlWord
from rs485bus.errors import (
    EmergencyStopped,
    MotionError,
    MoveCancelled,
    NotEnabled,
    NotSent,
    OutcomeUnknown,
    RearmRequired,
    StopUnconfirmed,
)
from tests.devices.zlac.plant import CONTROL, Plant, WatchedZlac, on_virtual_clock, plant, word

EMERGENCY_STOP = word(ControlWord.EMERGENCY_STOP)
ENABLE = word(ControlWord.ENABLE)


async def under_way(p: Plant, how: str) -> list[Both[float] | Move]:
    """Have both wheels turn in some way. Returns what they are carrying out."""
    moves: list[Both[float] | Move] = []
    if how == "velocity":
        await p.base.run(100, -100)
    elif how == "torque":
        await p.base.torque(2000, -2000, slope=4000)
        await asyncio.sleep(1.0)
    elif how == "together":
        moves = [p.base.move_to(50.0, -50.0, rpm=100)]
        await asyncio.sleep(2.0)
    else:
        moves = [p.base.left.move_to(50.0, rpm=100), p.base.right.move_to(-50.0, rpm=100)]
        await asyncio.sleep(2.0)
    assert all(abs(rpm) > 40 for rpm in p.rpm())
    return moves


async def all_failed(moves: list[Both[float] | Move]) -> None:
    """See each of them fail."""
    for move in moves:
        with pytest.raises((MotionError, NotSent)):
            await move


WAYS = ["velocity", "torque", "together", "one by one"]


@pytest.mark.parametrize("how", WAYS)
@pytest.mark.parametrize("smooth", [False, True])
@on_virtual_clock
async def test_a_stop_stops_both_wheels_and_the_next_command_is_taken(how: str, smooth: bool) -> None:
    async with plant(smooth_stop=smooth) as p:
        await under_way(p, how)
        await p.base.stop()
        assert await p.standing_for(2.0)
        there = p.shafts()
        await p.base.left.move_by(1.0)
        assert p.shafts() == pytest.approx((there[0] + 1, there[1]), abs=0.005)


@on_virtual_clock
async def test_a_speed_is_stopped_with_its_ramp_and_without_letting_go() -> None:
    async with plant(acceleration=100) as p:
        await p.base.run(100, 100)
        began = p.now
        await p.base.stop()
        assert p.now - began == pytest.approx(1.0, abs=0.15)
        assert EMERGENCY_STOP not in p.sim.writes()
        assert (await p.base.status()).enabled


@on_virtual_clock
async def test_a_smooth_stop_brings_a_position_to_a_stand_with_the_ramp() -> None:
    async with plant(smooth_stop=True, acceleration=100) as p:
        await under_way(p, "together")
        began = p.now
        await p.base.stop()
        assert p.now - began == pytest.approx(1.0, abs=0.15)
        assert EMERGENCY_STOP not in p.sim.writes()


@on_virtual_clock
async def test_one_wheel_at_a_speed_is_stopped_alone() -> None:
    async with plant() as p:
        await p.base.run(50, 50)
        await p.base.left.stop()
        assert p.rpm() == (0, 50)
        await p.base.left.run(-20)
        assert p.rpm()[1] == 50


@on_virtual_clock
async def test_a_stop_of_one_wheel_on_its_way_to_a_position_is_a_stop_of_both() -> None:
    async with plant() as p:
        left, right = p.base.left.move_to(10.0), p.base.right.move_to(10.0)
        await asyncio.sleep(1.0)
        await p.base.left.stop()
        assert await p.standing_for(1.0)
        for move in (left, right):
            with pytest.raises(MoveCancelled):
                await move
        await p.base.right.move_by(0.5)


@on_virtual_clock
async def test_cancelling_one_part_of_a_command_of_the_pair_stops_both() -> None:
    async with plant() as p:
        both = p.base.move_to(10.0, 10.0)
        await asyncio.sleep(1.0)
        both.left.cancel()  # type: ignore[attr-defined] # it is a move
        await asyncio.sleep(0.5)
        assert await p.standing_for(1.0)
        assert isinstance(both.right.error, MoveCancelled)


@on_virtual_clock
async def test_cancelling_what_waits_for_the_other_wheel_leaves_nobody_waiting() -> None:
    async with plant() as p:
        p.base.left.move_to(2.0)
        both = p.base.move_to(5.0, 5.0)
        after = p.base.right.move_to(1.0)
        await asyncio.sleep(0.5)
        both.cancel()
        for cancelled in (both, after):
            with pytest.raises(MoveCancelled):
                await cancelled
        await p.base.drain()
        await p.base.right.move_to(1.0)
        assert p.shafts() == (2.0, 1.0)


@on_virtual_clock
async def test_a_stop_drops_what_is_queued() -> None:
    async with plant() as p:
        moves = [p.base.left.move_to(1.0), p.base.left.move_to(2.0), p.base.right.move_to(1.0)]
        await asyncio.sleep(0.5)
        await p.base.stop()
        assert [move.state for move in moves] == [MoveState.CANCELLED] * 3
        assert await p.standing_for(2.0)


@pytest.mark.parametrize("how", WAYS)
@pytest.mark.parametrize("whose", ["wheel", "pair", "bus"])
@on_virtual_clock
async def test_after_an_emergency_stop_nothing_moves_before_enable_and_nothing_old_after_it(
    how: str, whose: str
) -> None:
    async with plant() as p:
        await under_way(p, how)
        if whose == "bus":
            assert (await p.bus.emergency_stop()).all_standing
            with pytest.raises(EmergencyStopped):
                p.base.run(10, 10)
            p.bus.clear_emergency_stop()
        else:
            await (p.base.left if whose == "wheel" else p.base).emergency_stop()
        assert await p.standing_for(1.0)
        refused: tuple[type[MotionError], ...] = (NotEnabled, RearmRequired)
        with pytest.raises(refused):
            await p.base.left.run(10)
        begun = len(p.sim.asked)
        await p.base.enable()
        assert await p.standing_for(3.0)
        check_targets_are_zeroed_before(p.sim.writes(begun))
        there = p.shafts()
        await p.base.move_by(0.5, 0.5)
        assert p.shafts() == pytest.approx((there[0] + 0.5, there[1] + 0.5), abs=0.005)


def check_targets_are_zeroed_before(writes: list[str]) -> None:
    """Every write of 0x08 comes after all targets were zeroed, and after a mode in which none can hold."""
    assert ENABLE in writes
    before = writes[: writes.index(ENABLE)]
    assert "1020880006" + "0C" + "00" * 12 in before  # speeds and positions
    assert "1020900002" + "04" + "00" * 4 in before  # torques
    assert before[-1] == f"06200D{ControlMode.VELOCITY:04X}"


@on_virtual_clock
async def test_nothing_older_of_the_other_wheel_follows_a_stop_that_stops_both() -> None:
    async with plant() as p:
        epochs = p.base.left.motion.epoch, p.base.right.motion.epoch
        p.base.attached.stops(p.base.left.motion, True)
        assert p.base.left.motion.epoch != epochs[0]
        assert p.base.right.motion.epoch != epochs[1]


@on_virtual_clock
async def test_an_emergency_stop_is_on_the_wire_at_once() -> None:
    async with plant() as p:
        await p.base.run(100, 100)
        for _ in range(30):
            asyncio.ensure_future(p.base.status()).add_done_callback(lambda done: done.exception())
        await asyncio.sleep(0.001)
        began = p.now
        p.bus.emergency_stop()
        await asyncio.sleep(0.5)
        sent = next(at for at, pdu in p.sim.asked if pdu == EMERGENCY_STOP and at >= began)
        assert sent - began < 0.02
        assert await p.standing_for(0.5)


@on_virtual_clock
async def test_a_lost_stop_is_said_again() -> None:
    async with plant() as p:
        await under_way(p, "together")
        p.sim.lose_request(EMERGENCY_STOP, times=2)
        await p.base.emergency_stop()
        assert await p.standing_for(1.0)
        assert p.sim.all_lost


@on_virtual_clock
async def test_a_stop_that_the_drive_does_not_obey_is_said_to_have_failed() -> None:
    async with plant() as p:
        await under_way(p, "velocity")
        p.sim.deaf_to_stops = True
        with pytest.raises(StopUnconfirmed, match="hard-wired"):
            await p.base.stop()
        with pytest.raises(RearmRequired):
            await p.base.left.run(1)
        p.sim.deaf_to_stops = False
        await asyncio.sleep(1.0)
        assert await p.standing_for(1.0)
        await p.base.enable()
        assert await p.standing_for(1.0)


@on_virtual_clock
async def test_standing_is_not_believed_of_a_run_bit_while_positions_change() -> None:
    async with plant(WatchedZlac(rpm_in_position_mode=False)) as p:
        await under_way(p, "together")
        p.sim.mute_run_bits = p.sim.deaf_to_stops = True
        with pytest.raises(StopUnconfirmed):
            await p.base.emergency_stop()
        p.sim.deaf_to_stops = False
        await asyncio.sleep(2.0)


@on_virtual_clock
async def test_enabling_waits_for_a_stop_that_is_still_under_way() -> None:
    async with plant(acceleration=50) as p:
        await p.base.run(100, 100)
        stopped, enabled = p.base.stop(), p.base.enable()
        await enabled
        assert stopped.done()
        assert await p.standing_for(1.0)


@on_virtual_clock
async def test_what_moved_for_somebody_else_is_stopped_before_it_is_enabled() -> None:
    sim = WatchedZlac(watchdog=0)
    async with plant(sim, enabled=False) as p:
        for frame in ("06200F0001", "06200D0001", "06200E0008", "10208A000408" + "00100000" * 2, "06200E0010"):
            sim.answer(bytes.fromhex(frame), p.now, broadcast=False)
        await asyncio.sleep(1.0)
        assert p.rpm()[0] > 0
        await p.base.enable()
        assert await p.standing_for(3.0)


@pytest.mark.parametrize("whose", ["wheel", "pair"])
@on_virtual_clock
async def test_a_stop_stops_what_moves_for_somebody_else_at_once(whose: str) -> None:
    async with plant(WatchedZlac(watchdog=0), enabled=False) as p:
        await p.base.set_up()
        for frame in ("06200F0001", "06200D0001", "06200E0008", "10208A000408" + "00100000" * 2, "06200E0010"):
            p.sim.answer(bytes.fromhex(frame), p.now, broadcast=False)
        p.base._drive.setup = None
        await p.base.set_up()
        await asyncio.sleep(1.0)
        began = p.now
        await (p.base if whose == "pair" else p.base.right).stop()
        assert p.now - began < 0.3
        assert await p.standing_for(1.0)


@on_virtual_clock
async def test_a_drive_that_stands_in_position_mode_is_not_let_go_of_when_a_block_ends() -> None:
    async with plant() as p:
        async with p.base.watchdog(0.5):
            await p.base.move_to(1.0, 1.0)
        assert EMERGENCY_STOP not in p.sim.writes()
        assert (await p.base.status()).enabled


@pytest.mark.parametrize("how", ["getting up to speed", "for a time"])
@on_virtual_clock
async def test_a_drive_that_falls_silent_while_it_runs_is_stopped_as_soon_as_it_hears_again(how: str) -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        run = p.base.run(
            200, 200, acceleration=50 if how != "for a time" else 1000, duration=None if how != "for a time" else 1.5
        )
        await asyncio.sleep(1.0)
        assert p.rpm()[0] > 40
        p.sim.dead = True
        await asyncio.sleep(3.0)
        assert run.done()
        p.sim.dead = False
        await asyncio.sleep(1.5)
        assert await p.standing_for(1.0)
        with pytest.raises((MotionError, OutcomeUnknown)):
            await run
        with pytest.raises((RearmRequired, NotEnabled)):
            await p.base.left.run(10)


@on_virtual_clock
async def test_leaving_the_bus_stops_what_moves() -> None:
    sim = WatchedZlac()
    async with plant(sim) as p:
        await under_way(p, "velocity")
        loop = asyncio.get_running_loop()
    assert all(halted.standing for halted in p.bus.stopped)
    assert sim.rpm(loop.time()) == (0, 0)


@on_virtual_clock
async def test_a_wheel_released_by_the_drive_itself_is_not_said_to_have_arrived() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        await p.base.run(50, 50)
        p.sim.answer(bytes.fromhex(CONTROL + "07"), p.now, broadcast=False)
        await asyncio.sleep(1.0)
        with pytest.raises(MotionError, match="not enabled any more"):
            await p.base.left.run(60)
