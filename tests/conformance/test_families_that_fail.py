"""A family whose own code fails while its motor turns: the motor is stopped, and whoever waits is told an end."""

from __future__ import annotations

import asyncio
from contextlib import nullcontext
from typing import Any, cast

import pytest

from rs485bus import BusConfig
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.stopping.halt import Halt
from rs485bus.devices.mks.drive import MksWatchdog
from rs485bus.errors import (
    BusError,
    MotionError,
    MoveCancelled,
    MoveFailed,
    NoReply,
    NotSent,
    NotStanding,
    OutcomeUnknown,
    StopUnconfirmed,
)
from rs485bus.motion.plan import MustStand, Plan
from rs485bus.motion.state import MOTION
from rs485bus.wire.frames import Request, crc, write_single
from tests.conformance.acme import CONTROL, QUICK_STOP, AcmeDrive, AcmeServo
from tests.conformance.subjects import SUBJECTS, Subject, now, rig
from tests.devices.mks.bench import on_virtual_clock

ACME = SUBJECTS[-1]
JUDGES = ("ask", "see", "stop_sent")
HOOKS = ("judgement", "stopping_time", "slows_down_for", "may_start_until", *JUDGES)


LOOKS = ("on_reply", "decode", "reading", "readings", "tells", "marks", "wanted", "restarted", "a listener")
"""What is asked of a family while an axis is looked at."""


def fails(*_: Any, **__: Any) -> Any:
    raise RuntimeError("a family's own error")


def break_hook(axis: AcmeServo, hook: str) -> None:
    """Have one hook of its drive fail from now on."""
    drive = axis._acme
    if hook == "a listener":
        drive.state.listen(fails)
        return
    if hook == "readings":
        drive.__class__ = type("Broken", (type(drive),), {"readings": property(fails)})
        return
    if hook not in JUDGES:
        setattr(drive, hook, fails)
        return
    judgement = drive.judgement

    def judged(motion: Any) -> Any:
        detector = judgement(motion)
        setattr(detector, hook, fails)
        return detector

    drive.judgement = judged  # type: ignore[method-assign]


@pytest.mark.parametrize("hook", HOOKS)
@on_virtual_clock
async def test_a_stop_that_cannot_be_judged_is_sent_and_told_as_not_confirmed(hook: str) -> None:
    with pytest.RaisesGroup(StopUnconfirmed, allow_unwrapped=True):
        async with rig(ACME, count=2) as on:
            await on.axis.run(200)
            break_hook(on.axis, hook)
            async with asyncio.timeout(30):
                with pytest.raises(StopUnconfirmed):
                    await on.axis.stop()
            assert not ACME.motor(on.sim).moving(now())
            await on.axes[1].move_by(1.0)


@pytest.mark.parametrize("hook", [*HOOKS, "on_sent", "effects", "broadcast_stop"])
@on_virtual_clock
async def test_an_emergency_stop_reaches_all_whatever_fails(hook: str) -> None:
    try:
        async with rig(ACME, count=2) as on:
            for axis in on.axes:
                await axis.run(200)
            break_hook(on.axis, hook)
            async with asyncio.timeout(30):
                report = await on.bus.emergency_stop()
            assert not any(ACME.motor(sim).moving(now()) for sim in on.sims)
            assert report.devices[1].standing
    except* BusError:
        assert hook in HOOKS


@pytest.mark.parametrize("hook", ["on_sent", "effects"])
@on_virtual_clock
async def test_a_stop_goes_out_though_who_is_told_of_it_fails(hook: str) -> None:
    async with rig(ACME) as on:
        await on.axis.run(200)
        break_hook(on.axis, hook)
        async with asyncio.timeout(30):
            await on.axis.stop()
        assert not ACME.motor(on.sim).moving(now())


def causes(error: BaseException | None) -> list[str]:
    """An error, and what it came of."""
    return [] if error is None else [repr(error), *causes(error.__cause__)]


def is_told(error: BaseException, hook: str) -> bool:
    """Whether it is said what failed. Where its device does not even take replies, nothing came of them."""
    return hook == "on_reply" or "a family's own error" in causes(error)[-1]


@pytest.mark.parametrize("hook", LOOKS)
@on_virtual_clock
async def test_a_move_that_cannot_be_judged_ends_and_its_motor_is_stopped(hook: str) -> None:
    try:
        async with rig(ACME, count=2) as on:
            move = on.axis.move_to(100.0)
            await asyncio.sleep(0.3)
            break_hook(on.axis, hook)
            before, broken_at = len(on.records), now()
            async with asyncio.timeout(10):
                with pytest.raises(MoveFailed) as failed:
                    await move
            assert is_told(failed.value, hook)
            assert not ACME.motor(on.sim).moving(now())
            busy = sum(each.ended_at - each.sent_at for each in on.records[before:])
            assert busy <= 0.6 * (now() - broken_at)  # looks leave the wire to others
            await on.axes[1].move_by(1.0)
    except* BusError:
        assert hook not in ("tells", "marks", "wanted", "restarted")  # else it is seen to stand


@pytest.mark.parametrize("hook", LOOKS)
@on_virtual_clock
async def test_a_run_that_nobody_waits_for_and_that_cannot_be_judged_is_stopped(hook: str) -> None:
    with pytest.raises((BusError, ExceptionGroup)):
        async with rig(ACME, count=2) as on:
            await on.axis.run(200)
            break_hook(on.axis, hook)
            await on.rests(within=4)
            await on.axes[1].move_by(1.0)


@pytest.mark.parametrize("hook", LOOKS)
@on_virtual_clock
async def test_a_stream_that_cannot_be_judged_ends_and_its_motor_is_stopped(hook: str) -> None:
    try:
        async with rig(ACME, count=2) as on:
            async with asyncio.timeout(20):
                with pytest.raises(MoveFailed) as failed:
                    async with on.axis.stream() as setpoint:
                        setpoint(200)
                        await asyncio.sleep(0.3)
                        break_hook(on.axis, hook)
                        for _ in range(200):
                            setpoint(200)
                            await asyncio.sleep(0.05)
            assert is_told(failed.value, hook)
            assert not ACME.motor(on.sim).moving(now())
            await on.axes[1].move_by(1.0)
    except* BusError:
        assert hook not in ("tells", "marks", "wanted", "restarted")


@pytest.mark.parametrize("goes_on", [True, False])
@pytest.mark.parametrize("hook", ["setpoint", "setpoints"])
@on_virtual_clock
async def test_a_stream_whose_speeds_cannot_be_told_ends_whether_more_are_asked_for_or_not(
    hook: str, goes_on: bool
) -> None:
    async with rig(ACME, count=2) as on:
        with pytest.raises(MoveFailed) as failed:
            async with asyncio.timeout(30), on.axis.stream() as setpoint:
                setpoint(200)
                await asyncio.sleep(0.3)
                break_hook(on.axis, hook)
                for turn in range(60):
                    if goes_on or not turn:
                        setpoint(100)
                    await asyncio.sleep(0.05)
        assert is_told(failed.value, hook)
        assert not ACME.motor(on.sim).moving(now())
        await on.axes[1].move_by(1.0)


@on_virtual_clock
async def test_a_motor_whose_speeds_cannot_be_told_is_stopped_before_its_block_ends() -> None:
    async with rig(ACME) as on:
        with pytest.raises(MoveFailed):
            async with on.axis.stream() as setpoint:
                setpoint(200)
                await asyncio.sleep(0.3)
                break_hook(on.axis, "setpoint")  # first when its last set-point is too old
                await on.rests(within=2)


@on_virtual_clock
async def test_a_drive_whose_stop_cannot_be_made_is_told_as_not_standing_by_all_who_stop_it() -> None:
    """Nobody knows what stops it. That is said by its stop, by a second one, and by the bus that is closed."""
    with pytest.RaisesGroup(StopUnconfirmed, allow_unwrapped=True):
        async with rig(ACME, count=2) as on:
            await on.axis.run(200)
            on.axis._acme.state.axes[0].ramp_stop = None  # as if somebody else had set it in motion
            break_hook(on.axis, "stops")
            for _ in range(2):
                async with asyncio.timeout(30):
                    with pytest.raises(StopUnconfirmed):
                        await on.axis.stop()
            await on.axes[1].move_by(1.0)


@pytest.mark.parametrize("subject", SUBJECTS, ids=str)
@pytest.mark.parametrize("how", ["stop", "emergency_stop", "bus", "close", "stream"])
@on_virtual_clock
async def test_a_drive_whose_stop_cannot_be_made_is_stopped_as_its_start_has_said(how: str, subject: Subject) -> None:
    async with rig(subject, count=2) as on, asyncio.timeout(30):
        async with on.axis.stream(acceleration=300) if how == "stream" else nullcontext() as setpoint:
            if setpoint is None:
                await on.axis.run(200, acceleration=300)
            else:
                setpoint(200)
                await asyncio.sleep(1.5)
            on.axis.attached.stops = fails
        if how == "bus":
            report = await on.bus.emergency_stop()
            assert report.devices[0].standing
        elif how != "close":
            await (on.axis.emergency_stop() if how == "emergency_stop" else on.axis.stop())
            assert not on.moving
            await on.axes[1].move_by(1.0)
    assert not on.moving


@pytest.mark.parametrize("subject", [each for each in SUBJECTS if each.homes], ids=str)
@on_virtual_clock
async def test_a_drive_that_looks_for_its_origin_is_stopped_as_its_start_has_said(subject: Subject) -> None:
    async with rig(subject) as on, asyncio.timeout(30):
        await on.axis.move_to(5.0)
        homing = on.axis.home()
        await asyncio.sleep(0.5)
        assert on.moving
        on.axis.attached.stops = fails
        await on.axis.stop()
        assert not on.moving
        with pytest.raises(MoveCancelled):
            await homing


@on_virtual_clock
async def test_a_drive_of_which_nobody_knows_what_stops_with_it_is_stopped() -> None:
    async with rig(ACME) as on:
        await on.axis.run(200)
        break_hook(on.axis, "stopped_with")
        async with asyncio.timeout(30):
            await on.axis.stop()
        assert not on.moving


BEGINNINGS = ("tells", "marks", "restarted", "set_up", "resume", "ability", "readings", "move", "run", "setpoint")
"""What is asked of a family as a command begins."""


@pytest.mark.parametrize("hook", BEGINNINGS)
@on_virtual_clock
async def test_a_command_that_cannot_be_begun_fails_as_motions_do_and_its_motor_is_left_alone(hook: str) -> None:
    async with rig(ACME, count=2) as on:

        async def stream() -> None:
            async with on.axis.stream() as setpoint:
                setpoint(200)
                await asyncio.sleep(1.0)

        verbs = {"move": lambda: on.axis.move_to(3.0), "run": lambda: on.axis.run(200), "setpoint": stream}
        break_hook(on.axis, hook)
        sent = len(on.records)
        for verb in [verbs[hook]] if hook in verbs else verbs.values():
            async with asyncio.timeout(10):
                with pytest.raises(MotionError) as failed:
                    await verb()
            assert is_told(failed.value, hook)
        assert not on.moving
        assert not any(record.request[-3] == QUICK_STOP for record in on.records[sent:])  # it stood, as was known
        await on.axes[1].move_by(1.0)


@pytest.mark.parametrize("hook", ["tells", "readings", "reading", "ability"])
@on_virtual_clock
async def test_a_question_whose_answer_cannot_be_had_fails_as_motions_do(hook: str) -> None:
    async with rig(ACME) as on:
        break_hook(on.axis, hook)
        with pytest.raises(MotionError) as failed:
            await on.axis.position()
        assert is_told(failed.value, hook)


@pytest.mark.parametrize("question", ["idle", "position", "velocity"])
@pytest.mark.parametrize("is_new", [False, True])
@on_virtual_clock
async def test_what_a_drive_does_not_tell_is_not_said_from_memory(question: str, is_new: bool) -> None:
    async with rig(ACME) as on:
        await on.axis.position()
        await asyncio.sleep(1.0)
        on.axis._acme.decode = lambda *_: ()
        if is_new:
            on.axis._acme.state.axes[0].change(MOTION, now())
        before = len(on.records)
        with pytest.raises(NoReply):
            await getattr(on.axis, question)()
        assert len(on.records) - before < 200  # within 5 s: others have the wire, too


@on_virtual_clock
async def test_a_frame_of_which_nobody_knows_what_it_does_may_do_anything() -> None:
    async with rig(ACME) as on:
        break_hook(on.axis, "effects")
        await on.axis.move_by(3.0)
        assert on.turns == pytest.approx(3.0, abs=0.01)


@on_virtual_clock
async def test_of_a_family_that_fails_to_say_what_a_request_does_the_worst_is_taken_to_be_so() -> None:
    async with rig(ACME, count=2) as on:
        unit, receive = on.bus.unit(1), on.sim.receive
        for hook in ("hears", "may_be_moved_by", "does_nothing", "explain"):
            break_hook(on.axis, hook)
        await on.bus.broadcast.write_register(CONTROL, QUICK_STOP)
        await unit.write_register(CONTROL, QUICK_STOP)
        for answer in (bytes((1, 0x86, 4)) + crc(bytes((1, 0x86, 4))), b"\xfa\x01\x02"):
            on.sim.receive = lambda frame, at, answer=answer: answer if frame[0] == 1 else None
            with pytest.raises(OutcomeUnknown):
                await unit.write_register(CONTROL, QUICK_STOP)
        on.sim.receive = receive
        await on.axes[1].move_by(1.0)


@on_virtual_clock
async def test_a_watched_drive_whose_family_forgets_its_reads_is_fed_by_those_that_are_known() -> None:
    async with rig(SUBJECTS[0], count=2) as on, on.bus.watchdog(*on.axes, timeout=1.0):
        on.axis.attached.reads = fails
        await asyncio.sleep(3.0)
        await on.axis.move_by(1.0)  # it has not tripped
        await on.axes[1].move_by(1.0)


@on_virtual_clock
async def test_what_may_disrupt_is_not_written_while_a_watchdog_is_armed() -> None:
    async with rig(SUBJECTS[0], count=2) as on, on.bus.watchdog(*on.axes, timeout=1.0):
        await on.axis.run(200)
        on.axis.attached.disrupts = fails
        with pytest.raises(NotSent):
            await on.axis.move_by(1.0)
        await on.axes[1].move_by(1.0)
        await on.axis.stop()
        assert not on.moving


@on_virtual_clock
async def test_a_neighbour_that_cannot_tell_whether_it_hears_a_broadcast_is_named(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with rig(ACME, count=2) as on:
        on.axis._acme.broadcast_stop = lambda: write_single(0, CONTROL, QUICK_STOP)
        on.axes[1]._acme.family = "another"
        break_hook(on.axes[1], "hears")
        await on.bus.emergency_stop()
        assert "unit 2: its family's own code failed in hears" in caplog.text
        assert "unit 1" not in caplog.text
        assert not any(record.address == 0 for record in on.records)  # what it would make of that, nobody knows


def test_a_stop_said_blindly_counts_as_said() -> None:
    drive = AcmeDrive(1)
    drive.judgement = fails  # type: ignore[method-assign]
    halt = Halt(drive, drive.motion, True, 0.0)
    assert not halt.is_said
    procedure = halt.run(cast(Any, None))
    stop = next(procedure)
    assert isinstance(stop, Job)
    stop.attempts, stop.sent_at = 1, 0.5
    procedure.send(0.6)
    assert halt.is_said


class BrokenRegister(MksWatchdog):
    """A watchdog register that cannot be told any time from some moment on."""

    broken = False

    def write(self, milliseconds: int) -> Request:
        if self.broken:
            fails()
        return super().write(milliseconds)


@pytest.mark.parametrize("armed", [False, True])
@on_virtual_clock
async def test_a_watchdog_block_whose_register_cannot_be_told_is_entered_or_left_with_an_error(armed: bool) -> None:
    async with rig(SUBJECTS[0], count=2) as on:
        on.axis.attached.watchdog = register = BrokenRegister(1)
        register.broken = not armed
        with nullcontext() if armed else pytest.raises(RuntimeError, match="own error"):
            async with asyncio.timeout(2.5), on.axis.watchdog(1.0):
                await on.axis.run(200)
                register.broken = True
        assert not on.moving
        register.broken = False
        async with asyncio.timeout(2.5), on.axis.watchdog(1.0):
            await on.axis.run(200)
        await on.axes[1].move_by(1.0)


@pytest.mark.parametrize("ends", ["close", "emergency stop", "watchdog block"])
@on_virtual_clock
async def test_a_facade_that_cannot_end_what_is_queued_keeps_nobody_from_a_stop(ends: str) -> None:
    subject = SUBJECTS[0] if ends == "watchdog block" else ACME
    async with rig(subject, count=2) as on, asyncio.timeout(10):
        async with on.bus.watchdog(*on.axes, timeout=1.0) if ends == "watchdog block" else nullcontext():
            for axis in on.axes:
                await axis.run(200)
            on.axis.abandon = fails
        if ends == "emergency stop":
            await on.bus.emergency_stop()
        stands = [not subject.motor(sim).moving(now()) for sim in on.sims]
        assert all(stands) or ends == "close"
    assert on.bus.closed
    assert not any(subject.motor(sim).moving(now()) for sim in on.sims)


@on_virtual_clock
async def test_a_watchdog_that_cannot_be_turned_off_keeps_no_other_one_armed() -> None:
    async with rig(SUBJECTS[0], count=2, config=BusConfig(leave_running=True)) as on:
        on.axis.attached.watchdog = register = BrokenRegister(1)
        await on.bus.watchdog(*on.axes, timeout=1.0).__aenter__()
        register.broken = True
    assert [sim.watchdog_ms for sim in on.sims] == [1000, 0]


@on_virtual_clock
async def test_an_emergency_stop_that_fails_in_itself_says_so_and_has_stopped_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with rig(ACME, count=2) as on:
        for axis in on.axes:
            await axis.run(200)
        monkeypatch.setattr(on.bus.owner, "flush", fails)
        async with asyncio.timeout(10):
            with pytest.raises(RuntimeError, match="own error"):
                await on.bus.emergency_stop()
        await asyncio.sleep(1.0)
        assert on.bus.latched
        assert not any(ACME.motor(sim).moving(now()) for sim in on.sims)
        monkeypatch.undo()


@on_virtual_clock
async def test_a_closing_that_fails_in_itself_ends_and_says_what_was_not_seen_to_stand(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with pytest.RaisesGroup(StopUnconfirmed, allow_unwrapped=True):
        async with rig(ACME) as on:
            await on.axis.run(200)
            monkeypatch.setattr("rs485bus.bus.stopping.closing.release", fails)
            begun = now()
    assert on.bus.closed
    assert now() - begun < 1.0


@on_virtual_clock
async def test_a_motor_that_cannot_be_made_safe_after_a_failure_is_stopped() -> None:
    async with rig(ACME) as on:
        await on.axis.run(200)
        on.axis._executor.make_safe = fails
        with pytest.raises(NotStanding):
            await on.axis._order_plan("what needs a standing motor", needs_a_stand)
        await on.rests(within=1)
        await on.axis.move_by(1.0)


def needs_a_stand() -> Plan[None]:
    yield MustStand("this")


@on_virtual_clock
async def test_a_queue_whose_stop_fails_says_so_and_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    async with rig(ACME) as on:
        await on.axis.run(200)
        begin_stop, on.axis._stops.begin_stop = on.axis._stops.begin_stop, fails
        break_hook(on.axis, "set_up")
        with pytest.raises(MotionError) as failed:
            await on.axis.move_by(1.0)
        assert is_told(failed.value, "set_up")
        assert "could not be stopped" in caplog.text
        on.axis._stops.begin_stop = begin_stop
        with pytest.raises(MotionError):
            await on.axis.move_by(1.0)
        await on.rests(within=1)
