"""One transaction at a time, and each job ends in exactly one outcome."""

from collections.abc import Callable

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.units.motion import Motion
from rs485bus.sim import SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import Request, crc, read_holding, registers, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from rs485bus.wire.timing import LineSettings
from tests.bus.support import BANK, Deaf, Scripted, outcomes

NO_ECHO = {"echo": False}


def gaps(rig: Rig) -> list[float]:
    """Seconds between the ends of frames sent and the starts of the next."""
    air = rig.pair.line.airtime
    return [later - (at + air(len(frame))) for (at, frame), (later, _) in zip(rig.sent, rig.sent[1:], strict=False)]


def test_a_read_ends_in_the_registers() -> None:
    rig = Rig(SimUnit(1, BANK))
    job = rig.submit(read_holding(1, 3, 2))
    rig.done(job)
    assert job.outcome is Outcome.REPLY
    assert registers(job.reply) == [103, 104]


def test_an_exception_ends_in_refused_and_is_not_repeated() -> None:
    rig = Rig(SimUnit(1, BANK))
    job = rig.submit(read_holding(1, 900, 2))
    rig.done(job)
    assert (job.outcome, job.code, len(rig.sent)) == (Outcome.REFUSED, 2, 1)


def test_a_refusal_inside_a_normal_reply_ends_in_refused() -> None:
    def refuse(reply: bytes) -> bytes:
        body = reply[:4] + b"\xff\xff"
        return body + crc(body)

    rig = Rig(Scripted(1, refuse))
    job = rig.submit(write_single(1, 3, 7, hidden_refusal=True))
    rig.done(job)
    assert (job.outcome, job.code) == (Outcome.REFUSED, None)


def test_a_safe_request_is_repeated_and_says_how_often() -> None:
    unit = Scripted(1, "lost", "deaf")
    rig = Rig(unit)
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.SAFE)
    rig.done(job)
    assert (job.outcome, job.attempts) == (Outcome.REPLY, 3)
    assert [record.attempt for record in rig.owner.journal.flight] == [1, 2, 3]
    assert len(unit.heard) == 2


def test_a_write_whose_reply_is_lost_is_executed_once() -> None:
    unit = Scripted(1, "lost")
    rig = Rig(unit)
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    rig.run(2.0)
    assert job.outcome is Outcome.UNKNOWN
    assert len(unit.writes) == 1


def test_silence_ends_in_no_reply_for_what_may_be_repeated_and_in_unknown_for_what_may_not() -> None:
    rig = Rig(Deaf(1))
    jobs = [
        rig.submit(read_holding(1, 0, 1), repeat=Repeat.NEVER),
        rig.submit(write_single(1, 0, 1), repeat=Repeat.SAFE),
        rig.submit(write_single(1, 1, 1), repeat=Repeat.VERIFY),
    ]
    rig.done(*jobs)
    assert outcomes(jobs) == [Outcome.NO_REPLY, Outcome.NO_REPLY, Outcome.UNKNOWN]


def test_a_refusal_after_an_unanswered_attempt_of_a_write_is_unknown() -> None:
    def refuse(reply: bytes) -> bytes:
        body = bytes((1, 0x86, 4))
        return body + crc(body)

    rig = Rig(Scripted(1, "lost", refuse))
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.SAFE)
    rig.done(job)
    assert job.outcome is Outcome.UNKNOWN


def test_a_write_that_is_dropped_after_an_unanswered_attempt_is_unknown() -> None:
    motion = Motion()
    rig = Rig(Deaf(1), SimUnit(2, BANK))
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.SAFE, motion=motion)
    rig.run(0.05)
    motion.stop()
    rig.done(job)
    assert (job.outcome, job.attempts, job.reason) == (Outcome.UNKNOWN, 1, Reason.STOPPED)


def test_between_two_attempts_the_others_have_their_turn() -> None:
    rig = Rig(Deaf(1), SimUnit(2, BANK))
    dead = rig.submit(read_holding(1, 0, 1))
    others = [rig.submit(read_holding(2, at, 1)) for at in range(4)]
    rig.done(dead, *others)
    assert [frame[0] for _, frame in rig.sent] == [1, 2, 1, 2, 1, 2, 2]


def test_the_lines_of_two_addresses_keep_their_order_through_repetitions() -> None:
    unit = Scripted(1, "deaf")
    rig = Rig(unit, SimUnit(2, BANK))
    jobs = [rig.submit(write_single(1, 3, value), repeat=Repeat.SAFE) for value in (1, 2, 3)]
    rig.done(*jobs)
    assert [values for _, _, values in unit.writes] == [(1,), (2,), (3,)]


@pytest.mark.parametrize("baudrate", [1200, 9600, 19200, 38400, 115200, 256000])
def test_t35_of_silence_stands_before_every_frame(baudrate: int) -> None:
    line = LineSettings(baudrate=baudrate)
    rig = Rig(SimUnit(1, BANK), Deaf(2), line=line, config=BusConfig(echo=False, turnaround=0.0))
    jobs = [rig.submit(read_holding(1, 0, 4)), rig.submit(write_single(0, 1, 1)), rig.submit(read_holding(2, 0, 1))]
    jobs += [rig.submit(read_holding(1, 0, 2)) for _ in range(5)]
    rig.done(*jobs)
    assert rig.pair.early_frames == 0
    assert min(gaps(rig)) >= line.t35 - 1e-9


def test_the_silence_counts_from_the_last_byte_received() -> None:
    stray = b"\x55" * 20
    rig = Rig(Scripted(1, lambda reply: reply + stray))
    jobs = [rig.submit(read_holding(1, 0, 1)), rig.submit(read_holding(1, 0, 2))]
    rig.done(*jobs)
    assert rig.pair.early_frames == 0
    assert outcomes(jobs) == [Outcome.REPLY] * 2


@pytest.mark.parametrize(("baudrate", "air"), [(9600, 13 * 10 / 9600), (115200, 13 * 10 / 115200)])
def test_a_reply_is_waited_for_as_long_as_its_bytes_take_besides(baudrate: int, air: float) -> None:
    rig = Rig(line=LineSettings(baudrate=baudrate), config=BusConfig(echo=False, retries=0, reply_timeout=0.05))
    job = rig.submit(read_holding(1, 0, 0 + 1))
    rig.done(job)
    sent = rig.sent[0][0]
    assert job.ended_at - sent == pytest.approx(air + 2 * 10 / baudrate + 0.05)


def test_a_more_urgent_job_goes_first_and_in_its_own_line() -> None:
    rig = Rig(SimUnit(1, BANK))
    first = rig.submit(read_holding(1, 0, 1))
    polls = [rig.submit(read_holding(1, 0, 1), urgency=Urgency.POLL) for _ in range(3)]
    command = rig.submit(read_holding(1, 0, 2))
    rig.done(first, command, *polls)
    assert rig.sent[1][1] == command.request.adu


def test_a_queued_job_whose_caller_is_cancelled_is_never_sent() -> None:
    rig = Rig(SimUnit(1, BANK))
    first, second = rig.submit(read_holding(1, 0, 1)), rig.submit(read_holding(1, 0, 2))
    rig.owner.cancel(second, rig.now)
    rig.done(first, second)
    assert (second.outcome, second.reason, len(rig.sent)) == (Outcome.NOT_SENT, Reason.CANCELLED, 1)


def test_a_job_on_the_wire_whose_caller_is_cancelled_is_finished_and_not_repeated() -> None:
    rig = Rig(Deaf(1), SimUnit(2, BANK))
    dead, other = rig.submit(read_holding(1, 0, 1)), rig.submit(read_holding(2, 0, 1))
    rig.run(0.001)
    rig.owner.cancel(dead, rig.now)
    rig.done(dead, other)
    assert dead.outcome is Outcome.NO_REPLY
    assert [frame[0] for _, frame in rig.sent] == [1, 2]
    assert rig.sent[1][0] - rig.sent[0][0] >= 0.1


def test_a_job_that_waits_too_long_expires_unsent() -> None:
    rig = Rig(Deaf(1), SimUnit(2, BANK))
    slow = rig.submit(read_holding(1, 0, 1))
    job = rig.submit(read_holding(2, 0, 1), expires_at=rig.now + 0.05)
    rig.done(slow, job)
    assert (job.outcome, job.reason) == (Outcome.NOT_SENT, Reason.EXPIRED)
    assert job.ended_at == pytest.approx(100.05)


def test_a_job_is_not_repeated_after_its_time() -> None:
    rig = Rig(Deaf(1))
    job = rig.submit(read_holding(1, 0, 1), expires_at=rig.now + 0.15)
    rig.done(job)
    assert (job.outcome, job.attempts) == (Outcome.NO_REPLY, 2)


def test_a_full_queue_refuses_more_but_never_a_stop() -> None:
    rig = Rig(SimUnit(1, BANK), config=BusConfig(echo=False, max_queued=2))
    kept = [rig.submit(read_holding(1, 0, 1)) for _ in range(2)]
    refused = rig.submit(read_holding(1, 0, 1))
    stop = rig.submit(write_single(1, 0, 0), urgency=Urgency.STOP)
    assert (refused.outcome, refused.reason) == (Outcome.NOT_SENT, Reason.QUEUE_FULL)
    rig.done(*kept, stop)
    assert outcomes([*kept, stop]) == [Outcome.REPLY] * 3


def test_closing_ends_everything() -> None:
    rig = Rig(SimUnit(1, BANK))
    jobs = [rig.submit(read_holding(1, 0, 1)), rig.submit(write_single(1, 0, 1), repeat=Repeat.NEVER)]
    rig.run(0.0001)
    rig.owner.close(rig.now)
    assert outcomes(jobs) == [Outcome.NO_REPLY, Outcome.NOT_SENT]
    late = rig.submit(read_holding(1, 0, 1))
    assert late.reason is Reason.CLOSED


def test_a_broadcast_is_followed_by_its_turnaround_even_if_its_caller_has_gone() -> None:
    rig = Rig(SimUnit(1, BANK), SimUnit(2, BANK))
    job, after = rig.submit(write_single(0, 3, 9)), rig.submit(read_holding(1, 3, 1))
    rig.run(0.0005)
    rig.owner.cancel(job, rig.now)
    rig.done(job, after)
    assert registers(after.reply) == [9]
    assert gaps(rig)[0] >= rig.owner.config.turnaround - 1e-9
    assert [unit.registers[3] for unit in rig.pair.devices if isinstance(unit, SimUnit)] == [9, 9]


def test_a_stop_does_not_wait_for_a_turnaround() -> None:
    rig = Rig(SimUnit(1, BANK))
    rig.submit(write_single(0, 3, 9))
    rig.run(0.001)
    stop = rig.submit(write_single(1, 3, 0), urgency=Urgency.STOP)
    rig.done(stop)
    assert gaps(rig)[0] < 0.01


def wrong_function(reply: bytes) -> bytes:
    body = bytes((reply[0], 4)) + reply[2:-2]
    return body + crc(body)


def wrong_length(reply: bytes) -> bytes:
    body = reply[:2] + bytes((reply[2] + 2,)) + reply[3:-2] + b"\0\0"
    return body + crc(body)


def wrong_unit(reply: bytes) -> bytes:
    body = bytes((9,)) + reply[1:-2]
    return body + crc(body)


@pytest.mark.parametrize("wrong", [wrong_function, wrong_length, wrong_unit])
def test_a_reply_that_does_not_fit_is_no_answer(wrong: Callable[[bytes], bytes]) -> None:
    rig = Rig(Scripted(1, wrong))
    job = rig.submit(read_holding(1, 3, 1))
    rig.done(job)
    assert (job.outcome, job.attempts) == (Outcome.REPLY, 2)


def test_an_echo_of_another_value_is_no_answer() -> None:
    def other_value(reply: bytes) -> bytes:
        body = reply[:4] + b"\0\x63"
        return body + crc(body)

    rig = Rig(Scripted(1, other_value))
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    assert job.outcome is Outcome.UNKNOWN


def test_the_good_reply_glued_behind_a_wrong_one_is_found() -> None:
    rig = Rig(Scripted(1, lambda reply: wrong_unit(reply) + reply))
    job = rig.submit(read_holding(1, 3, 1))
    rig.done(job)
    assert (job.outcome, job.attempts) == (Outcome.REPLY, 1)
    assert rig.owner.journal.unit(1).stray_bytes == 7


def write_of(count: int) -> Request:
    return write_multiple(1, 0, list(range(count)))


def test_records_tell_each_attempt_with_its_times_and_bytes() -> None:
    rig = Rig(Scripted(1, "deaf"))
    seen: list[object] = []
    unsubscribe = rig.owner.journal.subscribe(seen.append)
    job = rig.submit(write_of(3), repeat=Repeat.SAFE)
    rig.done(job)
    unsubscribe()
    rig.done(rig.submit(read_holding(1, 0, 1)))
    first, second, third = rig.owner.journal.flight
    assert seen == [first, second]
    assert (first.outcome, first.attempt, first.reply, first.first_byte_at) == ("no reply", 1, b"", None)
    assert (second.outcome, second.attempt, second.request, second.reply) == ("reply", 2, job.request.adu, job.reply)
    assert second.queued_at < second.sent_at < (second.first_byte_at or 0.0) <= second.ended_at
    unit = rig.owner.journal.unit(1)
    assert (unit.requests, unit.replies, unit.retries, unit.timeouts) == (2, 2, 1, 1)
    assert unit.latency(0) <= unit.latency(0.5) <= unit.latency(0.99) <= unit.latency(1)
    assert "no reply" in str(first)
    assert third.address == 1


def test_an_observer_that_fails_does_not_hurt_the_bus(caplog: pytest.LogCaptureFixture) -> None:
    def observer(record: object) -> None:
        raise RuntimeError("boom")

    rig = Rig(SimUnit(1, BANK))
    rig.owner.journal.subscribe(observer)
    job = rig.submit(read_holding(1, 0, 1))
    rig.done(job)
    assert job.outcome is Outcome.REPLY
    assert "an observer of the bus failed" in caplog.text


def test_a_job_may_be_submitted_again_once_it_has_ended() -> None:
    rig = Rig(Deaf(1), config=BusConfig(echo=False, retries=0))
    job: Job = rig.submit(read_holding(1, 0, 1))
    rig.done(job)
    rig.owner.submit(job, rig.now)
    rig.done(job)
    assert (job.outcome, job.attempts) == (Outcome.NO_REPLY, 2)


def test_a_request_goes_out_though_what_was_to_be_called_at_its_turn_fails(caplog: pytest.LogCaptureFixture) -> None:
    def fail() -> None:
        raise RuntimeError("boom")

    rig = Rig(SimUnit(1, BANK))
    job = rig.submit(read_holding(1, 3, 2), on_turn=fail)
    rig.done(job)
    assert job.outcome is Outcome.REPLY
    assert "when the turn of a request came" in caplog.text
