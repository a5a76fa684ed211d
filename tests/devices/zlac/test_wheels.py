"""The wheels as axes, one by one and together: velocity, position, torque."""

import asyncio

import pytest

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.values import ControlMode, ControlWord
from rs485bus.errors import LimitExceeded, MoveCancelled, NotEnabled, NotStanding, NotSupported, ReferenceLost
from rs485bus.wire.frames import write_single
from tests.devices.zlac.plant import CONTROL, WatchedZlac, on_virtual_clock, plant, word

MODE = "06200D"


@on_virtual_clock
async def test_a_wheel_goes_to_positions_and_the_other_one_stays() -> None:
    async with plant() as p:
        move = p.base.left.move_to(2.0, rpm=100, acceleration=200)
        assert await move == pytest.approx(2.0, abs=0.001)
        assert p.shafts() == (2.0, 0.0)
        assert (move.rpm, move.acceleration) == (100, 200)
        assert await p.base.left.move_by(-0.5) == pytest.approx(1.5, abs=0.001)
        assert await p.base.right.move_to(-1.0) == pytest.approx(-1.0, abs=0.001)
        assert p.shafts() == (1.5, -1.0)


@on_virtual_clock
async def test_a_move_takes_the_time_its_ramps_and_its_speed_make() -> None:
    async with plant() as p:
        move = p.base.left.move_to(2.0, rpm=60, acceleration=120)
        await move
        assert move.started_at is not None
        assert move.eta is not None
        # 2 turns at 1 turn/s, and half a second for each of the two ramps of half a second.
        assert move.eta - move.started_at == pytest.approx(2.5)
        assert p.now - move.started_at == pytest.approx(2.5, abs=0.1)


@on_virtual_clock
async def test_both_wheels_move_at_once_when_each_is_told_on_its_own() -> None:
    async with plant() as p:
        left, right = p.base.left.move_to(2.0), p.base.right.move_to(-2.0)
        await asyncio.sleep(1.0)
        assert p.rpm() == (60, -60)
        await left
        await right
        assert p.shafts() == (2.0, -2.0)
        assert p.sim.writes().count(word(ControlWord.START_LEFT)) == 1
        assert p.sim.writes().count(word(ControlWord.START_RIGHT)) == 1


@on_virtual_clock
async def test_the_pair_starts_positions_with_one_synchronous_start() -> None:
    async with plant() as p:
        assert await p.base.move_to(1.0, -2.0) == pytest.approx((1.0, -2.0), abs=0.001)
        assert await p.base.move_by(0.5, 0.5) == pytest.approx((1.5, -1.5), abs=0.001)
        assert p.shafts() == (1.5, -1.5)
        starts = [write for write in p.sim.writes() if write.startswith(CONTROL) and int(write[-2:], 16) >= 0x10]
        assert starts == [word(ControlWord.START_BOTH)] * 2
        assert p.sim.moves == (2, 2)


@on_virtual_clock
async def test_a_command_of_the_pair_waits_for_both_wheels_and_they_wait_for_it() -> None:
    async with plant() as p:
        first, pair, last = p.base.left.move_to(1.0), p.base.move_to(2.0, 2.0), p.base.right.move_to(3.0)
        await first
        assert p.shafts() == (1.0, 0.0)
        await pair
        assert p.shafts() == (2.0, 2.0)
        await last
        assert p.shafts() == (2.0, 3.0)


@on_virtual_clock
async def test_wheels_run_at_speeds_and_are_slowed_down_to_a_stand() -> None:
    async with plant() as p:
        await p.base.left.run(100)
        assert p.rpm() == (100, 0)
        assert await p.base.left.velocity() == 100.0
        await p.base.run(-40, 80)
        assert p.rpm() == (-40, 80)
        await p.base.right.run(0)
        assert p.rpm() == (-40, 0)
        await p.base.run(0, 0)
        assert await p.standing_for(1.0)


@on_virtual_clock
async def test_slowing_down_from_a_high_speed_takes_as_long_as_its_ramp() -> None:
    async with plant() as p:
        await p.base.run(600, 600, acceleration=300)
        began = p.now
        await p.base.run(0, 0, acceleration=100)
        assert p.now - began == pytest.approx(6.0, abs=0.5)
        assert await p.standing_for(1.0)


@on_virtual_clock
async def test_one_frame_tells_both_wheels_their_speeds() -> None:
    async with plant() as p:
        await p.base.run(10, -10)
        assert [write for write in p.sim.writes() if write.startswith("102088")][-1] == "10208800020400" + "0AFFF6"


@on_virtual_clock
async def test_a_run_for_a_time_ends_with_both_wheels_standing() -> None:
    async with plant() as p:
        began = p.now
        await p.base.run(60, -60, duration=2.0)
        # Half a second up, 1.5 s at 1 turn/s, half a second down: 2 turns.
        assert p.now - began == pytest.approx(2.5, abs=0.2)
        assert await p.standing_for(1.0)
        assert p.shafts() == pytest.approx((2.0, -2.0), abs=0.05)


@on_virtual_clock
async def test_a_newer_speed_replaces_one_that_is_not_reached_yet() -> None:
    async with plant() as p:
        slow = p.base.run(100, 100, acceleration=10)
        await asyncio.sleep(0.5)
        waiting = p.base.run(90, 90)
        began = p.now
        await p.base.run(20, -20, replace=True)
        assert p.now - began < 1.0
        assert p.rpm() == pytest.approx((20, -20), abs=2)
        assert slow.done()
        with pytest.raises(MoveCancelled):
            await waiting


@on_virtual_clock
async def test_speeds_that_come_faster_than_they_are_reached_are_followed_all_the_same() -> None:
    async with plant() as p:
        for speed in range(100):
            p.base.run(speed, -speed, replace=True)
            await asyncio.sleep(0.023)
        assert p.rpm()[0] > 60
        await p.base.run(0, 0, replace=True)
        assert await p.standing_for(0.5)


@on_virtual_clock
async def test_torque_is_told_in_milliamperes_and_stops_with_the_wheel_standing() -> None:
    async with plant(reverse=(False, True)) as p:
        await p.base.torque(2000, 1000, slope=4000)
        await asyncio.sleep(2.0)
        seen = await p.base.snapshot()
        assert (seen.motion[0].torque, seen.motion[1].torque) == (2000, -1000)
        assert p.rpm() == (100, -50)
        assert p.sim.value(r.TORQUE_SLOPE.left) == p.sim.value(r.TORQUE_SLOPE.right) == 4000
        await p.base.left.torque(-500)
        assert p.sim.value(r.TARGET_TORQUE.left) == -500
        await p.base.stop()
        assert await p.standing_for(1.0)
        with pytest.raises(LimitExceeded, match="30000"):
            p.base.left.torque(30_001)


@on_virtual_clock
async def test_wheels_that_push_or_run_are_stopped_before_they_are_released() -> None:
    async with plant() as p:
        for push in (True, False):
            await (p.base.torque(1000, -1000, slope=5000) if push else p.base.run(100, 50))
            await asyncio.sleep(0.5)
            begun = len(p.sim.asked)
            await p.base.release()
            assert p.sim.writes(begun).count(word(ControlWord.RELEASE)) == 1
            assert not (await p.base.status()).enabled
            assert p.rpm() == (0, 0)
            await p.base.enable()


@on_virtual_clock
async def test_modes_are_entered_when_they_must_be_and_only_then() -> None:
    async with plant() as p:
        begun = len(p.sim.asked)
        for _ in range(3):
            await p.base.left.move_by(0.1)
            await p.base.right.move_by(0.1)
        writes = p.sim.writes(begun)
        assert [write for write in writes if write.startswith(MODE)] == [f"{MODE}0002"]
        assert not [write for write in writes if write.startswith("06200F")]
        # The ramps and the speed that the moves need were held before the second one: they are written once a wheel.
        assert len([write for write in writes if write.startswith("102080")]) <= 2
        await p.base.run(10, 10)
        await p.base.torque(100, 100)
        await p.base.move_by(1.0, 1.0)
        modes = [int(write[-1]) for write in p.sim.writes(begun) if write.startswith(MODE)]
        assert ControlMode.VELOCITY in modes
        assert modes[-1] == ControlMode.POSITION_ABSOLUTE


@on_virtual_clock
async def test_a_drive_that_must_be_enabled_after_a_change_of_mode_is() -> None:
    async with plant(WatchedZlac(mode_change_releases=True)) as p:
        await p.base.left.move_to(1.0)
        await p.base.run(20, 20)
        assert p.rpm() == (20, 20)
        await p.base.stop()
        await p.base.move_to(0.0, 0.0)
        assert p.shafts() == (0.0, 0.0)


@on_virtual_clock
async def test_a_change_of_mode_never_moves_a_wheel_by_an_old_target() -> None:
    async with plant() as p:
        await p.base.move_to(3.0, 3.0)
        await p.base.run(50, 50)
        await p.base.stop()
        there = p.shafts()
        await p.base.torque(0, 0)
        await p.base.stop()
        assert p.shafts() == there
        # Into position mode for the left wheel: the right one stays where it is.
        await p.base.left.move_by(0.1)
        assert p.shafts() == pytest.approx((there[0] + 0.1, there[1]), abs=0.002)


@on_virtual_clock
async def test_torque_mode_does_not_begin_with_the_torque_of_before() -> None:
    async with plant(WatchedZlac(watchdog=0), smooth_stop=True) as p:
        await p.base.torque(2000, 2000, slope=4000)
        await asyncio.sleep(1.0)
        await p.base.stop()
        there = p.shafts()
        p.sim.lose_request("1020900002" + "04" + "00010001", times=3)  # the new torque comes late
        again = p.base.torque(1, 1)
        await p.sim.lost_all()
        assert p.rpm() == (0, 0)
        assert p.shafts() == there
        await p.base.stop()
        with pytest.raises(MoveCancelled):
            await again


@on_virtual_clock
async def test_a_wheel_that_needs_another_mode_waits_until_the_other_wheel_has_arrived() -> None:
    async with plant() as p:
        move, run = p.base.left.move_to(2.0), p.base.right.run(50)
        await asyncio.sleep(1.0)
        assert p.rpm() == (60, 0)
        await move
        await run
        assert p.rpm() == (0, 50)
        assert p.shafts()[0] == 2.0


@on_virtual_clock
async def test_a_wheel_cannot_move_to_a_position_while_the_other_keeps_a_speed() -> None:
    async with plant() as p:
        await p.base.right.run(50)
        with pytest.raises(NotSupported, match="Stop that one first"):
            await p.base.left.move_to(1.0)
        assert p.rpm() == (0, 50)


@on_virtual_clock
async def test_one_wheel_enabled_is_both_and_one_released_is_both() -> None:
    async with plant(enabled=False) as p:
        with pytest.raises(NotEnabled):
            await p.base.right.move_to(1.0)
        await p.base.left.enable()
        await p.base.right.enable()
        await p.base.right.move_to(1.0)
        await p.base.left.disable()
        assert not (await p.base.status()).enabled
        with pytest.raises(NotEnabled):
            await p.base.right.move_to(2.0)


@on_virtual_clock
async def test_a_mirrored_wheel_counts_and_turns_the_other_way() -> None:
    async with plant(reverse=(False, True), units_per_turn=2.0) as p:
        await p.base.move_to(2.0, 2.0)
        assert p.shafts() == (1.0, -1.0)
        assert await p.base.right.position() == pytest.approx(2.0, abs=0.001)
        await p.base.run(30, 30)
        assert p.rpm() == (30, -30)
        assert await p.base.right.velocity() == 30


@on_virtual_clock
async def test_zero_is_set_for_the_counter_and_for_absolute_targets() -> None:
    async with plant() as p:
        await p.base.move_to(1.5, 2.5)
        await p.base.left.set_zero()
        assert await p.base.left.position() == 0
        await p.base.left.move_to(1.0)
        assert p.shafts() == (2.5, 2.5)
        await p.base.set_zero()
        await p.base.move_to(-0.5, -0.5)
        assert p.shafts() == (2.0, 2.0)


@on_virtual_clock
async def test_a_wheel_pushed_by_hand_is_not_where_the_facade_believes() -> None:
    async with plant() as p:
        await p.base.move_to(1.0, 1.0)
        await asyncio.sleep(0.5)
        p.sim.left.motor.place(1.5, p.now)
        with pytest.raises(ReferenceLost):
            await p.base.left.move_to(0.0)


@on_virtual_clock
async def test_speeds_are_read_in_position_mode_from_firmware_that_does_not_report_them() -> None:
    async with plant(WatchedZlac(rpm_in_position_mode=False)) as p:
        await p.base.left.move_to(2.0)
        assert p.shafts() == (2.0, 0.0)
        move = p.base.move_to(0.0, 5.0)
        await asyncio.sleep(1.0)
        await p.base.stop()
        assert await p.standing_for(1.0)
        with pytest.raises(MoveCancelled):
            await move


@on_virtual_clock
async def test_which_half_of_the_status_word_is_whose_makes_no_difference_to_a_move() -> None:
    async with plant(WatchedZlac(status_word_left="high")) as p:
        await p.base.right.run(50)
        await p.base.left.run(20)
        await p.base.left.run(0)
        assert p.rpm() == (0, 50)
        await p.base.left.stop()
        assert p.rpm() == (0, 50)
        await p.base.stop()
        await p.base.left.move_by(1.0)
        await p.base.right.move_by(1.0)
        assert p.sim.moves == (1, 1)


@on_virtual_clock
async def test_there_is_one_facade_for_an_address_and_none_for_node_zero() -> None:
    from rs485bus import Zlac8015d
    from rs485bus.errors import AddressInUse

    async with plant(enabled=False) as p:
        with pytest.raises(AddressInUse):
            Zlac8015d(p.bus, 1)
        for address in (0, 128):
            with pytest.raises(ValueError, match=r"1\.\.127"):
                Zlac8015d(p.bus, address)


@on_virtual_clock
async def test_a_wheel_is_not_waited_for_that_somebody_else_keeps_turning() -> None:
    async with plant() as p:
        await p.base.run(30, 30)
        await p.base.stop()
        p.sim.receive(write_single(1, 0x2089, 30).adu, p.now)  # another master: the right one
        for _ in range(3):
            await asyncio.sleep(0.3)
            await p.base.status()
        began = p.now
        with pytest.raises(NotStanding, match=r"another axis of its drive.* stop\(\) it"):
            await p.base.left.move_to(1.0)
        assert p.now - began < 4.0
        await p.base.right.stop()
        await p.base.left.move_to(1.0)


@on_virtual_clock
async def test_a_wheel_is_waited_for_as_long_as_it_does_what_it_was_told() -> None:
    async with plant() as p:
        await p.base.left.run(30)
        await p.base.left.stop()
        running = p.base.right.run(30, duration=8.0)
        await asyncio.sleep(0.5)
        await p.base.left.move_to(1.0)
        assert running.done()
        assert running.error is None
