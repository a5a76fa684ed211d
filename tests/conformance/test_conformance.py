"""What every family promises."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from rs485bus import AxisGroup, MoveState
from rs485bus.bus.schedule.job import Urgency
from rs485bus.errors import BusError, LimitExceeded, MotionError, MoveCancelled, NotEnabled, NotSupported, ReferenceLost
from tests.conformance.subjects import EACH, Subject, now, rig
from tests.devices.mks.bench import on_virtual_clock

RATES = pytest.mark.parametrize("rate", [0, 20])


@EACH
@on_virtual_clock
async def test_it_moves_only_when_it_is_enabled_and_holds_no_longer_when_it_is_disabled(subject: Subject) -> None:
    async with rig(subject) as on:
        await on.axis.move_to(1.0)
        await on.axis.disable()
        with pytest.raises(NotEnabled):
            await on.axis.move_to(2.0)
        await on.axis.enable()
        await on.axis.move_to(2.0)
        assert on.turns == pytest.approx(2.0, abs=0.01)


@EACH
@on_virtual_clock
async def test_moves_end_where_they_should_each_once_and_tell_what_they_do(subject: Subject) -> None:
    async with rig(subject) as on:
        first = on.axis.move_to(3.0, rpm=200)
        then = on.axis.move_by(-1.0, rpm=100)
        assert (first.state, first.target, then.target) == (MoveState.QUEUED, 3.0, None)
        assert await first == pytest.approx(3.0, abs=0.01)
        assert await then == pytest.approx(2.0, abs=0.01)
        assert on.turns == pytest.approx(2.0, abs=0.01)
        assert (first.rpm, then.rpm) == (pytest.approx(200, abs=1), pytest.approx(100, abs=1))
        assert first.started_at < first.eta
        assert await on.axis.idle()


@EACH
@on_virtual_clock
async def test_a_run_is_done_at_its_speed_and_zero_is_a_stand(subject: Subject) -> None:
    async with rig(subject) as on:
        await on.axis.run(-120)
        assert on.subject.motor(on.sim).rpm(now()) == pytest.approx(-120, abs=2)
        assert await on.axis.velocity() == pytest.approx(-120, abs=3)
        await on.axis.run(0)
        assert not on.moving


@EACH
@on_virtual_clock
async def test_what_it_cannot_be_told_is_refused_before_anything_is_sent(subject: Subject) -> None:
    async with rig(subject) as on:
        sent = len(on.records)
        with pytest.raises(LimitExceeded):
            on.axis.run(1e6)
        with pytest.raises(LimitExceeded):
            on.axis.move_to(1.0, acceleration=1e-3)
        with pytest.raises(LimitExceeded):
            on.axis.move_to(float("nan"))
        with pytest.raises(TypeError):
            on.axis.run("fast")
        assert len(on.records) == sent


@pytest.mark.parametrize("verb", ["stop", "emergency_stop"])
@EACH
@on_virtual_clock
async def test_a_stop_overtakes_everything_and_is_seen(subject: Subject, verb: str) -> None:
    async with rig(subject) as on:
        move, waits = on.axis.move_to(100.0), on.axis.move_to(0.0)
        await asyncio.sleep(1.0)
        polls = [asyncio.ensure_future(on.axis.position()) for _ in range(20)]
        begun = now()
        await getattr(on.axis, verb)()
        assert not on.moving
        stands = on.turns
        stop = next(record for record in on.records if record.urgency is Urgency.STOP and record.sent_at >= begun)
        assert stop.sent_at - begun < 0.01
        for handle in (move, waits):
            with pytest.raises(MoveCancelled):
                await handle
        await asyncio.gather(*polls, return_exceptions=True)
        await asyncio.sleep(1.0)
        assert on.turns == stands


@EACH
@on_virtual_clock
async def test_an_emergency_stop_of_the_bus_latches_until_it_is_cleared_and_enabled_again(subject: Subject) -> None:
    async with rig(subject) as on:
        move = on.axis.move_to(100.0)
        await asyncio.sleep(1.0)
        report = await on.bus.emergency_stop()
        assert not on.moving
        assert all(device.standing for device in report.devices)
        with pytest.raises(BusError):
            await move
        on.bus.clear_emergency_stop()
        await on.axis.enable()
        with suppress(ReferenceLost):
            await on.axis.move_by(0.5)


@EACH
@on_virtual_clock
async def test_zero_is_where_it_was_set_and_home_where_it_was_found(subject: Subject) -> None:
    async with rig(subject) as on:
        await on.axis.move_to(1.5)
        await on.axis.set_zero()
        assert await on.axis.position() == pytest.approx(0.0, abs=0.01)
        await on.axis.move_to(0.5)
        assert on.turns == pytest.approx(2.0, abs=0.01)
        if subject.homes:
            await on.axis.home()
            assert await on.axis.position() == pytest.approx(0.0, abs=0.01)
            assert not on.moving


@RATES
@pytest.mark.parametrize("verb", ["move", "run"])
@EACH
@on_virtual_clock
async def test_a_fault_is_told_within_half_a_second_and_the_motor_stands(
    subject: Subject, verb: str, rate: int
) -> None:
    async with rig(subject) as on:
        move = on.axis.move_to(500.0) if verb == "move" else on.axis.run(300)
        polling = asyncio.ensure_future(_poll(on.axis, rate))
        await asyncio.sleep(1.0)
        subject.fails(on.sim, now())
        begun, told = now(), None
        while told is None:
            assert now() - begun <= 0.5
            await asyncio.sleep(0.01)
            told = _failure(on.axis, move)
        polling.cancel()
        assert isinstance(told, MotionError)
        await on.rests(0.5)


@pytest.mark.parametrize("where", ["standing", "moving", "after a jog"])
@EACH
@on_virtual_clock
async def test_a_restart_is_noticed_before_the_next_motion(subject: Subject, where: str) -> None:
    async with rig(subject) as on:
        await on.axis.move_to(3.0)
        if where == "after a jog":
            await on.axis.run(60)
            await on.axis.stop()
        move = on.axis.move_to(100.0) if where == "moving" else None
        if move is not None:
            await asyncio.sleep(1.0)
        subject.restarts(on.sim, now())
        await asyncio.sleep(2.0)
        if move is not None:
            with pytest.raises(MotionError):
                await move
        stands = on.turns
        with suppress(BusError):
            await on.axis.enable()
        with pytest.raises(BusError):
            await on.axis.move_to(5.0)
        assert on.turns == stands
        with suppress(BusError):
            await on.axis.enable()
        await on.axis.set_zero()
        await on.axis.enable()
        await on.axis.move_to(0.5)
        assert on.turns == pytest.approx(stands + 0.5, abs=0.02)


@EACH
@on_virtual_clock
async def test_motion_that_somebody_else_began_is_seen_and_stopped_when_the_bus_block_is_left_by_an_error(
    subject: Subject,
) -> None:
    with pytest.raises(ZeroDivisionError):
        async with rig(subject) as on:
            await on.axis.run(100)
            raise ZeroDivisionError
    assert not subject.motor(on.sim).moving(1e9)


@EACH
@on_virtual_clock
async def test_one_that_goes_silent_is_stopped_and_its_command_ends(subject: Subject) -> None:
    async with rig(subject) as on:
        move = on.axis.move_to(500.0)
        await asyncio.sleep(1.0)
        receive = on.sim.receive
        # Reads are lost, writes are heard.
        on.sim.receive = lambda frame, at: None if frame[1] in (3, 4) else receive(frame, at)
        with pytest.raises(BusError):
            await move
        await on.rests(0.1)
        on.sim.receive = receive


VERBS: dict[str, Callable[[Any], Any]] = {
    "enable": lambda axis: axis.enable(),
    "disable": lambda axis: axis.disable(),
    "move": lambda axis: axis.move_by(2.0),
    "run": lambda axis: axis.run(60),
    "stop": lambda axis: axis.stop(),
    "zero": lambda axis: axis.set_zero(),
    "home": lambda axis: axis.home(),
}
FRAMES = 8
"""So many frames of each verb are lost, one in each run: the steps of its plan, and the first looks."""


@pytest.mark.parametrize("lost", ["request", "reply"])
@pytest.mark.parametrize("verb", VERBS)
@EACH
def test_whatever_frame_is_lost_what_is_said_of_a_verb_is_so(subject: Subject, verb: str, lost: str) -> None:
    @on_virtual_clock
    async def lose(number: int) -> None:
        async with rig(subject) as on:
            await on.axis.move_to(1.0)
            if verb == "stop":
                await on.axis.run(60)
            on.frames(number, lost)
            try:
                await VERBS[verb](on.axis)
            except BusError:
                on.axis.forgive()
                await on.rests(1.5)
                return
            if verb == "move":
                assert on.turns == pytest.approx(3.0, abs=0.01)
            elif verb in ("zero", "home"):
                assert await on.axis.position() == pytest.approx(0.0, abs=0.01)
            elif verb == "disable":
                with pytest.raises(NotEnabled):
                    await on.axis.move_to(2.0)
            elif verb == "run":
                assert on.subject.motor(on.sim).rpm(now()) == pytest.approx(60, abs=2)
            await asyncio.sleep(0.5)
            assert on.moving is (verb == "run")

    for number in range(FRAMES if verb != "home" or subject.homes else 0):
        lose(number)


@EACH
@on_virtual_clock
async def test_two_axes_in_a_group_arrive_together_and_stop_together(subject: Subject) -> None:
    async with rig(subject, count=2) as on:
        x, y = on.axes
        move = AxisGroup(x=x, y=y).move_to(x=3.0, y=1.0, duration=3.0)
        assert await move == {"x": pytest.approx(3.0, abs=0.01), "y": pytest.approx(1.0, abs=0.01)}
        move = AxisGroup(x=x, y=y).move_to(x=200.0, y=200.0)
        await asyncio.sleep(1.0)
        subject.fails(on.sims[0], now())
        begun = now()
        while subject.motor(on.sims[1]).moving(now()):
            assert now() - begun <= 0.6 + 0.3
            await asyncio.sleep(0.01)
        with pytest.raises(MotionError):
            await move


@EACH
@on_virtual_clock
async def test_a_watchdog_block_leaves_it_unarmed_and_standing(subject: Subject) -> None:
    if not subject.watchdog:
        async with rig(subject) as on:
            with pytest.raises((BusError, ValueError, TypeError, NotImplementedError)):
                async with on.bus.watchdog(on.axis, timeout=1.0):
                    pass
        return
    async with rig(subject, enable=False) as on:
        async with on.bus.watchdog(on.axis, timeout=0.5):
            await on.axis.enable()
            await on.axis.run(60)
            await asyncio.sleep(3.0)
            assert on.moving
            assert on.sim.watchdog_ms == 500
        assert not on.moving
        assert on.sim.watchdog_ms != 500


@EACH
@on_virtual_clock
async def test_a_stream_turns_it_and_its_end_stops_it(subject: Subject) -> None:
    async with rig(subject) as on:
        if not subject.streams:
            with pytest.raises(NotSupported):
                async with on.axis.stream() as setpoint:
                    setpoint(50)
            return
        async with on.axis.stream(timeout=0.5, acceleration=1000) as setpoint:
            for rpm in (50, 100, 150):
                setpoint(rpm)
                await asyncio.sleep(0.3)
            assert on.subject.motor(on.sim).rpm(now()) == pytest.approx(150, abs=8)
        assert not on.moving


@EACH
@on_virtual_clock
async def test_no_sample_tells_a_speed_from_before_the_axis_was_told_otherwise(subject: Subject) -> None:
    async with rig(subject) as on:
        for rpm in (60, 120):
            await on.axis.run(rpm)
            assert await on.axis.velocity() == pytest.approx(rpm, abs=8)
            assert on.axis.sample.rpm == pytest.approx(rpm, abs=8)
        await on.axis.stop()
        assert (on.axis.sample.moving, on.axis.sample.rpm) == (False, 0.0)
        await on.axis.move_by(1.0)
        assert (on.axis.sample.moving, on.axis.sample.rpm) == (False, 0.0)
        run = on.axis.run(200)
        await asyncio.sleep(0.05)  # it was told by now
        assert on.axis.sample.rpm in (None, pytest.approx(on.subject.motor(on.sim).rpm(now()), abs=40))
        await run


@EACH
@on_virtual_clock
async def test_any_reply_feeds_the_sample_and_samples_and_events_come(subject: Subject) -> None:
    async with rig(subject) as on:
        events: list[str] = []

        async def listen() -> None:
            async for event in on.axis.events():
                events.append(event.kind.value)  # noqa: PERF401 - it is read meanwhile

        listening = asyncio.ensure_future(listen())
        await on.axis.move_to(1.0)
        assert on.axis.sample.position == pytest.approx(1.0, abs=0.01)
        assert on.axis.sample.moving is False
        taken = []
        async for sample in on.axis.samples(every=0.1):
            taken.append(sample)
            if len(taken) == 3:
                break
        assert all(sample.age < 0.2 for sample in taken)
        await on.axis.run(60)
        await on.axis.stop()
        await asyncio.sleep(0.1)
        listening.cancel()
        assert "stop" in events


async def _poll(axis: object, rate: int) -> None:
    while rate:
        await asyncio.sleep(1 / rate)
        with suppress(BusError):
            await axis.position()  # type: ignore[attr-defined]


def _failure(axis: object, move: object) -> BusError | None:
    """What the next one is told who gives a command, if it is anything."""
    error = move.error  # type: ignore[attr-defined]
    if error is not None:
        move.seen = True  # type: ignore[attr-defined]
        return error  # type: ignore[no-any-return]
    try:
        axis.check_ready()  # type: ignore[attr-defined]
    except BusError as unseen:
        return unseen
    return None
