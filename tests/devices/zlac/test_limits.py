"""What the wheels cannot do is refused before anything is sent, with the way on in the message."""

import pytest

from rs485bus.devices.zlac import registers as r
from rs485bus.errors import LimitExceeded
from tests.devices.zlac.plant import WatchedZlac, on_virtual_clock, plant

LAST = r.MAX_ABSOLUTE / 4096
"""The highest absolute target, in turns."""
LONGEST = r.MAX_COUNTS / 4096


@on_virtual_clock
async def test_absolute_targets_end_at_0x3fffffff_counts_and_the_way_on_is_a_new_zero() -> None:
    async with plant() as p:
        begun = len(p.sim.asked)
        for target in (LAST + 1, -LAST - 1):
            with pytest.raises(LimitExceeded, match="set_zero"):
                p.base.left.move_to(target)
            with pytest.raises(LimitExceeded, match="set_zero"):
                p.base.move_to(0.0, target)
        assert not p.sim.writes(begun)
        p.base.left.move_to(LAST)
        await p.base.stop()


@on_virtual_clock
async def test_distances_end_with_their_register_and_the_way_on_is_a_new_zero() -> None:
    async with plant() as p:
        for distance in (LONGEST + 1, -LONGEST - 1):
            with pytest.raises(LimitExceeded, match="set_zero"):
                p.base.left.move_by(distance)
            with pytest.raises(LimitExceeded, match="set_zero"):
                p.base.move_by(distance, 0.0)


@on_virtual_clock
async def test_a_distance_that_ends_beyond_the_counter_is_refused_when_that_is_known() -> None:
    async with plant(WatchedZlac(counts=(r.MAX_COUNTS - 8192, 0))) as p:
        with pytest.raises(LimitExceeded, match="set_zero"):
            await p.base.left.move_by(3.0)
        await p.base.left.move_by(1.0)
        # From a position that is known it is refused at once.
        await p.base.right.move_to(1.0)
        with pytest.raises(LimitExceeded, match="set_zero"):
            p.base.right.move_by(LONGEST)


@on_virtual_clock
async def test_from_beyond_the_absolute_range_a_wheel_goes_on_by_distances_and_zero_is_the_way_back() -> None:
    far = r.MAX_ABSOLUTE + 10 * 4096
    async with plant(WatchedZlac(counts=(far, -far))) as p:
        await p.base.left.move_by(1.5)
        await p.base.move_by(-0.5, -2.0)
        assert p.shafts() == (1.0, -2.0)
        with pytest.raises(LimitExceeded):
            p.base.left.move_to(LAST + 10)
        await p.base.set_zero()
        await p.base.move_to(0.5, 0.5)
        assert p.shafts() == (1.5, -1.5)


@on_virtual_clock
async def test_limits_in_units_hold_for_both_wheels() -> None:
    async with plant(limits=(-1.0, 2.0)) as p:
        with pytest.raises(LimitExceeded, match="outside its limits"):
            p.base.move_to(0.0, 2.5)
        with pytest.raises(LimitExceeded, match="outside its limits"):
            await p.base.left.move_by(-1.5)
        await p.base.move_to(2.0, -1.0)


@on_virtual_clock
async def test_a_part_of_the_pair_that_is_refused_leaves_the_other_wheel_alone() -> None:
    async with plant(limits=(-5.0, 5.0)) as p:
        with pytest.raises(LimitExceeded):
            p.base.move_to(1.0, 6.0)
        await p.base.left.move_to(0.5)
        assert p.shafts() == (0.5, 0.0)


@pytest.mark.parametrize(
    ("asked", "drive", "least"), [(1000, 1000, 1000), (300, 1000, 300), (1000, 200, 200), (5000, 1000, 1000)]
)
@on_virtual_clock
async def test_the_speed_limit_is_the_least_of_what_was_asked_for_of_the_drive_and_of_3000(
    asked: float, drive: int, least: float
) -> None:
    sim = WatchedZlac()
    sim.set(r.SPEED_LIMIT, drive)
    async with plant(sim, max_rpm=asked) as p:
        assert (await p.base.set_up()).speed_limit == least
        with pytest.raises(LimitExceeded, match="rpm"):
            p.base.run(0, least + 1)
        with pytest.raises(LimitExceeded, match="rpm"):
            p.base.left.move_to(1.0, rpm=least + 1)
        await p.base.run(least, -least, acceleration=5000)
        assert p.rpm() == pytest.approx((least, -least), rel=0.03)


@on_virtual_clock
async def test_a_speed_that_the_drive_turns_out_not_to_allow_is_refused_before_it_is_sent() -> None:
    sim = WatchedZlac()
    sim.set(r.SPEED_LIMIT, 100)
    async with plant(sim, enabled=False) as p:
        enabled, run = p.base.enable(), p.base.run(500, 500)
        await enabled
        with pytest.raises(LimitExceeded):
            await run
        assert p.rpm() == (0, 0)


@on_virtual_clock
async def test_the_usual_speed_of_moves_is_no_more_than_the_drive_allows() -> None:
    sim = WatchedZlac()
    sim.set(r.SPEED_LIMIT, 20)
    async with plant(sim) as p:
        await p.base.move_to(0.2, 0.2)
        await p.base.run(15, 15)
        await p.base.run(0, 0)
        assert p.rpm() == (0, 0)


@on_virtual_clock
async def test_accelerations_become_ramp_times_and_the_real_one_is_told() -> None:
    async with plant() as p:
        move = p.base.left.move_to(1.0, rpm=70, acceleration=333)
        await move
        assert p.sim.value(r.ACCELERATION_TIME.left) == p.sim.value(r.DECELERATION_TIME.left) == 210
        assert move.acceleration == pytest.approx(70 / 0.210)
        jump = p.base.left.move_to(0.0, rpm=70, acceleration=float("inf"))
        await jump
        assert p.sim.value(r.ACCELERATION_TIME.left) == 0
        assert jump.acceleration == float("inf")
        with pytest.raises(LimitExceeded, match="32"):
            p.base.left.move_to(1.0, rpm=70, acceleration=2)


@on_virtual_clock
async def test_ramp_times_can_be_of_a_change_of_speed_that_the_drive_takes_them_for() -> None:
    async with plant(WatchedZlac(ramp_rpm=1000.0), ramp_rpm=1000.0) as p:
        began = p.now
        await p.base.run(100, 100, acceleration=50)
        assert p.now - began == pytest.approx(2.0, abs=0.2)
        await p.base.left.stop()
        assert p.sim.value(r.DECELERATION_TIME.left) == 20_000


@on_virtual_clock
async def test_slowing_down_a_little_leaves_a_ramp_that_fits_the_next_stop() -> None:
    async with plant(acceleration=100) as p:
        await p.base.run(100, 100)
        await p.base.run(90, 90)
        began = p.now
        await p.base.stop()
        assert p.now - began > 0.8


@on_virtual_clock
async def test_speeds_are_told_in_the_steps_that_the_drive_takes() -> None:
    async with plant(speed_resolution=10) as p:
        await p.base.run(12.34, -0.31)
        assert p.sim.value(r.TARGET_VELOCITY.left) == 123
        assert p.sim.value(r.TARGET_VELOCITY.right) == -3
        assert p.rpm() == pytest.approx((12.3, -0.3), abs=2)
        with pytest.raises(LimitExceeded, match=r"0\.3 rpm is the nearest"):
            p.base.left.run(0.26)


@pytest.mark.parametrize(("scaled", "told"), [(False, 50), (True, 500)])
@on_virtual_clock
async def test_whether_the_resolution_scales_the_speed_of_positions_is_an_option(scaled: bool, told: int) -> None:
    async with plant(speed_resolution=10, scaled_position_speed=scaled) as p:
        p.base.left.move_to(1.0, rpm=50)
        await p.base.left.drain()
        assert p.sim.value(r.POSITION_SPEED.left) == told


@on_virtual_clock
async def test_a_position_is_not_gone_to_faster_than_its_register_says() -> None:
    async with plant(max_rpm=3000) as p:
        p.base._drive.abilities[0].speed_limit = 3000.0  # a drive that allows more than the manual says
        with pytest.raises(LimitExceeded, match="1000 rpm for a position"):
            await p.base.left.move_to(1.0, rpm=1500)


@on_virtual_clock
async def test_durations_and_torques_have_their_ranges() -> None:
    async with plant() as p:
        with pytest.raises(LimitExceeded, match="duration"):
            p.base.left.run(10, duration=0)
        with pytest.raises(LimitExceeded, match="slope"):
            p.base.torque(0, 0, slope=70_000)
