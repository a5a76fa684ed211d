"""A vehicle on the virtual drive: where it goes, and where it believes it is."""

import asyncio
import math

import pytest

from rs485bus import DifferentialDrive
from rs485bus.devices.zlac.odometry import Pose
from rs485bus.errors import LimitExceeded, ReferenceLost
from rs485bus.sim import Noise
from tests.devices.zlac.plant import QUIET, Plant, WatchedZlac, on_virtual_clock, plant

RADIUS, TRACK = 0.085, 0.4
EDGE = 2**31 - 1


def vehicle(p: Plant, acceleration: float | None = None) -> DifferentialDrive:
    return DifferentialDrive(p.base, RADIUS, TRACK, acceleration=acceleration)


class Truth:
    """Where a vehicle really is, from the shafts of the virtual drive, looked at all the time."""

    def __init__(self, p: Plant) -> None:
        self._p = p
        self._shafts = p.sim.shafts(p.now)
        self.pose = Pose()
        self._task = asyncio.ensure_future(self._watch())

    async def _watch(self) -> None:
        while True:
            self.look()
            await asyncio.sleep(0.005)

    def look(self) -> Pose:
        shafts = self._p.sim.shafts(self._p.now)
        # The right wheel is mirrored.
        left, right = (
            math.tau * RADIUS * sign * (now - before)
            for before, now, sign in zip(self._shafts, shafts, (1, -1), strict=True)
        )
        self._shafts = shafts
        self.pose = self.pose.moved((left + right) / 2, (right - left) / TRACK)
        return self.pose

    def close(self) -> None:
        self._task.cancel()


async def square(car: DifferentialDrive, side: float) -> None:
    """Drive a square by speeds alone, looking where that leads."""
    for corner in range(1, 5):
        begin = car.pose
        while (rest := side - math.hypot(car.pose.x - begin.x, car.pose.y - begin.y)) > 0.002:
            error = (corner - 1) * math.pi / 2 - car.pose.heading
            car.drive(min(0.4, max(0.02, 1.5 * rest)), 1.5 * error)
            await asyncio.sleep(0.05)
            await car.update()
        await car.stop()
        while abs(rest := corner * math.pi / 2 - car.pose.heading) > 0.004:
            car.drive(0.0, math.copysign(min(1.5, max(0.05, 1.5 * abs(rest))), rest))
            await asyncio.sleep(0.05)
            await car.update()
        await car.stop()
        await car.update()


@pytest.mark.parametrize("counts", [(0, 0), (EDGE - 10_000, -EDGE + 10_000)], ids=["from zero", "across the wrap"])
@on_virtual_clock
async def test_a_square_closes_within_a_hundredth_of_its_side_with_lost_replies(counts: tuple[int, int]) -> None:
    noise = Noise(lost_reply=0.02)
    sim = WatchedZlac(counts=counts)
    async with plant(sim, noise=noise, seed=7, reverse=(False, True), speed_resolution=10) as p:
        truth, car = Truth(p), vehicle(p, acceleration=0.6)
        await car.reset()
        side = 1.0
        await square(car, side)
        truth.close()
        assert math.hypot(car.pose.x, car.pose.y) < 0.01 * side
        assert abs(car.pose.heading - math.tau) < 0.02
        # What it believes is what it did.
        real = truth.look()
        assert math.hypot(car.pose.x - real.x, car.pose.y - real.y) < 0.01 * side
        assert p.bus.stats.units[1].timeouts > 0
        assert p.sim.trips == []


@on_virtual_clock
async def test_speeds_ahead_and_about_itself_become_speeds_of_the_wheels() -> None:
    async with plant(reverse=(False, True), speed_resolution=10) as p:
        car = vehicle(p)
        rpm = 60 / (math.tau * RADIUS)
        await car.drive(0.3, 0.0)
        assert p.rpm() == pytest.approx((0.3 * rpm, -0.3 * rpm), abs=2)
        await car.drive(0.0, 1.0)
        assert p.rpm() == pytest.approx((-0.2 * rpm, -0.2 * rpm), abs=2)
        await car.stop()
        assert await p.standing_for(1.0)


@on_virtual_clock
async def test_what_is_slower_than_half_a_step_is_a_stand() -> None:
    async with plant() as p:
        car = vehicle(p)
        await car.drive(0.3, 0.0)
        await car.drive(0.0001, 0.0)
        assert await p.standing_for(1.0)


@on_virtual_clock
async def test_what_a_wheel_cannot_do_is_refused() -> None:
    async with plant(max_rpm=100) as p:
        with pytest.raises(LimitExceeded):
            vehicle(p).drive(2.0, 0.0)
        assert p.rpm() == (0, 0)
    for radius, track in ((0.0, 0.4), (0.1, -1.0)):
        with pytest.raises(ValueError, match="must be a finite number above 0"):
            DifferentialDrive(p.base, radius, track)


@on_virtual_clock
async def test_a_pose_can_be_said_and_goes_on_from_there() -> None:
    async with plant() as p:
        car = vehicle(p)
        await car.reset(Pose(1.0, 2.0, math.pi / 2))
        await p.base.move_by(1.0, 1.0)
        pose = await car.update()
        assert (pose.x, pose.y) == pytest.approx((1.0, 2.0 + math.tau * RADIUS), abs=1e-3)


@on_virtual_clock
async def test_setting_zero_of_a_wheel_does_not_move_the_vehicle() -> None:
    async with plant() as p:
        car = vehicle(p)
        await p.base.move_to(20.0, 20.0)
        await car.reset()
        await p.base.move_by(1.0, 1.0)
        before = await car.update()
        await p.base.set_zero()
        assert await car.update() == before
        await p.base.move_by(1.0, 1.0)
        assert (await car.update()).x == pytest.approx(2 * math.tau * RADIUS, abs=1e-3)


@on_virtual_clock
async def test_a_drive_that_restarted_does_not_carry_the_vehicle_away() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        car = vehicle(p)
        await p.base.move_to(30.0, 30.0)
        before = await car.update()
        p.sim.restart_takes = 0.2
        p.sim.power_cycle(p.now)
        await asyncio.sleep(0.3)
        for _ in range(2):
            with pytest.raises(ReferenceLost, match="reset"):
                await car.update()
        assert car.pose == before
        await car.reset(before)
        assert await car.update() == before


@on_virtual_clock
async def test_poses_come_as_often_as_asked_for() -> None:
    async with plant(noise=QUIET) as p:
        car = vehicle(p)
        car.drive(0.2, 0.0)
        seen = []
        async for pose in car.poses(every=0.1):
            seen.append(pose.x)
            if len(seen) == 20:
                break
        assert seen == sorted(seen)
        assert seen[-1] == pytest.approx(0.2 * 2.0, abs=0.1)
