"""What an exception says of a write: that nothing was done, or not."""

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.failure import failure
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.tlr.drive import TlrDrive
from rs485bus.errors import DeviceRefused, NoReply, OutcomeUnknown
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from tests.bus.oracle import FINE, LOST, Oracle, Step, does_and_says, refuses
from tests.bus.support import drives

WRITE = write_single(1, 3, 7)
READ = read_holding(1, 3, 1)


def asked(*script: Step, write: bool = True, repeat: Repeat = Repeat.NEVER) -> tuple[Job, Oracle]:
    """A request to a unit that follows the script, and how it ended."""
    unit = Oracle(1, *script)
    rig = Rig(unit)
    job = rig.submit(WRITE if write else READ, repeat=repeat)
    rig.done(job)
    return job, unit


@pytest.mark.parametrize("code", [1, 2, 3])
def test_after_01_02_and_03_nothing_was_done(code: int) -> None:
    job, unit = asked(refuses(code))
    assert (job.outcome, job.code, len(unit.frames)) == (Outcome.REFUSED, code, 1)
    assert "Nothing was done." in str(failure(job, ()))


@pytest.mark.parametrize("repeat", Repeat)
@pytest.mark.parametrize("code", [4, 5, 7, 8, 9, 12, 0x80, 255])
def test_a_write_that_is_answered_by_any_other_code_of_the_device_may_have_been_done(code: int, repeat: Repeat) -> None:
    job, unit = asked(does_and_says(code), repeat=repeat)
    assert (job.outcome, job.code, len(unit.writes)) == (Outcome.UNKNOWN, code, 1)
    error = failure(job, ())
    assert isinstance(error, OutcomeUnknown)
    assert f"(exception {code:02})" in str(error)
    assert "othing was done" not in str(error)


@pytest.mark.parametrize("code", [1, 2, 3, 4, 5, 7, 8, 9, 255])
def test_a_read_that_is_answered_by_an_exception_is_refused_and_has_changed_nothing(code: int) -> None:
    job, _ = asked(refuses(code), write=False, repeat=Repeat.SAFE)
    assert (job.outcome, job.code, job.attempts) == (Outcome.REFUSED, code, 1)
    assert "Nothing was done." in str(failure(job, ()))


def test_of_a_refused_block_a_part_may_have_been_written_and_the_message_says_so() -> None:
    unit = Oracle(1, refuses(3), refuses(2), refuses(1), refuses(3))
    rig = Rig(unit)
    blocks = [rig.submit(write_multiple(1, 3, [7, 8]), repeat=Repeat.NEVER) for _ in range(3)]
    one = rig.submit(write_multiple(1, 3, [7]), repeat=Repeat.NEVER)
    rig.done(*blocks, one)
    assert {job.outcome for job in (*blocks, one)} == {Outcome.REFUSED}
    assert ["part of the block" in str(failure(job, ())) for job in (*blocks, one)] == [True, True, False, False]
    assert ["Nothing was done." in str(failure(job, ())) for job in (*blocks, one)] == [False, False, True, True]


# 06


@pytest.mark.parametrize("write", [True, False])
@pytest.mark.parametrize("repeat", [Repeat.SAFE, Repeat.VERIFY])
def test_what_a_device_is_too_busy_for_is_asked_again_after_a_pause(write: bool, repeat: Repeat) -> None:
    job, unit = asked(refuses(6), refuses(6), write=write, repeat=repeat)
    assert (job.outcome, job.attempts, len(unit.writes)) == (Outcome.REPLY, 3, int(write))
    assert job.sent_at - job.queued_at >= 0.1 + 0.2


def test_a_write_that_must_not_be_repeated_and_finds_the_device_busy_was_not_done() -> None:
    job, unit = asked(refuses(6))
    assert (job.outcome, job.attempts, len(unit.writes)) == (Outcome.REFUSED, 1, 0)
    assert "busy (exception 06)" in str(failure(job, ()))
    assert "Nothing was done. Ask again later." in str(failure(job, ()))


def test_a_device_that_stays_busy_has_refused() -> None:
    job, unit = asked(*3 * [refuses(6)], repeat=Repeat.SAFE)
    assert (job.outcome, job.attempts, len(unit.writes)) == (Outcome.REFUSED, 3, 0)


def test_a_write_that_was_lost_once_and_refused_as_busy_then_is_unknown() -> None:
    job, unit = asked(LOST, refuses(6), refuses(6), repeat=Repeat.SAFE)
    assert (job.outcome, len(unit.writes)) == (Outcome.UNKNOWN, 1)


def test_while_a_device_is_busy_the_others_have_the_wire() -> None:
    rig = Rig(Oracle(1, refuses(6)), Oracle(2))
    busy = rig.submit(READ)
    others = [rig.submit(read_holding(2, at, 1)) for at in range(10)]
    rig.done(*others)
    assert busy.outcome is None
    rig.done(busy)
    assert busy.outcome is Outcome.REPLY


def test_what_waits_for_a_busy_device_ends_in_time_and_was_refused() -> None:
    unit = Oracle(1, refuses(6), FINE)
    rig = Rig(unit)
    job = rig.submit(WRITE, expires_at=rig.now + 0.05)
    rig.done(job)
    assert (job.outcome, job.reason, job.ended_at) == (Outcome.REFUSED, Reason.EXPIRED, pytest.approx(100.05))
    assert unit.writes == []


def test_what_waits_for_a_busy_device_does_not_follow_a_stop() -> None:
    motion = Motion()
    unit = Oracle(1, refuses(6))
    rig = Rig(unit)
    job = rig.submit(WRITE, moves=True, motion=motion)
    rig.run(0.02)
    motion.stop()
    rig.run(1.0)
    assert (job.outcome, unit.writes) == (Outcome.REFUSED, [])


# Gateways


@pytest.mark.parametrize("code", [10, 11])
def test_what_a_gateway_says_of_a_silent_device_is_no_answer_of_that(code: int) -> None:
    read, _ = asked(*3 * [refuses(code)], write=False, repeat=Repeat.SAFE)
    write, unit = asked(does_and_says(code))
    assert (read.outcome, read.attempts) == (Outcome.NO_REPLY, 3)
    assert (write.outcome, write.attempts, len(unit.writes)) == (Outcome.UNKNOWN, 1, 1)
    errors = [failure(job, ()) for job in (read, write)]
    assert [type(error) for error in errors] == [NoReply, OutcomeUnknown]
    assert all(f"the gateway says: the {NAMES[code]}" in str(error) for error in errors)


NAMES = {10: "gateway has no path", 11: "device did not answer"}


def test_a_read_that_a_gateway_gives_up_once_is_repeated() -> None:
    job, _ = asked(refuses(11), write=False, repeat=Repeat.SAFE)
    assert (job.outcome, job.attempts) == (Outcome.REPLY, 2)


def test_what_a_gateway_says_is_counted_and_recorded_as_no_answer() -> None:
    rig = Rig(Oracle(1, refuses(11)))
    rig.done(rig.submit(READ))
    unit = rig.owner.journal.unit(1)
    assert (unit.timeouts, unit.refusals, unit.replies) == (1, 0, 1)
    first = rig.owner.journal.flight[0]
    assert (first.outcome, first.reply[:3]) == ("no reply", b"\x01\x83\x0b")


def test_a_device_that_a_gateway_gave_up_still_owes_an_answer() -> None:
    """Its late reply may be taken by the gateway for the answer to the next request."""
    rig = Rig(Oracle(1, refuses(11)), config=BusConfig(echo=False, retries=0))
    first = rig.submit(READ)
    rig.done(first)
    second = rig.submit(READ)
    rig.done(second)
    assert second.sent_at - first.ended_at >= 0.5


def test_a_gateway_that_speaks_for_a_dead_drive_feeds_no_watchdog() -> None:
    rig = Rig()
    (drive,) = drives(rig, 1)
    rig.owner.feeding.arm(watch := _watch(rig.now))
    rig.pair.devices[:] = [Oracle(1, *100 * [refuses(11)])]
    rig.run(0.5)
    assert watch.heard_at == 100.0
    rig.run(1.0)
    assert drive.interruptions


def _watch(now: float):  # type: ignore[no-untyped-def]
    from rs485bus.bus.watchdog.feeding import ArmedWatchdog

    return ArmedWatchdog(1, 1.0, 0.01, heard_at=now, armed_at=now)


# What is moved


@pytest.mark.parametrize("code", range(1, 13))
def test_after_any_exception_to_what_moves_an_axis_it_may_move_until_it_is_seen_to_stand(code: int) -> None:
    rig = Rig()
    (drive,) = drives(rig, 1)
    rig.pair.devices[:] = [Oracle(1, refuses(code))]
    job = drive.move(rig)
    rig.done(job)
    assert job.outcome in (Outcome.REFUSED, Outcome.UNKNOWN)
    assert drive.attached.motion.may_move


def test_a_tl_r_that_denies_has_done_nothing() -> None:
    unit = Oracle(1, refuses(4), does_and_says(5))
    rig = Rig(unit)
    rig.owner.units[1].attach(TlrDrive(1))
    denied, open_ = (rig.submit(WRITE, repeat=Repeat.NEVER) for _ in range(2))
    rig.done(denied, open_)
    assert (denied.outcome, open_.outcome) == (Outcome.REFUSED, Outcome.UNKNOWN)
    assert isinstance(failure(denied, (), "TL-R"), DeviceRefused)


def test_a_stop_that_was_accepted_only_is_said_again_until_the_motor_stands() -> None:
    rig = Rig()
    (drive,) = drives(rig, 1)
    rig.done(drive.move(rig))
    rig.run(0.2)
    real = drive.sim.receive
    said: list[bytes] = []

    def receive(frame: bytes, now: float) -> bytes | None:
        if frame[1] == 6 and not said:
            said.append(frame)
            return Oracle(1, Step(done=False, code=5)).receive(frame, now)
        return real(frame, now)

    drive.sim.receive = receive  # type: ignore[method-assign]
    drive.stop(rig)
    rig.run(2.0)
    assert drive.halted[0].standing
    assert drive.halted[0].stops >= 2


def test_a_burst_goes_on_behind_what_may_have_been_done() -> None:
    from rs485bus.bus.schedule.burst import Burst, BurstSlot

    rig = Rig(Oracle(1, does_and_says(5)), Oracle(2))
    burst = Burst(2)
    jobs = [
        rig.submit(write_single(at, 3, 7), repeat=Repeat.NEVER, moves=True, slot=BurstSlot(burst, at)) for at in (1, 2)
    ]
    rig.done(*jobs)
    assert [job.outcome for job in jobs] == [Outcome.UNKNOWN, Outcome.REPLY]
    assert jobs[0].urgency is Urgency.START
