"""A request with a time limit ends within it, says what kept it, and leaves nothing behind once it is answered."""

import gc
import sys
import tracemalloc

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.failure import failure
from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.job import Job, Outcome, Reason
from rs485bus.bus.schedule.timers import Timers
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read
from rs485bus.sim import SimUnit
from rs485bus.sim.rig import FAST, NO_ECHO, Rig
from rs485bus.wire.frames import crc, read_holding, write_single
from rs485bus.wire.registers import Repeat
from tests.bus.support import BANK, Deaf, Scripted
from tests.bus.test_stops import running


def answered(owner: Owner, now: float, seconds: float) -> float:
    """One request with a time limit, answered; the time after it."""
    body = bytes((1, 3, 2, 0, 7))
    job = Job(read_holding(1, 0, 1), expires_at=now + seconds)
    owner.submit(job, now)
    assert owner.tick(now)
    owner.feed(body + crc(body), now + 0.003)
    owner.tick(now + 0.006)
    assert job.outcome is Outcome.REPLY
    return now + 0.006


def test_answered_requests_with_a_long_time_limit_leave_nothing_behind() -> None:
    tracemalloc.start()
    owner, now = Owner(FAST, NO_ECHO, 0.0), 1.0
    for _ in range(600):
        now = answered(owner, now, 3600.0)
    gc.collect()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(1500):
        now = answered(owner, now, 3600.0)
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 20_000
    assert owner.wake == float("inf")


def test_cancelled_timers_are_given_back_behind_one_that_comes_earlier_than_they() -> None:
    timers, called = Timers(), []
    timers.at(1.0, lambda: called.append(1.0))
    for _ in range(10_000):
        timers.cancel(timers.at(3600.0, lambda: called.append(3600.0)))
    assert len(timers) < 200
    kept = [timers.at(when, lambda when=when: called.append(when)) for when in (3.0, 2.0, 4.0)]  # type: ignore[misc]
    timers.cancel(kept[2])
    timers.cancel(kept[2])
    timers.run(3600.0)
    assert called == [1.0, 2.0, 3.0]
    assert timers.next_at == float("inf")


@pytest.mark.parametrize("seconds", [float(sys.maxsize), 1e308, float("inf")])
def test_a_time_limit_that_nobody_lives_to_see_is_none(seconds: float) -> None:
    rig = Rig(SimUnit(1, BANK))
    job = rig.submit(read_holding(1, 0, 1), expires_at=rig.now + seconds)
    assert rig.owner.wake <= rig.now
    rig.done(job)
    assert job.outcome is Outcome.REPLY


@pytest.mark.parametrize("seconds", [0.0, -1.0])
def test_a_time_that_is_over_already_sends_nothing(seconds: float) -> None:
    unit = Scripted(1)
    rig = Rig(unit)
    job = rig.submit(read_holding(1, 0, 1), expires_at=rig.now + seconds)
    assert (job.outcome, job.reason) == (Outcome.NOT_SENT, Reason.EXPIRED)
    rig.run(1.0)
    assert not unit.heard


@pytest.mark.parametrize(("write", "outcome"), [(False, Outcome.NO_REPLY), (True, Outcome.UNKNOWN)])
def test_a_request_on_the_wire_ends_when_its_time_is_over_and_its_late_answer_goes_to_nobody(
    write: bool, outcome: Outcome
) -> None:
    rig = Rig(Scripted(1, 0.05), SimUnit(2, BANK), config=BusConfig(echo=False, reply_timeout=0.1))
    ends: list[tuple[float, Outcome | None]] = []
    request = write_single(1, 5, 7) if write else read_holding(1, 0, 1)
    begun = rig.now
    job = rig.submit(
        request,
        repeat=Repeat.NEVER if write else Repeat.SAFE,
        expires_at=begun + 0.03,
        on_end=lambda job: ends.append((rig.now - begun, job.outcome)),
    )
    rig.run(0.01)
    other, following = rig.submit(read_holding(2, 0, 1)), rig.submit(read_holding(1, 9, 1))
    rig.done(other, following)
    assert ends == [(pytest.approx(0.03), outcome)]
    assert job.attempts == 1
    assert "Its time was over before the device had to answer" in str(failure(job, []))
    assert following.reply[3:5] == (109).to_bytes(2, "big")
    assert rig.pair.collisions == rig.pair.early_frames == 0
    assert other.sent_at - begun > 0.05  # the wire was not taken from the device that may still answer


def test_a_request_whose_time_is_over_while_the_port_is_away_says_that() -> None:
    rig = Rig(SimUnit(1, BANK))
    rig.owner.unplugged(rig.now)
    job = rig.submit(read_holding(1, 0, 1), expires_at=rig.now + 0.3)
    rig.run(0.31)
    assert (job.outcome, job.reason) == (Outcome.NOT_SENT, Reason.UNPLUGGED)
    assert "the port is gone" in str(failure(job, []))


def test_one_whose_time_is_over_while_a_late_reply_could_be_taken_for_its_answer_says_that() -> None:
    rig = Rig(Deaf(1), config=BusConfig(echo=False, reply_timeout=0.02, retries=0))
    rig.done(rig.submit(read_holding(1, 0, 1)))
    job = rig.submit(read_holding(1, 4, 1), expires_at=rig.now + 0.1)
    rig.done(job, within=0.11)
    assert (job.outcome, job.reason) == (Outcome.NOT_SENT, Reason.OWED)
    assert "a late reply could still arrive" in str(failure(job, []))


def test_one_whose_time_is_over_while_its_axis_is_being_stopped_says_that() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    drive.sim._commands[0xF7] = lambda value, now: None
    drive.stop(rig)
    job = rig.submit(drive.start(), moves=True, motion=drive.attached.motion, expires_at=rig.now + 0.1)
    rig.done(job, within=0.11)
    assert (job.outcome, job.reason) == (Outcome.NOT_SENT, Reason.STOPPING)
    assert "was being stopped" in str(failure(job, []))


def test_one_whose_time_is_over_behind_others_is_to_be_asked_less_often() -> None:
    rig = Rig(SimUnit(1, BANK))
    others = [rig.submit(read_holding(1, 0, 1)) for _ in range(50)]
    job = rig.submit(read_holding(1, 4, 1), expires_at=rig.now + 0.1)
    rig.done(job, within=0.11)
    assert (job.outcome, job.reason) == (Outcome.NOT_SENT, Reason.EXPIRED)
    assert "Ask less often" in str(failure(job, []))
    rig.done(*others)


def test_what_is_called_at_the_end_of_a_request_and_fails_keeps_nobody_else_waiting(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def boom(job: Job) -> None:
        raise RuntimeError("boom")

    rig = Rig(SimUnit(1, BANK))
    first, *others = [rig.submit(read(1, r.PULSES), on_end=boom) for _ in range(3)]
    rig.run(0.003)
    rig.owner.close(rig.now)
    assert first.outcome is Outcome.NO_REPLY
    assert [job.outcome for job in others] == [Outcome.NOT_SENT] * 2
    assert caplog.text.count("boom") >= 3
