"""What an adversary found of streams, each by itself, and a share of what he does."""

import asyncio
import itertools
import math
from contextlib import suppress

import pytest

from rs485bus import BusConfig, DifferentialDrive, MksServo, Zlac8015d, open_bus
from rs485bus.errors import LimitExceeded, MotionError
from rs485bus.sim import SimMks, SimZlac, VirtualLine
from rs485bus.sim.treatment import PLAIN, Treatment
from tests.devices.stream_adversary import FAMILIES, attack
from tests.devices.stream_rig import FAMILIES as EACH
from tests.devices.stream_rig import Make, now
from tests.devices.zlac.plant import WatchedZlac, on_virtual_clock, plant

BUSY = Treatment(carried_out=False, code=6)


@pytest.mark.parametrize("name", FAMILIES)
def test_whatever_an_application_does_with_a_stream_the_shafts_do_as_is_promised(name: str) -> None:
    attack(name, 1)


@on_virtual_clock
async def test_an_infinite_speed_is_no_set_point() -> None:
    async with open_bus(VirtualLine(SimMks(1), SimZlac(2))) as bus:
        axis, base = MksServo(bus, 1), Zlac8015d(bus, 2)
        await axis.enable()
        await base.enable()
        car = DifferentialDrive(base, 0.1, 0.4)
        async with axis.stream() as one, car.stream() as two:
            for value in (math.inf, -math.inf, math.nan):
                with pytest.raises(LimitExceeded):
                    one(value)
                with pytest.raises(LimitExceeded):
                    two(0.1, value)
            one(60.0)
            two(0.1, 0.0)
            await asyncio.sleep(0.2)
            assert one.sent > 0
            assert two.sent[0] > 0


@EACH
@on_virtual_clock
async def test_a_device_that_is_busy_for_a_set_point_is_told_again(make: Make) -> None:
    """A gateway says so, too. Nothing was done then, which is no reason to take a motor for blocked."""
    sim, axis_on = make()
    line = VirtualLine(sim, baudrate=115200)
    frames = itertools.count()
    async with open_bus(line, config=BusConfig(echo=False)) as bus:
        axis = axis_on(bus)
        await axis.enable()
        line.pair.script = lambda frame, now: BUSY if next(frames) % 7 == 6 else PLAIN
        async with axis.stream(acceleration=1000) as setpoint:
            for rpm in (60, -60):
                for _ in range(20):
                    setpoint(rpm)
                    await asyncio.sleep(0.05)
                before = sim.shaft(now())
                await asyncio.sleep(0.1)
                assert (sim.shaft(now()) - before) * 600 == pytest.approx(rpm, rel=0.05)
        assert not sim.moving(now())


@on_virtual_clock
async def test_a_bus_that_is_left_while_another_task_streams_ends_the_stream() -> None:
    """It has no end of its own: nobody would wait for it to the end."""
    sim = SimMks(1)
    async with asyncio.timeout(10):
        async with open_bus(VirtualLine(sim)) as bus:
            axis = MksServo(bus, 1)
            await axis.enable()

            async def source() -> None:
                with suppress(MotionError):
                    async with axis.stream() as setpoint:
                        while True:
                            setpoint(100)
                            await asyncio.sleep(0.02)

            streaming = asyncio.ensure_future(source())
            await asyncio.sleep(1.0)
        assert not sim.motion.motor.moving(now())
        await streaming


@on_virtual_clock
async def test_what_is_awaited_in_the_block_that_keeps_it_from_beginning_is_refused() -> None:
    async with asyncio.timeout(30), plant() as p:
        left = p.base.left
        async with left.stream() as setpoint:
            with pytest.raises(MotionError, match="leave the block first"):
                async with left.stream():
                    pass
            move = left.move_by(0.1)
            with pytest.raises(MotionError, match="leave the block first"):
                await move
            setpoint(20.0)
        await move
        async with p.base.stream() as both:
            with pytest.raises(MotionError, match="leave the block first"):
                async with p.base.stream():
                    pass
            with pytest.raises(MotionError, match="leave the block first"):
                await p.base.move_by(0.1, 0.1)
            both(10.0, 10.0)
            await asyncio.sleep(0.1)
            assert both.sent == (10.0, 10.0)


@on_virtual_clock
async def test_steps_that_were_not_heard_are_not_made_up_for_at_once_where_a_ramp_time_is_for_any_change() -> None:
    sim = WatchedZlac()
    async with plant(sim) as p, p.base.stream(acceleration=200, timeout=5.0) as setpoint:
        setpoint(20.0, 20.0)
        await asyncio.sleep(1.0)
        sim.lose_request("1020880002", 12)
        setpoint(150.0, 150.0)
        steepest, before = 0.0, p.rpm()[0]
        for _ in range(100):
            await asyncio.sleep(0.05)
            after = p.rpm()[0]
            steepest, before = max(steepest, abs(after - before) / 0.05), after
        assert before == 150
        assert steepest <= 1.1 * 200 + 20
