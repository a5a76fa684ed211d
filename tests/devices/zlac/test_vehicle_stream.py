"""A vehicle that is told how to go by a stream, and where it then believes it is."""

import asyncio
import math

import pytest

from rs485bus import DifferentialDrive
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
async def test_a_figure_of_eight_of_five_minutes_with_lost_replies_is_known_within_a_hundredth_of_its_way() -> None:
    async with plant(
        WatchedZlac(), noise=Noise(lost_reply=0.02), seed=11, reverse=(False, True), speed_resolution=10
    ) as p:
        truth, car = Truth(p), DifferentialDrive(p.base, RADIUS, TRACK)
        await car.reset()
        async with car.stream(timeout=0.5) as setpoint:
            for turn in range(3000):
                setpoint(0.3, 0.6 if turn % 210 < 105 else -0.6)
                await asyncio.sleep(0.1)
        pose = await car.update()
        truth.close()
        real = truth.look()
        assert math.hypot(pose.x - real.x, pose.y - real.y) < 0.01 * 0.3 * 300
        sample = car.sample
        assert sample is not None
        assert sample.pose == pose
        assert sample.covariance[0][0] > 0
        assert p.now - sample.at < 0.1
