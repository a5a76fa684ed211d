"""A lossy line at full speed, with no wrong answer: the figures of the design, in virtual time.

At 115200 baud, with 2 ms of turnaround and two registers a read, a transaction takes 5.22 ms at the limit of the wire.
"""

import random

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Outcome, Reason
from rs485bus.sim import Noise, SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.sim.treatment import PLAIN, Treatment
from rs485bus.wire.frames import read_holding, registers, write_single
from rs485bus.wire.registers import Repeat
from tests.bus.lossy import delivered
from tests.bus.support import Scripted
from tests.bus.test_offline import Switched

LIMIT = 5.22


@pytest.mark.parametrize(("lost", "most"), [(0.0, 5.25), (0.02, 5.8), (0.05, 6.5), (0.1, 8.0)])
@pytest.mark.parametrize("how", ["lost_reply", "lost_request"])
def test_a_lost_frame_costs_two_transactions_and_no_wrong_answer(how: str, lost: float, most: float) -> None:
    found = delivered(Noise(**{how: lost}))
    assert found.wrong == 0
    assert found.ms <= most


@pytest.mark.parametrize("lost", [0.01, 0.05, 0.1])
def test_one_unit_alone_reaches_four_fifths_of_an_ideal_repetition(lost: float) -> None:
    found = delivered(Noise(lost_reply=lost), units=1)
    assert found.wrong == 0
    assert LIMIT / (1 - lost) / found.ms >= 0.8


def test_eight_units_on_a_line_that_loses_a_third_are_never_offline() -> None:
    found = delivered(Noise(lost_reply=0.3), units=8, together=True, answers=6000)
    assert found.wrong == 0
    assert LIMIT / 0.7 / found.ms >= 0.65
    assert not any(unit.reach.offline for unit in found.rig.owner.units)
    assert found.failed < 0.06 * found.answers  # three losses in a row, and never refused for being offline


def varied(chance: random.Random) -> float:
    return 0.08 if chance.random() < 0.01 else chance.uniform(0.001, 0.004)


def test_turnarounds_that_vary_and_are_seldom_long_cost_little_more() -> None:
    clean = delivered(Noise(), turnarounds=varied)
    lossy = delivered(Noise(lost_reply=0.05), turnarounds=varied)
    assert clean.wrong == lossy.wrong == 0
    assert lossy.ms <= 1.35 * clean.ms


def test_late_replies_are_waited_out_by_asking() -> None:
    found = delivered(Noise(late=0.05, late_by=0.6))
    assert found.wrong == 0
    assert found.ms <= 32


def test_where_replies_may_overtake_each_other_nothing_is_asked_and_only_the_window_counts() -> None:
    config = BusConfig(echo=False, in_order=False)
    found = delivered(Noise(lost_reply=0.02), answers=300, config=config)
    assert found.wrong == 0
    assert found.ms > 10
    lengths = {record.request[5] for record in found.rig.owner.journal.flight}
    assert lengths == {2}


def taught(*script: object, **config: object) -> tuple[Rig, Scripted]:
    """A unit whose reply time is known, and then does as the script says."""
    unit = Scripted(1)
    rig = Rig(unit, config=BusConfig(echo=False, **config))  # type: ignore[arg-type]
    for _ in range(20):
        rig.done(rig.submit(read_holding(1, 0, 2)))
    unit.script.extend(script)  # type: ignore[arg-type]
    return rig, unit


def test_a_unit_that_is_seldom_slow_loses_nothing_but_repetitions() -> None:
    rig, _ = taught(0.08)
    job = rig.submit(read_holding(1, 0, 2))
    rig.done(job)
    assert job.outcome is Outcome.REPLY
    assert registers(job.reply) == [100, 101]
    assert rig.now < 100 + 20 * 0.0053 + 0.09


def test_the_reply_of_an_earlier_attempt_ends_a_read_that_waits_for_its_time_to_be_over() -> None:
    rig, _ = taught(0.06, "deaf", "deaf", "deaf", "deaf", "deaf", retries=0)
    begun = rig.now
    job = rig.submit(read_holding(1, 0, 2))
    rig.done(job)
    assert (job.outcome, job.attempts) == (Outcome.REPLY, 1)
    assert 0.06 < rig.now - begun < 0.07


def test_the_last_attempt_may_be_answered_for_as_long_as_the_unit_may_take() -> None:
    rig, _ = taught(*["deaf"] * 20)
    begun = rig.now
    job = rig.submit(read_holding(1, 0, 2))
    rig.done(job)
    assert job.outcome is Outcome.NO_REPLY
    assert rig.now - job.sent_at == pytest.approx(0.1015, abs=0.002)
    assert 0.25 < rig.now - begun < 0.32  # as long as three attempts may take, and no longer
    assert job.attempts <= 7


def read_while_busy(rig: Rig, unit: Scripted, seconds: float) -> tuple[Outcome | None, float]:
    """What a read is told, and after how long, of a unit that hears nothing for so long, and is read until it does."""
    begun = rig.now
    hears = unit.receive
    unit.receive = lambda frame, now: hears(frame, now) if now > begun + seconds else None  # type: ignore[method-assign]
    rig.done(first := rig.submit(read_holding(1, 0, 2)))
    job = first
    while job.outcome is not Outcome.REPLY:
        rig.run(0.03)
        rig.done(job := rig.submit(read_holding(1, 0, 2)))
    rig.run(0.6)  # nothing is owed any more
    return first.outcome, first.ended_at - begun


def test_a_unit_that_is_busy_for_as_long_as_its_attempts_may_take_is_asked_until_then() -> None:
    rig, unit = taught(retries=2)
    for seconds in (0.1, 0.18):
        outcome, _ = read_while_busy(rig, unit, seconds)
        assert outcome is Outcome.REPLY


def test_a_unit_whose_latest_silence_outlasted_all_attempts_is_waited_for_once() -> None:
    rig, unit = taught(retries=2)
    outcome, after = read_while_busy(rig, unit, 0.6)
    assert (outcome, after) == (Outcome.NO_REPLY, pytest.approx(0.3, abs=0.02))
    for busy in (0.6, 0.5, 0.18):
        outcome, after = read_while_busy(rig, unit, busy)
        assert (outcome, after) == (Outcome.NO_REPLY, pytest.approx(0.12, abs=0.02))
    outcome, _ = read_while_busy(rig, unit, 0.18)  # the latest one did not
    assert outcome is Outcome.REPLY


def test_others_are_asked_while_the_last_attempt_may_be_answered_still() -> None:
    rig, _ = taught(*["deaf"] * 20, retries=0)
    rig.pair.devices.append(Scripted(2))
    job = rig.submit(read_holding(1, 0, 2))
    rig.run(0.03)
    other = rig.submit(read_holding(2, 0, 2))
    rig.done(other)
    assert job.outcome is None
    assert other.outcome is Outcome.REPLY


def test_what_must_not_be_repeated_waits_until_no_late_reply_can_hit_it() -> None:
    rig, _ = taught(*["deaf"] * 20, retries=0)
    rig.pair.devices.append(Scripted(2))
    job = rig.submit(read_holding(1, 0, 2))
    rig.run(0.03)
    write = rig.submit(write_single(2, 3, 7), repeat=Repeat.NEVER)
    rig.done(write)
    assert write.outcome is Outcome.REPLY
    assert write.sent_at >= job.ended_at


def test_what_must_not_be_repeated_waits_the_full_time_for_its_own_reply() -> None:
    rig, unit = taught()
    for _ in range(20):
        rig.done(rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER))
    unit.script.extend([0.09])
    write = rig.submit(write_single(1, 3, 8), repeat=Repeat.NEVER)
    rig.done(write)
    assert write.outcome is Outcome.REPLY


def test_a_unit_that_is_read_one_register_at_a_time_is_asked_nothing_else() -> None:
    unit = Scripted(1)
    rig = Rig(unit, config=BusConfig(echo=False, retries=0))
    for _ in range(20):
        rig.done(rig.submit(read_holding(1, 0, 1)))
    unit.script.append("lost")
    rig.done(rig.submit(read_holding(1, 0, 1)))
    after = rig.submit(read_holding(1, 0, 1))
    rig.done(after)
    assert after.ended_at - rig.sent[-2][0] > 0.5
    rig.owner.units[1].probe = read_holding(1, 8, 4)
    unit.script.append("lost")
    rig.done(rig.submit(read_holding(1, 0, 1)))
    begun = rig.now
    rig.done(rig.submit(read_holding(1, 0, 1)))
    assert rig.now - begun < 0.02


def test_what_the_port_may_keep_back_is_not_taken_for_the_units_own_time() -> None:
    rig, _ = taught()
    quick = rig.owner.units[1].reply_times.waits()["read"]
    rig, _ = taught()
    rig.owner.pair.latency = 0.0015
    for _ in range(40):
        rig.done(rig.submit(read_holding(1, 0, 2)))
    assert rig.owner.units[1].reply_times.waits()["read"] < quick


class TakesRequestsForAnswers(SimUnit):
    """Built on libmodbus: after a request to a neighbour it takes the next frame on the pair for the answer to that."""

    waits_for_answer = False

    def heeds(self, frame: bytes) -> bool:
        return True

    def receive(self, frame: bytes, now: float) -> bytes | None:
        if frame[0] != self.address:
            self.waits_for_answer = True
            return None
        if self.waits_for_answer:
            self.waits_for_answer = False
            return None
        return super().receive(frame, now)


def test_a_neighbour_that_took_a_request_for_the_missing_answer_needs_one_repetition() -> None:
    silent, neighbour = Scripted(1), TakesRequestsForAnswers(2, {0: 7, 1: 8})
    hears = silent.receive

    def answers(frame: bytes, now: float) -> bytes | None:
        reply = hears(frame, now)
        neighbour.waits_for_answer = neighbour.waits_for_answer and reply is None
        return reply

    silent.receive = answers  # type: ignore[method-assign]
    rig = Rig(neighbour, silent)
    for _ in range(10):
        rig.done(rig.submit(read_holding(1, 0, 2)), rig.submit(read_holding(2, 0, 2)))
    silent.script.extend(["deaf"] * 3)
    first, second = rig.submit(read_holding(1, 0, 2)), rig.submit(read_holding(2, 0, 2))
    rig.done(second)
    assert registers(second.reply) == [7, 8]
    assert second.attempts == 2
    rig.done(first)
    assert first.outcome is Outcome.REPLY


def away(seconds: float) -> Rig:
    """A line on which unit 1 was silent for a whole request, and hears nothing for so many seconds from the begin."""
    unit = Switched(1)
    unit.registers = dict.fromkeys(range(64), 7)
    rig = Rig(unit, SimUnit(2, dict.fromkeys(range(64), 7)))
    rig.done(*(rig.submit(read_holding(1, 0, 2)) for _ in range(3)))
    unit.on = False
    rig.at(rig.now + seconds, lambda: setattr(unit, "on", True))
    rig.done(first := rig.submit(read_holding(1, 0, 2)))
    assert first.outcome is Outcome.NO_REPLY
    return rig


def test_a_read_of_a_unit_that_has_fallen_silent_ends_before_others_have_waited_for_it() -> None:
    rig = away(0.7)
    for _ in range(5):
        rig.done(job := rig.submit(read_holding(1, 0, 2)), rig.submit(read_holding(2, 0, 2)))
        assert (job.outcome, job.reason) == (Outcome.NOT_SENT, Reason.OWED)
        assert (
            0.002 < job.ended_at - job.queued_at < 0.03
        )  # at its own pace, so that a loop of a caller's does not spin
    asked = [frame for at, frame in rig.sent if frame == read_holding(1, 0, 1).adu]
    assert 1 <= len(asked) <= 3
    rig.run(0.5)
    rig.done(job := rig.submit(read_holding(1, 0, 2)))
    assert registers(job.reply) == [7, 7]


def test_who_says_how_long_he_waits_waits_so_long() -> None:
    rig = away(0.6)
    rig.done(job := rig.submit(read_holding(1, 0, 2), expires_at=rig.now + 1.0))
    assert registers(job.reply) == [7, 7]


def test_what_was_asked_instead_is_not_asked_again_once_it_was_answered() -> None:
    rig = Rig(SimUnit(1, dict.fromkeys(range(64), 7)), config=BusConfig(echo=False, retries=0))
    rig.done(*(rig.submit(read_holding(1, 0, 2)) for _ in range(3)))
    lost = [Treatment(answered=False)] * 2  # the read, and what is asked instead for the first time
    rig.pair.script = lambda frame, now: lost.pop() if lost else PLAIN
    jobs = [rig.submit(read_holding(1, 0, 2)) for _ in range(4)]
    rig.done(*jobs)
    assert [job.outcome for job in jobs] == [Outcome.NO_REPLY] + [Outcome.REPLY] * 3
    assert [frame[5] for at, frame in rig.sent] == [2, 2, 2, 2, 1, 1, 2, 2, 2]


class Counting(SimUnit):
    """A unit whose registers tell how often it was asked."""

    asked = 0

    def receive(self, frame: bytes, now: float) -> bytes | None:
        self.asked += 1
        self.registers[0] = self.asked
        return super().receive(frame, now)


@pytest.mark.parametrize("second", [2, 3, 4, 5, 6])
def test_a_unit_that_is_late_with_what_it_was_asked_while_it_was_late_answers_nothing_else_by_it(second: int) -> None:
    """It queues what it is asked: what it answers last comes twice as late as a reply comes else."""
    unit = Counting(1, dict.fromkeys(range(64), 0))
    rig = Rig(unit)
    rig.done(*(rig.submit(read_holding(1, 0, 2)) for _ in range(3)))
    heard = iter(range(1, 1000))

    def treat(frame: bytes, now: float) -> Treatment:
        number = next(heard)
        return Treatment(delay=0.55 if number == 1 else 1.1) if number in (1, second) else PLAIN

    rig.pair.script = treat
    for _ in range(200):
        asked = unit.asked
        rig.done(job := rig.submit(read_holding(1, 0, 2)))
        assert job.outcome is not Outcome.REPLY or registers(job.reply)[0] > asked
        rig.run(0.01)
    assert job.outcome is Outcome.REPLY
