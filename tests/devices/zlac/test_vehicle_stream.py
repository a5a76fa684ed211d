"""A vehicle that is told how to go by a stream, and where it then believes it is."""

import asyncio
import math
from typing import Any

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from rs485bus import DifferentialDrive
from rs485bus.devices.zlac.odometry import Pose
from rs485bus.devices.zlac.values import Fault, Side
from rs485bus.errors import DriveFault, LimitExceeded
from rs485bus.motion.streaming import STEP
from rs485bus.sim import Noise
from tests.devices.zlac.plant import WatchedZlac, on_virtual_clock, plant
from tests.devices.zlac.test_differential import RADIUS, TRACK, Truth


@on_virtual_clock
async def test_what_is_too_fast_is_made_slower_on_the_same_curve() -> None:
    async with plant(reverse=(False, True), speed_resolution=10) as p:
        car = DifferentialDrive(p.base, RADIUS, TRACK)
        async with car.stream(v=0.3, omega=1.0) as setpoint:
            for wanted, told in (((0.6, 0.5), (0.3, 0.25)), ((0.2, 2.0), (0.1, 1.0)), ((0.2, -0.5), (0.2, -0.5))):
                for _ in range(60):
                    setpoint(*wanted)
                    await asyncio.sleep(0.05)
                assert setpoint.sent == pytest.approx(told, abs=0.005)
                assert setpoint.measured == pytest.approx(told, abs=0.01)
        assert p.rpm() == (0, 0)


@on_virtual_clock
async def test_accelerations_ahead_and_about_itself_are_kept() -> None:
    async with plant(reverse=(False, True), speed_resolution=10) as p:
        car, seen = DifferentialDrive(p.base, RADIUS, TRACK), []
        async with car.stream(acceleration=0.4, angular_acceleration=1.0) as setpoint:
            for turn in range(120):
                setpoint(0.4 if turn < 60 else 0.0, 0.0 if turn < 30 else 1.0)
                left, right = p.rpm()
                seen.append(car.speeds_of(left, -right))
                await asyncio.sleep(0.05)
        for at, limit in ((0, 0.4), (1, 1.0)):
            steps = [abs(b[at] - a[at]) for a, b in zip(seen, seen[4:], strict=False)]
            assert max(steps) <= 1.1 * limit * 0.2 + 0.02


@on_virtual_clock
async def test_a_figure_of_eight_of_five_minutes_with_lost_frames_is_known_within_a_hundredth_of_its_way() -> None:
    noise = Noise(lost_reply=0.01, lost_request=0.01)
    async with plant(WatchedZlac(), noise=noise, seed=11, reverse=(False, True), speed_resolution=10) as p:
        truth, car = Truth(p), DifferentialDrive(p.base, RADIUS, TRACK)
        await car.reset()
        begun = p.now
        async with car.stream(timeout=0.5) as setpoint:
            while (gone := p.now - begun) < 300:
                setpoint(0.3, 0.6 if gone % 21 < 10.5 else -0.6)
                await asyncio.sleep(0.1)
                if round(gone * 10) % 50 == 49:
                    pose, real = await car.update(), truth.look()
                    away = math.hypot(pose.x - real.x, pose.y - real.y)
                    # The wheels went on while they were asked.
                    assert away < 0.01 * 0.3 * gone + 0.3 * 0.02, gone
                    assert abs(pose.heading - real.heading) < 0.01 * 0.6 * gone + 0.6 * 0.02
        pose = await car.update()
        truth.close()
        real = truth.look()
        assert math.hypot(pose.x - real.x, pose.y - real.y) < 0.01
        assert abs(pose.heading - real.heading) < 0.01
        sample = car.sample
        assert sample is not None
        assert sample.pose == pose
        assert sample.covariance[0][0] > 0
        assert p.now - sample.at < 0.1


_SPEEDS = st.tuples(st.floats(-1.0, 1.0), st.floats(-4.0, 4.0), st.sampled_from([0.02, 0.05, 0.1, 0.3]))


@settings(max_examples=8, phases=(Phase.explicit, Phase.generate), deadline=None)
@given(
    st.lists(_SPEEDS, min_size=2, max_size=12),
    st.sampled_from([(0.3, 1.0), (0.5, 4.0), (2.0, 0.5)]),
    st.sampled_from([None, 1000.0]),
)
def test_accelerations_ahead_and_about_itself_are_kept_whatever_is_streamed(
    told: list[tuple[float, float, float]], limits: tuple[float, float], ramp_rpm: float | None
) -> None:
    @on_virtual_clock
    async def go() -> None:
        sim = WatchedZlac(ramp_rpm=ramp_rpm)
        noise = Noise(lost_reply=0.01, lost_request=0.01)
        async with plant(
            sim, noise=noise, seed=len(told), reverse=(False, True), speed_resolution=10, ramp_rpm=ramp_rpm
        ) as p:
            car, seen = DifferentialDrive(p.base, RADIUS, TRACK), []

            async def watch() -> None:
                while True:
                    left, right = p.sim.rpm(p.now)
                    seen.append(car.speeds_of(left, -right))
                    await asyncio.sleep(0.02)

            watching = asyncio.ensure_future(watch())
            ahead, about = limits
            async with car.stream(acceleration=ahead, angular_acceleration=about) as setpoint:
                for v, omega, pause in told:
                    setpoint(v, omega)
                    await asyncio.sleep(pause)
            watching.cancel()
            assert p.rpm() == (0, 0)
            step = car.speeds_of(-0.1, 0.1)[1], car.speeds_of(0.1, 0.1)[0]  # what a tenth of a rpm makes
            for at, limit in enumerate(limits):
                steepest = max((abs(b[at] - a[at]) for a, b in zip(seen, seen[10:], strict=False)), default=0.0)
                assert steepest <= 1.1 * limit * 0.2 + limit * STEP + 2 * step[1 - at]

    go()


@settings(max_examples=8, phases=(Phase.explicit, Phase.generate), deadline=None)
@given(v=st.floats(-20, 20), omega=st.floats(-100, 100))
def test_where_a_wheel_is_at_its_limit_the_curve_stays_the_same(v: float, omega: float) -> None:
    @on_virtual_clock
    async def go() -> None:
        async with plant(reverse=(False, True), speed_resolution=10) as p:
            car = DifferentialDrive(p.base, RADIUS, TRACK, acceleration=50.0)
            fastest = p.base._drive.abilities[0].speed_limit
            async with car.stream(timeout=2.0) as setpoint:
                setpoint(v, omega)
                await asyncio.sleep(0.5)
                left, right = setpoint.sent
                wanted = car.wheels_for(v, omega)
                share = min(1.0, fastest / max(*map(abs, wanted), 1e-9))
                assert (left, right) == pytest.approx((share * v, share * omega), abs=0.01)
                assert max(map(abs, p.rpm())) <= fastest

    go()


# However it ends


@on_virtual_clock
async def test_sign_changes_at_20_hertz_for_a_minute_are_no_error() -> None:
    async with plant(reverse=(False, True)) as p:
        car = DifferentialDrive(p.base, RADIUS, TRACK)
        async with car.stream(acceleration=1.0) as setpoint:
            for step in range(60 * 20):
                setpoint(0.3 * (-1) ** step, 0.5)
                await asyncio.sleep(0.05)
        assert p.rpm() == (0, 0)


@on_virtual_clock
async def test_a_released_stick_stops_it_within_its_ramp_and_a_third_of_a_second() -> None:
    async with plant(reverse=(False, True)) as p:
        car = DifferentialDrive(p.base, RADIUS, TRACK)
        async with car.stream(acceleration=1.0) as setpoint:
            for _ in range(40):
                setpoint(0.5, 0.0)
                await asyncio.sleep(0.05)
            setpoint(0.0, 0.0)
            await asyncio.sleep(0.5 + 0.3)
            assert p.rpm() == (0, 0)


@on_virtual_clock
async def test_a_task_that_dies_leaves_it_standing() -> None:
    async with plant(reverse=(False, True)) as p:
        car = DifferentialDrive(p.base, RADIUS, TRACK)

        async def source(ends: Exception | None) -> None:
            async with car.stream(acceleration=1.0) as setpoint:
                for _ in range(40):
                    setpoint(0.5, 0.2)
                    await asyncio.sleep(0.05)
                if ends is not None:
                    raise ends
                await asyncio.sleep(1000)

        for ends in (None, ZeroDivisionError()):
            streaming = asyncio.ensure_future(source(ends))
            await asyncio.sleep(2.1)
            if ends is None:
                streaming.cancel()
            await asyncio.sleep(0.6 + 0.3)
            assert p.rpm() == (0, 0)
            with pytest.raises(asyncio.CancelledError if ends is None else ZeroDivisionError):
                await streaming
        await p.base.move_by(0.2, 0.2)


@on_virtual_clock
async def test_a_source_that_hangs_leaves_it_standing_and_the_next_set_point_goes_on() -> None:
    async with plant(reverse=(False, True)) as p:
        car = DifferentialDrive(p.base, RADIUS, TRACK)
        async with car.stream(timeout=0.25, acceleration=1.0) as setpoint:
            for _ in range(2):
                for _ in range(40):
                    setpoint(0.5, 0.0)
                    await asyncio.sleep(0.05)
                assert setpoint.sent == pytest.approx((0.5, 0.0), abs=0.02)
                await asyncio.sleep(0.25 + 0.5 + 0.3)
                assert p.rpm() == (0, 0)


@pytest.mark.parametrize("side", Side)
@on_virtual_clock
async def test_a_fault_of_one_wheel_ends_the_stream_and_stops_both(side: Side) -> None:
    async with plant(WatchedZlac(watchdog=0), reverse=(False, True)) as p:
        car = DifferentialDrive(p.base, RADIUS, TRACK)
        with pytest.raises(DriveFault):
            async with car.stream(acceleration=1.0) as setpoint:
                for step in range(200):
                    setpoint(0.5, 0.0)
                    await asyncio.sleep(0.05)
                    if step == 60:
                        p.sim.fail(side, Fault.OVER_CURRENT, p.now)
                        begun = p.now
        assert p.now - begun < 0.5
        await asyncio.sleep(0.6)
        assert p.rpm() == (0, 0)
        await p.base.clear_faults()
        await p.base.enable()
        async with car.stream() as setpoint:
            setpoint(0.2, 0.0)
            await asyncio.sleep(0.2)


@pytest.mark.parametrize("acceleration", [-0.5, 0.0, -math.inf, math.nan])
@on_virtual_clock
async def test_a_ramp_that_is_none_is_refused_and_is_not_a_jump(acceleration: float) -> None:
    async with plant() as p:
        with pytest.raises(LimitExceeded, match="acceleration"):
            DifferentialDrive(p.base, RADIUS, TRACK, acceleration=acceleration)
        p.base.left.acceleration = acceleration
        with pytest.raises(LimitExceeded, match="acceleration"):
            DifferentialDrive(p.base, RADIUS, TRACK).stream()


@on_virtual_clock
async def test_what_a_vehicle_is_told_is_checked_before_anything_is_sent_or_forgotten() -> None:
    wrong: Any
    async with plant() as p:
        car = DifferentialDrive(p.base, RADIUS, TRACK)
        await car.update()
        sent = p.line.pair.frames
        for wrong in (math.inf, -math.inf, math.nan):
            for v, omega in ((wrong, 0.0), (0.0, wrong)):
                with pytest.raises(LimitExceeded, match="finite"):
                    car.drive(v, omega)
            with pytest.raises(LimitExceeded, match="heading"):
                await car.reset(Pose(0.0, 0.0, wrong))
        for wrong in ((1.0, 2.0, 0.5), 0, []):
            with pytest.raises(TypeError, match="pose must be made like"):
                await car.reset(wrong)
        for wrong in (0.0, -1.0, math.nan):
            with pytest.raises(LimitExceeded, match="every"):
                await anext(car.poses(wrong))
        with pytest.raises(LimitExceeded, match="variance"):
            DifferentialDrive(p.base, RADIUS, TRACK, variance=-1.0)
        assert p.line.pair.frames == sent
        assert car.sample is not None
        await car.update()


@on_virtual_clock
async def test_wheels_follow_without_a_ramp_where_that_is_said() -> None:
    async with plant() as p, p.base.stream(acceleration=math.inf) as setpoint:
        setpoint(60, 60)
        await asyncio.sleep(0.1)
        assert setpoint.sent == (60, 60)
