"""A verified write is one job: write, read back, compare, repeat; under one epoch and one time."""

from collections.abc import Callable

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.failure import failure
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.schedule.verification import Verification, holds
from rs485bus.bus.units.motion import Motion
from rs485bus.errors import OutcomeUnknown
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import Request, read_holding, read_input, registers, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from tests.bus.oracle import DEAF, FINE, LOST, Oracle, Step, does_and_says, late, refuses
from tests.bus.support import Deaf, drives

WRITE = write_single(1, 3, 7)
HOLDS = holds(1, 3, [7])


def verified(rig: Rig, request: Request = WRITE, verify: Verification = HOLDS, **options: object) -> Job:
    return rig.submit(request, repeat=Repeat.VERIFY, verify=verify, **options)


def written(*script: Step, gateway: bool = False) -> tuple[Job, Oracle]:
    """A verified write to a unit that follows the script, and how it ended."""
    unit = Oracle(1, *script)
    rig = Rig(unit, gateway=gateway)
    job = verified(rig)
    rig.done(job)
    return job, unit


def functions(unit: Oracle) -> list[int]:
    return [frame[1] for frame in unit.frames]


def test_a_write_that_is_answered_is_not_read_back() -> None:
    job, unit = written()
    assert (job.outcome, functions(unit)) == (Outcome.REPLY, [6])


def test_a_write_whose_reply_was_lost_is_done_once_and_reported_done() -> None:
    job, unit = written(LOST)
    assert (job.outcome, job.attempts, functions(unit)) == (Outcome.REPLY, 1, [6, 3])
    assert unit.times_written(3, 7) == 1


def test_a_write_that_was_lost_is_repeated_once_it_is_seen_not_to_have_happened() -> None:
    job, unit = written(DEAF)
    assert (job.outcome, job.attempts, functions(unit)) == (Outcome.REPLY, 2, [6, 3, 6])
    assert unit.times_written(3, 7) == 1


def test_whatever_the_read_back_says_the_outcome_is_that_of_the_write() -> None:
    silent, _ = written(LOST, DEAF, DEAF, DEAF)
    refused, _ = written(LOST, refuses(2))
    gone, _ = written(LOST, *3 * [refuses(11)])
    other, unit = written(*6 * [DEAF, FINE])
    assert {job.outcome for job in (silent, refused, gone, other)} == {Outcome.UNKNOWN}
    assert functions(unit) == [6, 3, 6, 3, 6, 3]
    for job in (silent, refused, gone, other):
        error = failure(job, ())
        assert isinstance(error, OutcomeUnknown)
        assert error.request == WRITE.adu
        assert "did not show it" in str(error)


def test_a_verified_write_that_was_lost_once_and_refused_then_is_unknown() -> None:
    job, unit = written(LOST, Step(done=False, answered=False), DEAF, DEAF)
    assert (job.outcome, unit.times_written(3, 7)) == (Outcome.UNKNOWN, 1)
    job, _ = written(DEAF, FINE, refuses(3))
    assert job.outcome is Outcome.UNKNOWN


def test_a_write_that_a_gateway_gave_up_is_read_back_at_once_and_repeated() -> None:
    job, unit = written(Step(done=False, code=11), gateway=True)
    assert (job.outcome, functions(unit)) == (Outcome.REPLY, [6, 3, 6])
    assert job.sent_at - job.queued_at < 0.1
    job, unit = written(does_and_says(11), gateway=True)
    assert (job.outcome, unit.times_written(3, 7)) == (Outcome.REPLY, 1)


@pytest.mark.parametrize("code", [4, 5, 8, 12])
def test_a_write_that_was_begun_is_read_back_until_it_is_seen_and_never_repeated(code: int) -> None:
    unit = Oracle(1, Step(done=False, code=code))
    rig = Rig(unit)
    job = verified(rig)
    rig.at(rig.now + 0.25, lambda: unit.registers.update({3: 7}))  # it took its time
    rig.done(job)
    assert (job.outcome, job.attempts, set(functions(unit)[1:])) == (Outcome.REPLY, 1, {3})
    job, unit = written(Step(done=False, code=code))
    assert (job.outcome, functions(unit)) == (Outcome.UNKNOWN, [6, 3, 3, 3])


# One time


def test_its_time_covers_everything_from_the_call_to_the_last_repetition() -> None:
    unit = Oracle(1, *100 * [DEAF])
    rig = Rig(unit)
    job = verified(rig, expires_at=rig.now + 0.3)
    rig.run(60.0)
    assert job.outcome is Outcome.UNKNOWN
    assert job.ended_at <= 100.0 + 0.3 + 0.11
    assert max(at for at, _ in rig.sent) < 100.3


@pytest.mark.parametrize("waits_for", ["the write", "the read-back", "a late reply", "a repetition"])
def test_what_waits_when_its_time_is_over_ends_then(waits_for: str) -> None:
    unit = Oracle(1, *{"the read-back": [LOST], "a repetition": [DEAF]}.get(waits_for, []))
    rig = Rig(unit, Deaf(2), config=BusConfig(echo=False, retries=0 if waits_for == "a late reply" else 2))
    if waits_for == "a late reply":
        unit.script.extend((LOST, LOST))
        rig.done(rig.submit(read_holding(1, 9, 1)))  # the read-back could be answered by this one's reply
    if waits_for == "the write":
        rig.submit(read_holding(2, 0, 1))
    begun = rig.now
    job = verified(rig, expires_at=begun + (0.05 if waits_for == "the write" else 0.2))
    if waits_for in ("the read-back", "a repetition"):
        taken = [rig.submit(read_holding(2, at, 1)) for at in range(3)]
        assert taken
    rig.run(5.0)
    assert job.outcome is (Outcome.NOT_SENT if waits_for == "the write" else Outcome.UNKNOWN)
    assert job.reason in (Reason.EXPIRED, Reason.OWED, Reason.UNAWAITED, Reason.NONE)
    assert job.ended_at - begun <= 0.31


def test_a_read_back_is_not_answered_by_the_late_reply_to_an_older_read() -> None:
    """The older read found what was written before; the write that follows was lost."""
    unit = Oracle(1, late(0.35), DEAF)
    unit.registers[3] = 7
    rig = Rig(unit, config=BusConfig(echo=False, retries=0, reply_timeout=0.1))
    rig.done(rig.submit(read_holding(1, 3, 1)))
    unit.registers[3] = 9
    job = rig.submit(WRITE, repeat=Repeat.VERIFY, verify=HOLDS, retries=2)
    rig.done(job)
    assert (job.outcome, unit.times_written(3, 7)) == (Outcome.REPLY, 1)


def test_a_read_back_of_an_earlier_round_does_not_answer_for_a_later_one() -> None:
    # The first read-back is answered late: it tells of the time before the second attempt, which was done.
    unit = Oracle(1, DEAF, late(0.25), FINE, LOST)
    rig = Rig(unit)
    job = verified(rig, retries=5)
    rig.done(job)
    assert (job.outcome, unit.times_written(3, 7)) == (Outcome.REPLY, 1)


# One epoch


def stops(rig: Rig, motion: Motion) -> None:
    motion.stop()


def latches(rig: Rig, motion: Motion) -> None:
    rig.owner.gate.latched = True


def unplugs(rig: Rig, motion: Motion) -> None:
    rig.owner.unplugged(rig.now)
    rig.at(rig.now + 0.05, lambda: rig.owner.plugged(rig.now))


def closes(rig: Rig, motion: Motion) -> None:
    rig.owner.close(rig.now)


def locks(rig: Rig, motion: Motion) -> None:
    rig.owner.units[1].locked = "it is"


@pytest.mark.parametrize("what", [stops, latches, unplugs, closes, locks])
@pytest.mark.parametrize("after", [0.05, 0.103, 0.15, 0.205])
def test_nothing_of_it_is_sent_after(what: Callable[[Rig, Motion], None], after: float) -> None:
    """At any moment of it: its first attempt on the wire, its read-back waiting or on the wire, before its repetition.

    A read-back that is answered at last would tell that it must be repeated.
    """
    motion = Motion()
    unit = Oracle(1, DEAF, DEAF, FINE)
    rig = Rig(unit)
    job = verified(rig, moves=True, motion=motion)
    rig.run(after)
    sent = len(rig.sent)
    what(rig, motion)
    rig.run(60.0)
    assert (job.outcome, job.attempts, unit.writes) == (Outcome.UNKNOWN, 1, [])
    assert len(rig.sent) == sent


def test_a_write_to_a_device_without_a_facade_is_not_repeated_after_an_unplugging_either() -> None:
    unit = Oracle(1, DEAF)
    rig = Rig(unit, Deaf(2))
    job = verified(rig, moves=True)
    rig.run(0.01)
    rig.submit(read_holding(2, 0, 1), urgency=Urgency.CONFIRM)
    rig.run(0.15)
    assert len(unit.frames) == 1  # its read-back waits for the other one
    unplugs(rig, Motion())
    rig.run(60.0)
    assert (job.outcome, job.reason, unit.writes) == (Outcome.UNKNOWN, Reason.UNPLUGGED, [])


def test_a_wheel_whose_lost_target_was_verified_stays_where_a_stop_put_it() -> None:
    rig = Rig()
    (drive,) = drives(rig, 1)
    rig.done(drive.move(rig))
    rig.run(0.2)
    heard: list[bytes] = []
    real = drive.sim.receive

    def receive(frame: bytes, now: float) -> bytes | None:
        heard.append(frame)
        return None if len(heard) in (1, 2) else real(frame, now)

    drive.sim.receive = receive  # type: ignore[method-assign]
    again = drive.start(target=5_000_000)
    check = Verification(read_input(1, 0x31, 3), lambda reply: False)
    job = rig.submit(again, repeat=Repeat.VERIFY, verify=check, moves=True, motion=drive.attached.motion)
    rig.run(0.15)
    drive.stop(rig)
    rig.run(10.0)
    assert drive.halted[0].standing
    assert heard.count(again.adu) == 1
    assert job.outcome is Outcome.UNKNOWN
    assert not drive.sim.moving(rig.now)


def test_the_read_back_sets_nothing_in_motion() -> None:
    motion = Motion()
    unit = Oracle(1, LOST)
    rig = Rig(unit)
    job = verified(rig, moves=True, motion=motion)
    rig.run(0.05)
    at = motion.commanded_at
    rig.done(job)
    assert (job.outcome, motion.commanded_at, at) == (Outcome.REPLY, at, 100.0)


def test_of_two_verified_writes_to_a_unit_the_second_waits_for_the_first() -> None:
    unit = Oracle(1, DEAF)
    rig = Rig(unit)
    first = verified(rig)
    second = verified(rig, write_single(1, 3, 8), holds(1, 3, [8]))
    rig.done(first, second)
    assert [values for _, _, values in unit.writes] == [(7,), (8,)]


def test_a_caller_that_is_cancelled_ends_it_and_nothing_is_repeated() -> None:
    unit = Oracle(1, DEAF, DEAF, FINE)
    rig = Rig(unit)
    job = verified(rig)
    rig.run(0.15)
    rig.owner.cancel(job, rig.now)
    rig.run(5.0)
    assert (job.outcome, unit.writes) == (Outcome.UNKNOWN, [])
    assert len(unit.frames) == 2


def test_a_block_is_verified_as_a_whole() -> None:
    unit = Oracle(1, LOST)
    rig = Rig(unit)
    job = verified(rig, write_multiple(1, 3, [7, 8]), holds(1, 3, [7, 8]))
    rig.done(job)
    assert job.outcome is Outcome.REPLY
    unit.script.extend((LOST, FINE))
    unit.write = lambda register, values, now: None  # type: ignore[method-assign] # it takes nothing
    job = verified(rig, write_multiple(1, 3, [9, 8]), holds(1, 3, [9, 8]))
    rig.done(job)
    assert job.outcome is Outcome.REPLY  # its repetition was acknowledged
    assert job.attempts == 2


def test_anything_can_be_verified_that_can_be_read() -> None:
    """Coils, say, or a status that shows what a command did."""
    unit = Oracle(1, LOST)
    rig = Rig(unit)
    job = verified(rig, verify=Verification(read_input(1, 0, 4), lambda reply: registers(reply)[3] == 7))
    rig.done(job)
    assert (job.outcome, functions(unit)) == (Outcome.REPLY, [6, 4])


def test_a_comparison_that_fails_ends_the_write_as_unknown(caplog: pytest.LogCaptureFixture) -> None:
    def fails(reply: bytes) -> bool:
        raise RuntimeError("boom")

    unit = Oracle(1, *3 * [LOST, FINE])
    rig = Rig(unit)
    job = verified(rig, verify=Verification(read_holding(1, 3, 1), fails))
    rig.done(job)
    assert job.outcome is Outcome.UNKNOWN
    assert "the comparison of a read-back failed" in caplog.text
