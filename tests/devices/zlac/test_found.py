"""What emulators written from the manual alone found of the drive and its vehicle."""

import asyncio
import contextlib
import itertools
import math
from collections.abc import Awaitable, Callable

import pytest

from rs485bus import BusConfig, DifferentialDrive, Zlac8015d, open_bus
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.values import Fault, Side, ZeroReset
from rs485bus.errors import (
    BusError,
    DriveFault,
    LimitExceeded,
    MotionError,
    MoveFailed,
    NoReply,
    NotSent,
    ReferenceLost,
)
from rs485bus.sim import Noise, VirtualLine
from rs485bus.sim.treatment import PLAIN, Treatment
from rs485bus.wire.registers import Register
from tests.devices.zlac.plant import Plant, WatchedZlac, on_virtual_clock, plant

RADIUS, TRACK = 0.085, 0.4


async def status(p: Plant) -> object:
    return await p.base.status()


async def position(p: Plant) -> object:
    return await p.base.left.position()


async def pose(p: Plant) -> object:
    return await DifferentialDrive(p.base, RADIUS, TRACK).update()


async def nothing(p: Plant) -> object:
    return None


async def stood_after_a_fault(p: Plant, poll: Callable[[Plant], Awaitable[object]]) -> float:
    """Have the left wheel fail while the application polls. Seconds until the other one stands."""
    p.sim.fail(Side.LEFT, Fault.OVER_CURRENT, p.now)
    began = p.now
    while p.rpm()[1] != 0 and p.now < began + 3:
        with contextlib.suppress(BusError):
            await poll(p)
        await asyncio.sleep(0.05)
    return p.now - began


@pytest.mark.parametrize("lost", [0.0, 0.05], ids=["clean", "5 % lost"])
@pytest.mark.parametrize("poll", [nothing, status, position, pose], ids=["", "status", "position", "pose"])
@pytest.mark.parametrize("how", ["run", "torque", "move"])
@on_virtual_clock
async def test_a_fault_of_one_wheel_stops_both_within_half_a_second_whatever_the_application_polls(
    how: str, poll: Callable[[Plant], Awaitable[object]], lost: float
) -> None:
    async with plant(WatchedZlac(watchdog=0), noise=Noise(lost_reply=lost), seed=3) as p:
        moving = None
        if how == "run":
            await p.base.run(100, 100)
        elif how == "torque":
            await p.base.torque(2000, 2000, slope=4000)
            await asyncio.sleep(1.0)
        else:
            moving = p.base.move_to(50.0, 50.0, rpm=100)
            await asyncio.sleep(2.0)
        assert p.rpm()[1] > 90
        assert await stood_after_a_fault(p, poll) <= 0.5
        if moving is not None:
            with pytest.raises(DriveFault):
                await moving
        with pytest.raises(MotionError):
            await p.base.right.run(10)
        await p.base.clear_faults()


@pytest.mark.parametrize("driving", [True, False], ids=["0.6 s while it drives", "1 s while it is parked"])
@on_virtual_clock
async def test_a_drive_that_was_switched_off_ends_the_pose_with_an_error(driving: bool) -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        car = DifferentialDrive(p.base, RADIUS, TRACK)
        await car.reset()
        await p.base.move_to(3.0, 3.0)
        there = await car.update()
        if driving:
            car.drive(0.3, 0.0)
            await asyncio.sleep(0.5)
            there = await car.update()
        p.sim.restart_takes = 0.6 if driving else 1.0
        p.sim.power_cycle(p.now)
        seen: list[float] = []
        with pytest.raises(ReferenceLost, match="reset"):
            for _ in range(60):
                try:
                    seen.append((await car.update()).x)
                except (NoReply, BusError) as error:
                    if isinstance(error, ReferenceLost):
                        raise
                await asyncio.sleep(0.05)
        assert all(abs(x - there.x) < 0.2 for x in seen)
        assert abs(car.pose.x - there.x) < 0.2
        if driving:
            await asyncio.sleep(1.0)  # of its speed nobody waited for the end
            with pytest.raises(MotionError):
                await p.base.left.run(10)
        await car.reset(there)
        assert (await car.update()).x == pytest.approx(there.x, abs=0.01)


@on_virtual_clock
async def test_a_parked_vehicle_that_was_never_enabled_notices_the_restart_too() -> None:
    async with plant(WatchedZlac(watchdog=0, counts=(5000, 5000)), enabled=False) as p:
        car = DifferentialDrive(p.base, RADIUS, TRACK)
        await car.reset()
        p.sim.power_cycle(p.now)
        await asyncio.sleep(1.5)
        with pytest.raises(ReferenceLost):
            await car.update()


@on_virtual_clock
async def test_the_way_between_the_last_update_and_set_zero_and_from_there_to_the_next_one_is_not_lost() -> None:
    async with plant() as p:
        car = DifferentialDrive(p.base, RADIUS, TRACK)
        await car.reset()
        await p.base.move_by(1.0, 1.0)
        await p.base.set_zero()
        await p.base.move_by(1.0, 1.0)
        assert (await car.update()).x == pytest.approx(2 * math.tau * RADIUS, abs=2e-3)


@on_virtual_clock
async def test_poses_go_on_after_lost_replies_and_end_where_the_drive_is_gone() -> None:
    async with plant(WatchedZlac(watchdog=0), config=BusConfig(retries=0)) as p:
        car, seen = DifferentialDrive(p.base, RADIUS, TRACK), 0
        await p.base.set_up()
        with pytest.raises(BusError):
            async for _ in car.poses(every=0.05):
                seen += 1
                p.sim.lose_reply("0320A2", times=seen % 3)
                if seen == 20:
                    p.sim.dead = True
                assert seen < 40
        assert seen >= 20


@on_virtual_clock
async def test_scaled_position_speeds_that_the_register_cannot_hold_are_refused_when_they_are_asked_for() -> None:
    async with plant(speed_resolution=10, scaled_position_speed=True) as p:
        with pytest.raises(LimitExceeded, match="100 rpm"):
            p.base.left.move_to(1.0, rpm=150)
        with pytest.raises(LimitExceeded, match="100 rpm"):
            p.base.move_to(1.0, 1.0, rpm=150)
        await p.base.left.move_to(1.0, rpm=100)


@on_virtual_clock
async def test_ramps_that_somebody_else_has_written_are_noticed() -> None:
    async with plant(acceleration=100) as p:
        await p.base.run(60, 60)
        await p.base.stop()
        await p.bus.unit(1).write_registers(r.ACCELERATION_TIME.left.address, [0, 0, 0, 0])
        began = p.now
        await p.base.run(60, 60)
        assert p.now - began > 0.5
        assert p.sim.value(r.ACCELERATION_TIME.left) == 600


@on_virtual_clock
async def test_a_fault_that_is_told_names_the_wheel_the_cause_and_what_to_do() -> None:
    async with plant() as p:
        move = p.base.left.move_to(20.0)
        await asyncio.sleep(1.0)
        p.sim.fail(Side.RIGHT, Fault.OVER_LOAD, p.now)
        with pytest.raises(DriveFault, match=r"right over load \(free the wheel.*clear_faults\(\) and enable\(\)"):
            await move
        await p.base.clear_faults()


@on_virtual_clock
async def test_a_run_whose_ramp_changes_through_zero_is_no_faster_than_asked() -> None:
    async with plant(acceleration=100) as p:
        await p.base.run(60, 60)
        back, seen = p.base.run(-60, -60), [p.rpm()[0]]
        while not back.done():
            await asyncio.sleep(0.05)
            seen.append(p.rpm()[0])
        assert max(abs(b - a) for a, b in itertools.pairwise(seen)) <= 1.1 * 100 * 0.05


@on_virtual_clock
async def test_a_stop_in_the_middle_of_slowing_down_a_little_has_the_ramp_that_was_asked_for() -> None:
    async with plant(acceleration=100) as p:
        await p.base.run(100, 100)
        await p.base.left.run(90)
        began = p.now
        await p.base.left.stop()
        assert p.now - began > 0.8
        assert p.rpm()[1] == 100


@on_virtual_clock
async def test_on_a_perfect_line_nothing_counts_as_a_retry() -> None:
    async with plant() as p:
        await p.base.move_to(1.0, 1.0)
        await p.base.run(50, 50)
        await p.base.stop()
        assert p.bus.stats.units[1].retries == 0


@on_virtual_clock
async def test_a_run_whose_reads_are_lost_leaves_no_wheel_turning() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        run = p.base.run(100, 100, acceleration=50)
        await asyncio.sleep(0.5)
        p.sim.lose_reply("03", times=12)
        try:
            await run
        except BusError:
            await asyncio.sleep(1.5)
            assert p.rpm() == (0, 0)
        else:
            assert p.rpm() == pytest.approx((100, 100), abs=2)


@on_virtual_clock
async def test_a_run_whose_reads_are_refused_leaves_no_wheel_turning() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        run = p.base.run(100, 100, acceleration=50)
        await asyncio.sleep(0.5)
        for _ in range(4):
            p.sim.refuse("0320")
        try:
            await run
        except BusError:
            await asyncio.sleep(1.5)
            assert p.rpm() == (0, 0)
        else:
            assert p.rpm() == pytest.approx((100, 100), abs=2)


# What has set wheels in motion never ends as "nothing was done"


@pytest.mark.parametrize("who", ["wheel", "both"])
@on_virtual_clock
async def test_a_timed_run_whose_end_could_not_be_sent_is_not_told_as_nothing_done(who: str) -> None:
    async with plant(WatchedZlac(watchdog=0), config=BusConfig(echo=False)) as p:
        run = p.base.left.run(60, duration=1.0) if who == "wheel" else p.base.run(60, 60, duration=1.0)
        await asyncio.sleep(0.9)
        p.line.babble(itertools.repeat(0.001, 3000))  # no frame but a stop goes out
        with pytest.raises(MotionError) as failed:
            await run
        assert not isinstance(failed.value, NotSent)
        await asyncio.sleep(3.0)
        assert p.rpm() == (0, 0)


@on_virtual_clock
async def test_where_a_wheel_is_stopped_for_a_speed_that_could_not_be_told_that_is_said() -> None:
    async with plant(WatchedZlac(watchdog=0), config=BusConfig(echo=False)) as p:
        await p.base.left.run(60)
        p.line.babble(itertools.repeat(0.001, 1500))
        with pytest.raises(NotSent, match="turned before, and was stopped"):
            await p.base.left.run(30)
        await asyncio.sleep(3.0)
        assert p.rpm() == (0, 0)


@on_virtual_clock
async def test_the_end_of_a_timed_run_goes_before_looks_that_only_wait_for_it() -> None:
    sim = WatchedZlac(watchdog=0)
    line = VirtualLine(sim, baudrate=38400)
    async with open_bus(line, baudrate=38400, config=BusConfig(echo=False)) as bus:
        base = Zlac8015d(bus, 1)
        await base.enable()
        runs = base.left.run(60, duration=1.0), base.right.run(-60, duration=1.0)
        await asyncio.sleep(0.95)
        line.babble(itertools.repeat(0.001, 650))  # until both should stand
        ended = asyncio.get_running_loop().time() + 0.65 + 0.7
        for run in runs:
            with pytest.raises(MoveFailed, match="should have gone"):
                await run
        assert asyncio.get_running_loop().time() < ended


@pytest.mark.parametrize("done", [True, False], ids=["done", "not done"])
@pytest.mark.parametrize("code", [4, 5, 6, 11, None])
@pytest.mark.parametrize("register", [r.CLEAR_POSITION, r.RESET_ZERO], ids=["the counter", "the origin"])
@on_virtual_clock
async def test_a_zero_of_which_a_part_may_be_missing_is_set_whole_or_no_position_is_trusted(
    register: Register[ZeroReset], code: int | None, done: bool
) -> None:
    """Setting it zeroes the counter first, and then where absolute targets count from."""
    async with plant() as p:
        await p.base.left.move_to(0.4)
        begins, spoilt = bytes((p.sim.address, 6, *register.address.to_bytes(2, "big"))), [code]

        def script(frame: bytes, now: float) -> Treatment:
            if not frame.startswith(begins) or not spoilt:
                return PLAIN
            return Treatment(code=spoilt.pop(), carried_out=done, answered=code is not None)

        p.line.pair.script = script
        with contextlib.suppress(BusError):
            await p.base.left.set_zero()
        assert not spoilt
        stood_at = p.shafts()[0]
        zero = stood_at - await p.base.left.position()
        try:
            await p.base.left.move_to(0.25)
        except ReferenceLost:
            assert p.shafts()[0] == stood_at
            return
        assert p.shafts()[0] == pytest.approx(zero + 0.25, abs=0.01)
        await p.base.left.move_by(0.1)
        assert p.shafts()[0] == pytest.approx(zero + 0.35, abs=0.01)


@on_virtual_clock
async def test_a_run_whose_drive_restarts_in_a_block_before_it_has_its_speed_ends() -> None:
    """Its owner stops it, for its watchdog may be off: nobody else tells who waits for the speed."""
    for after in range(0, 500, 25):
        async with plant() as p, asyncio.timeout(20):
            with contextlib.suppress(BusError, ExceptionGroup):
                async with p.bus.watchdog(p.base, timeout=0.8):
                    run = p.base.right.run(-314, acceleration=100)
                    await asyncio.sleep(1.0 + after / 1000)
                    p.sim.restart_takes = 0.3
                    p.sim.power_cycle(p.now)
                    with pytest.raises(MotionError):
                        await run
            assert run.done()
