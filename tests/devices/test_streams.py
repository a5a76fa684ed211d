"""Set-points: the newest one counts, goes out at once, keeps the ramp, and stops the motor when it is too old."""

import asyncio
import logging
import math
import random
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rs485bus import AxisGroup, MksServo, TlrStepper, open_bus
from rs485bus.devices.mks import Status
from rs485bus.errors import (
    BusError,
    DriveFault,
    LimitExceeded,
    MotionError,
    MoveCancelled,
    MoveFailed,
    NotEnabled,
)
from rs485bus.motion.axis import Axis
from rs485bus.motion.events import EventKind
from rs485bus.sim import Noise, SimMks, SimTlr, TlrMachine, VirtualLine
from rs485bus.wire.frames import crc
from tests.devices.stream_rig import ACCELERATION, FAMILIES, Make, kept, lose_replies, now, one_tlr, rig, steepest
from tests.integration.support import virtual

# What it does


@FAMILIES
@virtual
async def test_the_newest_set_point_counts(make: Make) -> None:
    async with rig(make) as on:
        async with on.axis.stream(acceleration=ACCELERATION) as setpoint:
            for rpm in (50, 500, -900, 300):  # nobody waits for any of them
                setpoint(rpm)
            for _ in range(12):
                await asyncio.sleep(0.05)
                setpoint(300)
            assert setpoint.sent == 300
            assert on.rpm == pytest.approx(300, abs=3)
            assert setpoint.measured == pytest.approx(300, abs=5)
        assert not on.sim.moving(now())
        assert min(rpm for _, rpm in on.speeds) > -1
        assert await on.axis.move_to(0.0) == pytest.approx(0.0, abs=0.01)


@FAMILIES
@virtual
async def test_a_released_stick_stops_the_motor_within_its_ramp_and_a_third_of_a_second(make: Make) -> None:
    async with rig(make) as on, on.axis.stream(acceleration=ACCELERATION) as setpoint:
        for _ in range(20):
            setpoint(400)
            await asyncio.sleep(0.05)
        setpoint(0)
        assert await on.rests(within=0.4 + 0.3) > 0.3


@FAMILIES
@virtual
async def test_a_set_point_that_is_too_old_stops_the_motor_without_an_error_and_the_next_one_goes_on(
    make: Make, caplog: pytest.LogCaptureFixture
) -> None:
    async with rig(make) as on:
        events: list[EventKind] = []

        async def listen() -> None:
            async for event in on.axis.events():
                events.append(event.kind)  # noqa: PERF401 # it never ends

        listening = asyncio.create_task(listen())
        async with on.axis.stream(timeout=0.25, acceleration=ACCELERATION) as setpoint:
            setpoint(300)
            await asyncio.sleep(0.2)
            await on.rests(within=0.05 + 0.3 + 0.3)
            await asyncio.sleep(5.0)
            assert events == [EventKind.STALE]
            assert "no set-point came" not in caplog.text  # a key was let go: that is nothing to be warned of
            setpoint(-100)
            await asyncio.sleep(0.2)
            assert on.rpm == pytest.approx(-100, abs=3)
        listening.cancel()


@FAMILIES
@virtual
async def test_a_task_that_dies_leaves_no_motor_turning(make: Make) -> None:
    async with rig(make) as on:

        async def source() -> None:
            async with on.axis.stream(acceleration=ACCELERATION) as setpoint:
                while True:
                    setpoint(300)
                    await asyncio.sleep(0.02)

        streaming = asyncio.create_task(source())
        await asyncio.sleep(1.0)
        assert on.rpm == pytest.approx(300, abs=3)
        streaming.cancel()
        await on.rests(within=0.3 + 0.3)
        with suppress(asyncio.CancelledError):
            await streaming
        assert await on.axis.move_by(0.5)


@FAMILIES
@virtual
async def test_an_exception_in_the_block_stops_the_motor(make: Make) -> None:
    async with rig(make) as on:
        with pytest.raises(ZeroDivisionError):
            async with on.axis.stream(acceleration=ACCELERATION) as setpoint:
                setpoint(300)
                await asyncio.sleep(0.2)
                raise ZeroDivisionError
        await on.rests(within=0.3 + 0.3)


@FAMILIES
@virtual
async def test_sign_changes_at_20_hertz_for_a_minute_fill_no_queue_and_are_no_error(make: Make) -> None:
    async with rig(make) as on, on.axis.stream(acceleration=ACCELERATION) as setpoint:
        for step in range(60 * 20):
            setpoint(300 * (-1) ** step)
            await asyncio.sleep(0.05)
        setpoint(0)
        await on.rests(within=0.1 + 0.3)


@FAMILIES
@settings(max_examples=6, deadline=None)
@given(data=st.data())
def test_the_ramp_is_kept_whatever_is_streamed(make: Make, data: st.DataObject) -> None:
    acceleration = data.draw(st.sampled_from([30.0, 300.0, 1000.0, 5000.0]), label="acceleration")
    told = data.draw(st.lists(st.tuples(st.floats(-900, 900), st.sampled_from([0.02, 0.05, 0.2, 0.5])), max_size=15))
    loss = data.draw(st.sampled_from([0.0, 0.05]))

    async def main() -> None:
        noise = Noise(lost_reply=loss, lost_request=loss)
        async with rig(make, noise=noise, seed=len(told)) as on:
            async with on.axis.stream(acceleration=acceleration) as setpoint:
                for rpm, pause in told:
                    setpoint(rpm)
                    await asyncio.sleep(pause)
            await asyncio.sleep(0.2)
            assert steepest(on.speeds) <= kept(acceleration) + 2 * 60 / 4000 / 0.1  # a pulse is seen as a jump

    virtual(main)()


# What comes between


@FAMILIES
@virtual
async def test_a_stop_ends_the_stream_and_who_tells_more_is_told(make: Make) -> None:
    async with rig(make) as on:
        async with on.axis.stream(acceleration=ACCELERATION) as setpoint:
            setpoint(300)
            await asyncio.sleep(0.2)
            await on.axis.stop()
            assert not on.sim.moving(now())
            with pytest.raises(MoveCancelled):
                setpoint(300)
            await asyncio.sleep(0.5)
            assert not on.sim.moving(now())
        assert await on.axis.move_by(0.5)


@FAMILIES
@pytest.mark.parametrize("slow", [0.9, 0.04, 1e-50])
@virtual
async def test_a_speed_below_the_least_that_can_be_told_is_no_stall_nor_is_a_quick_one_after_it(
    make: Make, slow: float
) -> None:
    async with rig(make) as on, on.axis.stream(timeout=5.0, acceleration=ACCELERATION) as setpoint:
        setpoint(slow)
        await asyncio.sleep(3.0)
        setpoint(149)
        await asyncio.sleep(0.3)
        assert on.rpm == pytest.approx(149, abs=2)


@FAMILIES
@pytest.mark.parametrize("stop", ["axis", "bus"])
@virtual
async def test_a_stream_that_somebody_else_has_stopped_is_left_when_the_motor_stands(make: Make, stop: str) -> None:
    async with rig(make) as on:
        async with on.axis.stream(acceleration=ACCELERATION) as setpoint:
            setpoint(300)
            await asyncio.sleep(0.2)
            stopping = on.axis.stop() if stop == "axis" else on.axis.bus.emergency_stop()
        assert not on.sim.moving(now())
        await stopping


@FAMILIES
@virtual
async def test_a_stream_that_has_yet_to_begin_when_the_end_of_all_is_waited_for_ends_at_once(make: Make) -> None:
    async with rig(make) as on:
        arrived: list[float] = []
        on.axis.move_by(0.2).add_done_callback(lambda _: arrived.append(now()))

        async def source() -> None:
            async with on.axis.stream(acceleration=ACCELERATION) as setpoint:
                while True:
                    with suppress(MotionError):
                        setpoint(300)
                    await asyncio.sleep(0.02)

        streaming = asyncio.create_task(source())
        await asyncio.sleep(0)
        await on.axis.drain()
        assert all(abs(rpm) < 1 for at, rpm in on.speeds if at > arrived[0] + 0.01)
        streaming.cancel()
        await asyncio.wait([streaming])


@virtual
async def test_a_fault_ends_the_stream_within_half_a_second() -> None:
    async with rig(one_tlr) as on:
        with pytest.raises(DriveFault, match="position error"):
            async with on.axis.stream(acceleration=ACCELERATION) as setpoint:
                for step in range(1000):
                    setpoint(300 + step % 7)
                    await asyncio.sleep(0.02)
                    if step == 50:
                        on.sim.fail(5, now())
                        begun = now()
        assert now() - begun < 0.5


@FAMILIES
@virtual
async def test_a_drive_that_does_not_do_what_it_is_told_is_noticed(make: Make) -> None:
    async with rig(make) as on:
        receive = on.sim.receive

        def idle(frame: bytes, at: float) -> bytes | None:
            body = frame[:6]
            return body + crc(body) if frame[1] in (6, 16) else receive(frame, at)  # type: ignore[no-any-return]

        with pytest.raises(MoveFailed):
            async with on.axis.stream(acceleration=ACCELERATION) as setpoint:
                on.sim.receive = idle
                for _ in range(100):
                    setpoint(100)
                    await asyncio.sleep(0.05)
        on.sim.receive = receive


@FAMILIES
@pytest.mark.parametrize("lost", [1, 3])
@virtual
async def test_lost_replies_cost_a_delay_and_no_stop(make: Make, lost: int) -> None:
    async with rig(make) as on, on.axis.stream(acceleration=ACCELERATION) as setpoint:
        for step in range(100):
            setpoint(300 + step)
            await asyncio.sleep(0.02)
            if step == 50:
                lose_replies(on.sim, lost)
        assert on.rpm == pytest.approx(399, abs=15)


@virtual
async def test_a_status_that_goes_on_saying_that_the_motor_moves_keeps_no_stream_from_ending() -> None:
    make: Make = lambda: (SimMks(1, stuck_status=Status.SLOWING_DOWN), lambda bus: MksServo(bus, 1))  # noqa: E731
    async with rig(make) as on:
        async with on.axis.stream(timeout=0.25) as setpoint:
            for rpm in (60, 120, -60):
                setpoint(rpm)
                await asyncio.sleep(0.1)
            begun = now()
        assert now() - begun < 1.0
        await on.axis.move_by(0.2)


@FAMILIES
@virtual
async def test_a_stream_that_is_left_when_its_drive_does_not_answer_ends_by_an_error(make: Make) -> None:
    for silent in (0.3, 0.8, 1.5, 2.5):
        async with rig(make) as on:
            begun = 0.0
            with suppress(MotionError):
                async with on.axis.stream(timeout=0.25) as setpoint:
                    for rpm in (60, 120, -60):
                        setpoint(rpm)
                        await asyncio.sleep(0.05)
                    receive = on.sim.receive
                    on.sim.receive = lambda frame, at: None
                    asyncio.get_running_loop().call_later(silent, lambda: setattr(on.sim, "receive", receive))  # noqa: B023
                    begun = now()
            assert now() - begun < 4.0 + silent
            await on.axis.enable()
            await on.axis.stop()


@FAMILIES
@virtual
async def test_a_loss_of_the_last_frame_is_made_good(make: Make) -> None:
    """Also of the one that tells it to stand."""
    async with rig(make) as on, on.axis.stream(timeout=30.0, acceleration=math.inf) as setpoint:
        for rpm in (200, 0, -100, 0):
            receive, on.sim.receive = on.sim.receive, lambda frame, at: None
            setpoint(rpm)
            await asyncio.sleep(0.004)
            on.sim.receive = receive
            await asyncio.sleep(1.0)
            assert on.rpm == pytest.approx(rpm, abs=3)


@FAMILIES
@virtual
async def test_a_stream_on_a_bad_line_keeps_going(make: Make) -> None:
    noise = Noise(lost_reply=0.025, lost_request=0.025, flipped=0.01, stray=0.01)
    async with rig(make, noise=noise, seed=3) as on, on.axis.stream(acceleration=ACCELERATION) as setpoint:
        rng = random.Random(1)
        for _ in range(200):
            setpoint(rng.uniform(-200, 200))
            await asyncio.sleep(0.02)
        for _ in range(50):
            setpoint(250)
            await asyncio.sleep(0.02)
        assert on.rpm == pytest.approx(250, abs=5)


@FAMILIES
@virtual
async def test_a_stream_stays_within_the_limits(make: Make) -> None:
    async with rig(make) as on:
        on.axis.limits = (-2.0, 3.0)
        await on.axis.set_zero()
        async with on.axis.stream(acceleration=ACCELERATION) as setpoint:
            for rpm, end in ((600, 3.0), (-600, -2.0)):
                reached = []
                for _ in range(150):
                    setpoint(rpm)
                    await asyncio.sleep(0.02)
                    reached.append(on.sim.shaft(now()))
                assert max(reached) <= 3.0 + 1 / 4000
                assert min(reached) >= -2.0 - 1 / 4000
                assert abs(reached[-1] - end) < 1.5


# What may be said


@FAMILIES
@virtual
async def test_what_is_no_set_point_is_refused_where_it_is_said(make: Make) -> None:
    async with rig(make) as on:
        with pytest.raises(LimitExceeded):
            on.axis.stream(timeout=0.0)
        with pytest.raises(LimitExceeded):
            on.axis.stream(acceleration=-1.0)
        async with on.axis.stream() as setpoint:
            with pytest.raises(LimitExceeded):
                setpoint(math.nan)
            with pytest.raises(TypeError):
                setpoint("fast")
            setpoint(1e9)  # as fast as it goes
            await asyncio.sleep(0.1)
            assert 0 < setpoint.sent <= on.axis._ability.fastest[0]
        with pytest.raises(MotionError, match="has ended"):
            setpoint(1.0)


@FAMILIES
@virtual
async def test_an_axis_that_is_not_enabled_takes_no_stream(make: Make) -> None:
    async with rig(make) as on:
        await on.axis.disable()
        with pytest.raises(NotEnabled):
            async with on.axis.stream():
                pass


@FAMILIES
@virtual
async def test_a_stream_goes_on_from_a_run_and_a_move_waits_for_its_end(make: Make) -> None:
    async with rig(make) as on:
        await on.axis.run(300, acceleration=ACCELERATION)
        async with on.axis.stream(acceleration=ACCELERATION) as setpoint:
            assert setpoint.sent == 300
            move = on.axis.move_to(0.0)
            for _ in range(20):
                setpoint(200)
                await asyncio.sleep(0.02)
            assert on.rpm == pytest.approx(200, abs=3)
            assert not move.done()
        assert await move == pytest.approx(0.0, abs=0.01)


@virtual
async def test_a_drive_without_a_watchdog_is_warned_of_once(caplog: pytest.LogCaptureFixture) -> None:
    async with rig(one_tlr) as on:
        caplog.set_level(logging.WARNING)
        for _ in range(2):
            async with on.axis.stream():
                pass
            await on.axis.run(60)
            await on.axis.stop()
        assert caplog.text.count("has no watchdog") == 1


# Runs that replace others


@FAMILIES
@virtual
async def test_a_run_may_replace_those_before_it(make: Make) -> None:
    async with rig(make) as on:
        first = on.axis.run(300, acceleration=300)
        waiting = on.axis.run(200, acceleration=300)
        await asyncio.sleep(0.3)
        last = on.axis.run(100, acceleration=300, replace=True)
        with pytest.raises(MoveCancelled, match="was replaced"):
            await waiting
        await first  # as done
        begun = now()
        await last
        assert now() - begun < 1.2
        await asyncio.sleep(0.02)  # what is measured is the mean of the 10 ms before
        assert on.rpm == pytest.approx(100, abs=5)
        on.axis.run(0, acceleration=300, replace=True)
        await on.axis.drain()
        assert not on.sim.moving(now())


@FAMILIES
@virtual
async def test_runs_that_replace_each_other_at_20_hertz_fill_no_queue(make: Make) -> None:
    async with rig(make) as on:
        runs = []
        for step in range(60):
            runs.append(on.axis.run(100 + step, acceleration=ACCELERATION, replace=True))
            await asyncio.sleep(0.05)
        await runs[-1]
        assert on.rpm == pytest.approx(159, abs=5)
        for each in runs:
            with suppress(MoveCancelled):
                await each


# Axes together


@virtual
async def test_a_group_is_told_with_one_call_and_all_stop_where_one_fails() -> None:
    mks, tlr = SimMks(1), SimTlr(2, machine=TlrMachine(origin=None))
    async with open_bus(VirtualLine(mks, tlr)) as bus:
        x, y = MksServo(bus, 1), TlrStepper(bus, 2)
        group = AxisGroup(x=x, y=y)
        await group.enable()
        with pytest.raises(DriveFault):
            async with group.stream(acceleration=ACCELERATION) as setpoint:
                for step in range(200):
                    setpoint(x=200, y=-100)
                    await asyncio.sleep(0.02)
                    if step == 50:
                        assert setpoint.sent == {"x": 200, "y": -100}
                        with pytest.raises(TypeError, match="x, y"):
                            setpoint(z=1.0)
                        tlr.fail(5, now())
                        begun = now()
        assert now() - begun < 0.5
        await asyncio.sleep(0.3)  # its ramp
        assert not mks.moving(now())
        await y.clear_fault()
        await group.enable()
        async with group.stream() as setpoint:
            setpoint(x=100)
            await asyncio.sleep(0.3)
        assert not mks.moving(now())


# Others on the bus


@FAMILIES
@pytest.mark.parametrize("polls", [0, 3])
@virtual
async def test_a_set_point_is_not_older_than_some_transactions_when_it_is_sent(make: Make, polls: int) -> None:
    sim, axis_of = make()
    others = [SimMks(address) for address in range(2, 2 + polls)]
    async with open_bus(VirtualLine(sim, *others)) as bus:
        axis: Axis = axis_of(bus)
        await axis.enable()

        async def poll(other: MksServo) -> None:
            while True:
                with suppress(BusError):
                    await other.position()
                await asyncio.sleep(0.01)

        polling = [asyncio.create_task(poll(MksServo(bus, other.address))) for other in others]
        delays = []
        rng = random.Random(2)
        async with axis.stream(acceleration=20000.0) as setpoint:
            for _ in range(100):
                setpoint(rng.choice([-1, 1]) * rng.uniform(20, 90))
                await asyncio.sleep(0.0193)
                delays.append(setpoint.delay)
        for task in polling:
            task.cancel()
        transaction = 0.0065
        frames = 3 if make is one_tlr else 1  # to jog once more takes three
        assert sorted(delays)[50] <= 1.5 * transaction
        assert max(delays) <= (2 + frames) * transaction + polls * transaction


@virtual
async def test_what_a_group_is_told_in_the_block_of_a_stream_of_one_is_not_awaited_there_for_ever() -> None:
    async with open_bus(VirtualLine(SimMks(1), SimMks(2))) as bus:
        x = MksServo(bus, 1)
        group = AxisGroup(x=x, y=MksServo(bus, 2))
        await group.enable()
        async with x.stream(timeout=5.0) as setpoint:
            setpoint(30)
            told = group.enable(), group.move_by(x=0.5, y=0.5)
            for each in told:
                with pytest.raises(MotionError, match="leave the block first"):
                    await each
        for each in told:
            await each
