"""Streams of set-points of a wheel and of both."""

import asyncio

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from rs485bus import AxisGroup, MksServo, open_bus
from rs485bus.devices.zlac.values import Fault, Side
from rs485bus.errors import BusError, MotionError
from rs485bus.sim import Noise, SimMks, VirtualLine
from tests.devices.zlac.plant import WatchedZlac, on_virtual_clock, plant


@on_virtual_clock
async def test_a_stream_of_both_wheels_tells_both_by_one_frame_and_leaves_them_standing() -> None:
    async with plant(reverse=(False, True)) as p:
        async with p.base.stream(acceleration=200) as setpoint:
            begun = len(p.sim.asked)
            for _ in range(40):
                setpoint(60.0, 30.0)
                await asyncio.sleep(0.05)
            assert p.rpm() == pytest.approx((60, -30), abs=1)
            assert setpoint.sent == (60.0, 30.0)
            assert setpoint.measured == pytest.approx((60, 30), abs=2)
            assert not [write for write in p.sim.writes(begun) if write.startswith("06")]
        assert p.rpm() == (0, 0)
        await p.base.move_by(0.5, 0.5)


@on_virtual_clock
async def test_an_old_set_point_stops_both_by_the_ramp_and_the_next_one_goes_on() -> None:
    async with plant() as p, p.base.stream(acceleration=200) as setpoint:
        for _ in range(20):
            setpoint(60.0, 60.0)
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.25 + 0.3 + 0.3)
        assert p.rpm() == (0, 0)
        for _ in range(20):
            setpoint(40.0, -40.0)
            await asyncio.sleep(0.05)
        assert p.rpm() == pytest.approx((40, -40), abs=1)


@on_virtual_clock
async def test_a_wheel_alone_is_streamed_while_the_other_one_runs() -> None:
    async with plant() as p:
        await p.base.right.run(50)
        async with p.base.left.stream(acceleration=200) as setpoint:
            for _ in range(30):
                setpoint(-40.0)
                await asyncio.sleep(0.05)
            assert p.rpm() == pytest.approx((-40, 50), abs=1)
        assert p.rpm() == (0, 50)
        await p.base.stop()


@pytest.mark.parametrize("who", ["base", "wheel", "bus"])
@on_virtual_clock
async def test_a_stream_of_both_that_somebody_else_has_stopped_is_left_when_both_stand(who: str) -> None:
    async with plant() as p:
        async with p.base.stream(acceleration=200) as setpoint:
            setpoint(60.0, 60.0)
            await asyncio.sleep(0.2)
            stop = {"base": p.base.stop, "wheel": p.base.left.stop, "bus": p.bus.emergency_stop}[who]()
        assert p.rpm() == (0, 0)
        await stop


@on_virtual_clock
async def test_a_fault_ends_the_stream_and_is_raised_by_the_next_set_point() -> None:
    async with plant(WatchedZlac(watchdog=0)) as p:
        with pytest.raises(BusError, match="over current"):
            async with p.base.stream() as setpoint:
                for turn in range(100):
                    setpoint(60.0, 60.0)
                    await asyncio.sleep(0.05)
                    if turn == 30:
                        p.sim.fail(Side.LEFT, Fault.OVER_CURRENT, p.now)
        await asyncio.sleep(0.5)
        assert p.rpm() == (0, 0)
        await p.base.clear_faults()


@pytest.mark.parametrize("ramp_rpm", [None, 1000.0], ids=["for any change", "for the whole range"])
@settings(max_examples=6, phases=(Phase.explicit, Phase.generate), deadline=None)
@given(
    st.lists(st.tuples(st.floats(-150, 150), st.floats(-150, 150), st.floats(0.01, 0.4)), min_size=2, max_size=12),
    st.integers(0, 5),
)
def test_the_ramp_asked_for_is_kept_by_either_reading_whatever_is_streamed(
    ramp_rpm: float | None, told: list[tuple[float, float, float]], seed: int
) -> None:
    @on_virtual_clock
    async def go() -> None:
        sim = WatchedZlac(ramp_rpm=ramp_rpm)
        noise = Noise(lost_reply=0.02)
        async with plant(sim, noise=noise, seed=seed, ramp_rpm=ramp_rpm, speed_resolution=10) as p:
            seen: list[tuple[float, float]] = []

            async def watch() -> None:
                while True:
                    seen.append(p.rpm())
                    await asyncio.sleep(0.02)

            watching = asyncio.ensure_future(watch())
            async with p.base.stream(acceleration=200, timeout=0.5) as setpoint:
                for left, right, pause in told:
                    setpoint(left, right)
                    await asyncio.sleep(pause)
            watching.cancel()
            for side in (0, 1):
                steps = [abs(b[side] - a[side]) for a, b in zip(seen, seen[5:], strict=False)]
                assert max(steps, default=0) <= 1.1 * 200 * 0.1 + 1

    go()


@on_virtual_clock
async def test_a_move_awaited_in_the_block_of_the_other_wheel_s_stream_is_refused_and_done_behind_it() -> None:
    async with plant() as p:
        async with p.base.left.stream(timeout=5.0) as setpoint:
            setpoint(30.0)
            move = p.base.right.move_by(0.5)
            with pytest.raises(MotionError, match="leave the block first"):
                await move
        assert await move == pytest.approx(0.5, abs=0.01)


@on_virtual_clock
async def test_what_waits_for_the_other_wheel_s_stream_is_refused_in_its_block_however_it_is_asked_for() -> None:
    async with plant() as p, open_bus(VirtualLine(SimMks(1))) as bus, asyncio.timeout(120.0):
        right, x = p.base.right, MksServo(bus, 1)
        await x.enable()
        for ask in (
            lambda: AxisGroup(r=right).move_by(r=0.5),
            lambda: AxisGroup(x=x, r=right).move_by(x=0.5, r=0.5),
            lambda: AxisGroup(x=x, r=right).move_by(x=0.5, r=0.5).moves["x"],
            lambda: right.torque(100),
            lambda: (right.move_by(0.5), right.run(30.0, duration=0.5))[1],
            lambda: p.base.move_by(0.5, 0.5).right,
        ):
            async with p.base.left.stream(timeout=5.0) as setpoint:
                setpoint(30.0)
                told = ask()
                with pytest.raises(MotionError, match="leave the block first"):
                    await told
            await told  # behind the block it is done
            await p.base.stop()
            await x.stop()


@on_virtual_clock
async def test_a_stream_of_a_group_is_refused_in_the_block_of_a_stream_of_its_last_axis() -> None:
    async with plant() as p, open_bus(VirtualLine(SimMks(1))) as bus, asyncio.timeout(120.0):
        x = MksServo(bus, 1)
        await x.enable()
        async with p.base.left.stream(timeout=5.0) as setpoint:
            setpoint(30.0)
            with pytest.raises(MotionError, match="leave the block first"):
                async with AxisGroup(x=x, left=p.base.left).stream():
                    pytest.fail("it cannot begin")


@on_virtual_clock
async def test_a_move_behind_the_other_wheel_s_stream_is_done_where_an_error_left_that_block() -> None:
    async with plant() as p:
        with pytest.raises(ZeroDivisionError):
            async with p.base.left.stream(timeout=5.0) as setpoint:
                setpoint(30.0)
                move = p.base.right.move_by(0.5)
                raise ZeroDivisionError
        assert await move == pytest.approx(0.5, abs=0.01)
