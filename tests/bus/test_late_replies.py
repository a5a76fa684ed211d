"""A late reply is never taken for the answer to something else."""

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.units.asking import question_for
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.frames import read
from rs485bus.sim import SimMks, SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.sim.treatment import PLAIN, Treatment
from rs485bus.wire.frames import Request, crc, read_holding, read_input, registers, write_single
from rs485bus.wire.registers import Repeat
from tests.bus.support import BANK, Scripted, outcomes

ONCE = BusConfig(echo=False, retries=0, reply_timeout=0.03)


def test_an_equal_read_waits_until_the_late_reply_is_there() -> None:
    """The status polled before a move and answered late never ends the move: the next poll is another job."""
    unit = Scripted(1, 0.2)
    rig = Rig(unit, config=ONCE)
    before = rig.submit(read_holding(1, 0, 1))
    rig.done(before)
    unit.registers[0] = 1  # the move begins
    after = rig.submit(read_holding(1, 0, 1))
    rig.done(after)
    assert before.outcome is Outcome.NO_REPLY
    assert registers(after.reply) == [1]
    assert after.sent_at > 100.2
    assert rig.owner.journal.unit(1).late_replies == 1


def test_without_the_late_reply_it_waits_for_the_window() -> None:
    rig = Rig(Scripted(1, "lost"), config=ONCE)
    first = rig.submit(read_holding(1, 0, 1))
    rig.done(first)
    second = rig.submit(read_holding(1, 0, 1))
    rig.done(second)
    assert second.sent_at - first.ended_at >= ONCE.late_reply_window


def test_a_late_echo_never_confirms_a_later_write() -> None:
    unit = Scripted(1, 0.2, "deaf")
    rig = Rig(unit, config=ONCE)
    first = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(first)
    second = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(second)
    assert outcomes([first, second]) == [Outcome.UNKNOWN] * 2
    assert len(unit.writes) == 1


def test_an_exception_that_may_belong_to_an_older_request_decides_nothing() -> None:
    def refused(reply: bytes) -> bytes:
        body = bytes((1, 0x83, 2))
        return body + crc(body)

    def late_refusal(reply: bytes) -> bytes:
        unit.turnaround = 0.06
        return refused(reply)

    unit = Scripted(1, late_refusal, 0.04)
    rig = Rig(unit, config=BusConfig(echo=False, retries=0, reply_timeout=0.05))
    first = rig.submit(read_holding(1, 0, 3))
    rig.done(first)
    second = rig.submit(read_holding(1, 0, 2))
    rig.done(second)
    assert first.outcome is Outcome.NO_REPLY
    # The exception came while the second was waited for, and was the first one's.
    assert second.outcome is Outcome.REPLY
    assert registers(second.reply) == [100, 101]


def test_the_repetition_of_the_same_job_may_be_answered_by_either_reply_and_one_stays_owed() -> None:
    unit = Scripted(1, 0.05, 0.06)
    rig = Rig(unit, config=BusConfig(echo=False, retries=1, reply_timeout=0.03))
    job = rig.submit(read_holding(1, 0, 1))
    rig.done(job)
    assert (job.outcome, job.attempts) == (Outcome.REPLY, 2)
    assert job.answered_since < job.sent_at
    unit.registers[0] = 55
    fresh = rig.submit(read_holding(1, 0, 1))
    rig.done(fresh)
    assert registers(fresh.reply) == [55]
    assert fresh.sent_at > 100.09


def test_other_reads_and_other_units_do_not_wait() -> None:
    rig = Rig(Scripted(1, "lost"), SimUnit(2, BANK), config=ONCE)
    first = rig.submit(read_holding(1, 0, 1))
    rig.done(first)
    start = rig.now
    others = [rig.submit(read_holding(1, 0, 2)), rig.submit(read_input(1, 0, 1)), rig.submit(read_holding(2, 0, 1))]
    rig.done(*others)
    assert rig.now - start < 0.03
    assert outcomes(others) == [Outcome.REPLY] * 3


def test_an_unmistakable_answer_lets_the_equal_read_go_at_once() -> None:
    rig = Rig(Scripted(1, "lost"), config=ONCE)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    jobs = [rig.submit(read_holding(1, 0, 2)), rig.submit(read_holding(1, 0, 1))]
    start = rig.now
    rig.done(*jobs)
    assert rig.now - start < 0.03


def test_behind_a_gateway_it_does_not() -> None:
    rig = Rig(Scripted(1, "lost"), config=ONCE, gateway=True)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    jobs = [rig.submit(read_holding(1, 0, 2)), rig.submit(read_holding(1, 0, 1))]
    start = rig.now
    rig.done(*jobs)
    assert rig.now - start >= ONCE.late_reply_window


def test_a_cancelled_caller_changes_nothing_the_owner_still_listens() -> None:
    unit = Scripted(1, 0.2)
    rig = Rig(unit, config=ONCE)
    gone = rig.submit(read_holding(1, 0, 1))
    rig.run(0.001)
    rig.owner.cancel(gone, rig.now)
    rig.done(gone)
    unit.registers[0] = 1
    fresh = rig.submit(read_holding(1, 0, 1))
    rig.done(fresh)
    assert registers(fresh.reply) == [1]


def test_what_is_owed_survives_a_reopening() -> None:
    unit = Scripted(1, 0.3)
    rig = Rig(unit, config=ONCE)
    job = rig.submit(read_holding(1, 0, 1))
    rig.run(0.005)
    rig.owner.unplugged(rig.now)
    rig.owner.plugged(rig.now)
    assert job.outcome is Outcome.NO_REPLY
    unit.registers[0] = 1
    fresh = rig.submit(read_holding(1, 0, 1))
    rig.done(fresh)
    assert registers(fresh.reply) == [1]
    assert fresh.sent_at > 100.3


def test_a_stop_does_not_wait_for_what_is_owed() -> None:
    rig = Rig(Scripted(1, "lost"), config=ONCE)
    rig.done(rig.submit(write_single(1, 0, 0), repeat=Repeat.NEVER))
    start = rig.now
    stop = rig.submit(write_single(1, 0, 0), urgency=Urgency.STOP, ignores_late_replies=True)
    rig.done(stop)
    assert rig.now - start < 0.01


def test_a_doubled_reply_is_not_the_answer_to_the_next_request() -> None:
    unit = Scripted(1, lambda reply: reply + reply)
    rig = Rig(unit, config=ONCE)
    jobs = [rig.submit(read_holding(1, 0, 1)), rig.submit(read_holding(1, 5, 1))]
    rig.done(*jobs)
    assert [registers(job.reply) for job in jobs] == [[100], [105]]


def test_a_unit_whose_answers_all_look_alike_is_not_asked_for_ever_which_of_them_is_late() -> None:
    """0xF1 of a motor that stands, 0x3A of one that is enabled and 0x3B of one that is homed are all a 1."""
    rig = Rig(SimMks(1))
    rig.owner.units[1].attach(MksDrive(1))
    for _ in range(3):
        for what in (r.STATUS, r.POSITION, r.ENABLED, r.HOMED):
            rig.done(rig.submit(read(1, what)))
    late = [Treatment(delay=0.03)]
    rig.pair.script = lambda frame, now: late.pop() if late and frame[3] == r.ENABLED.address else PLAIN
    rig.submit(read(1, r.ENABLED))
    waits = rig.submit(read(1, r.HOMED))
    sent = len(rig.sent)
    rig.run(1.0, lambda: waits.outcome is not None)
    assert waits.outcome is Outcome.REPLY
    assert len(rig.sent) - sent < 20


@pytest.mark.parametrize("takes", [0.04, 0.05, 0.06])
def test_a_unit_that_is_always_late_keeps_nobody_waiting_by_what_it_is_asked_instead(takes: float) -> None:
    """What is asked instead of waiting looks like a short read, and is answered late as all is: again and again."""
    rig = Rig(Scripted(1, 0.0, *[takes] * 400), config=BusConfig(echo=False, retries=2, reply_timeout=0.03))
    rig.done(rig.submit(read_holding(1, 0, 2)))
    jobs = [rig.submit(read_holding(1, register, count)) for register, count in ((0, 2), (5, 2), (9, 1), (10, 1))]
    rig.done(*jobs, within=1.0)
    assert [registers(job.reply)[0] for job in jobs] == [100, 105, 109, 110]


def test_who_would_wait_without_end_for_late_replies_is_told_so() -> None:
    """Somebody goes on to ask what the unit does not answer, and waits for no late reply himself."""
    unit = Scripted(1, *["lost"] * 1000)
    rig = Rig(unit, config=ONCE)
    rig.done(rig.submit(read_holding(1, 0, 1)))

    def ask(_: object = None) -> None:
        rig.submit(read_holding(1, 0, 1), internal=True, ignores_late_replies=True, urgency=Urgency.CONFIRM, on_end=ask)

    ask()
    waiting = rig.submit(read_holding(1, 5, 1))
    rig.run(10)
    assert waiting.outcome is Outcome.NOT_SENT
    assert waiting.reason is Reason.OWED
    assert 5 <= waiting.ended_at - waiting.queued_at < 6


def test_a_unit_that_answers_near_the_end_of_its_window_is_given_a_longer_one(caplog: pytest.LogCaptureFixture) -> None:
    """The next reply comes later yet. It would be taken for the answer to what is asked then."""
    unit = Scripted(1, 0.5, 0.7)
    rig = Rig(unit, config=ONCE)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    rig.run(1.0)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    fresh = rig.submit(read_holding(1, 5, 1))
    rig.done(fresh)
    assert registers(fresh.reply) == [105]
    assert caplog.text.count("late_reply_window=") == 1


def test_a_window_grows_no_longer_than_five_seconds_and_not_for_a_reply_that_is_a_bit_late() -> None:
    rig = Rig(Scripted(1, 0.2), config=ONCE)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    rig.run(1.0)
    unit = rig.owner.units[1]
    assert unit.late_reply_window == ONCE.late_reply_window
    for _ in range(20):
        unit.answered_late(unit.late_reply_window + unit.reply_timeout)
    assert 3.9 < unit.late_reply_window <= 5.0


def test_where_all_that_may_be_asked_is_owed_what_was_asked_instead_is_asked_again() -> None:
    """Either of its answers will do. To wait for the end of a window would take most of a second."""
    unit = UnitState(1, True, 0.1, 0.7)
    unit.attach(MksDrive(1))
    status, position, pulses = MksDrive(1).reads()

    def missed(job: Job | None) -> Request | None:
        if job is None:
            return None
        unit.late.unanswered(job, 0.8)
        unit.is_questioned = False
        return job.request

    def asks(*somebody_waits_for: Request) -> Request | None:
        return missed(question_for(unit, 0.0, lambda read: read in somebody_waits_for))

    missed(Job(position))
    assert asks(status) == pulses
    assert asks() == status
    assert asks(status) == pulses


@pytest.mark.parametrize(("repeat", "attempts"), [(Repeat.SAFE, 3), (Repeat.NEVER, 1)])
def test_an_attempt_that_a_late_reply_may_have_hit_does_not_count(repeat: Repeat, attempts: int) -> None:
    unit = Scripted(1, 0.05, "deaf")
    rig = Rig(unit, config=BusConfig(echo=False, retries=1, reply_timeout=0.03))
    rig.submit(read_holding(1, 0, 20), retries=0)
    rig.run(0.0505)
    job = rig.submit(write_single(1, 3, 7), repeat=repeat)
    rig.done(job)
    assert rig.pair.collisions == 1
    assert (job.outcome, job.attempts) == (Outcome.REPLY if attempts > 1 else Outcome.UNKNOWN, attempts)


def test_attempts_that_are_hit_again_and_again_come_to_an_end() -> None:
    unit = Scripted(1, "lost")
    unit.script.extend([lambda reply: reply[:-1]] * 100)
    rig = Rig(unit, config=BusConfig(echo=False, retries=2, reply_timeout=0.03))
    job = rig.submit(write_single(1, 3, 7))
    rig.done(job)
    assert (job.outcome, job.attempts) == (Outcome.NO_REPLY, 5)
