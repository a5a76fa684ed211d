"""How long a unit takes is learned from unmistakable answers; what is missed waits longer."""

import random

from hypothesis import given
from hypothesis import strategies as st

from rs485bus.bus.schedule.job import Job, Urgency
from rs485bus.bus.units.reply_times import MARGIN, ReplyTimes, RequestKind
from rs485bus.wire.frames import read_holding, write_single

CEILING = 0.1
FAST, SLOW = read_holding(1, 0, 2), read_holding(1, 100, 2)


def taught(took: float, answers: int = 50) -> ReplyTimes:
    times = ReplyTimes()
    for _ in range(answers):
        times.answered(Job(FAST), took)
    return times


def wait(times: ReplyTimes, request: object = FAST) -> float:
    return times.wait(Job(request), CEILING)  # type: ignore[arg-type]


def test_what_is_not_known_waits_the_full_time() -> None:
    assert wait(ReplyTimes()) == CEILING
    assert wait(taught(0.002), write_single(1, 0, 1)) == CEILING
    assert taught(0.002).wait(Job(FAST, urgency=Urgency.FEED), CEILING) == CEILING
    assert taught(0.002).learned(RequestKind.WRITE) is None


def test_a_constant_reply_time_is_waited_for_and_little_more() -> None:
    assert 0.002 < wait(taught(0.002)) < 0.002 + MARGIN + 0.001
    assert taught(0.002).learned(RequestKind.READ) == wait(taught(0.002))


def test_a_varying_reply_time_is_hardly_ever_missed() -> None:
    chance, times, missed = random.Random(1), ReplyTimes(), 0
    for number in range(5000):
        took = chance.uniform(0.001, 0.004)
        missed += number > 50 and took > wait(times)
        times.answered(Job(FAST), took)
    assert missed == 0


def test_a_missed_request_waits_longer_until_it_is_answered_and_others_do_not() -> None:
    times = taught(0.002)
    before = wait(times)
    times.missed(Job(SLOW))
    once = wait(times, SLOW)
    times.missed(Job(SLOW))
    assert before < once < wait(times, SLOW)
    assert wait(times) == before
    times.answered(Job(SLOW), 0.002)
    assert wait(times, SLOW) < before + 0.0001


def test_a_line_that_loses_much_is_no_sign_of_a_slow_unit_until_it_would_lose_as_many_in_a_row_seldom() -> None:
    times, job = taught(0.002), Job(SLOW)
    before = wait(times)
    job.unanswered = 1
    times.missed(job, 0.3)
    assert wait(times, SLOW) == before
    job.unanswered = 2
    times.missed(job, 0.3)
    assert wait(times, SLOW) > before


def test_one_answer_teaches_how_long_reads_take_and_three_how_long_writes_do() -> None:
    times, write = taught(0.002, 1), write_single(1, 0, 1)
    assert wait(times) < 3 * 0.002
    for answers in range(3):
        assert wait(times, write) == CEILING, answers
        times.answered(Job(write), 0.002)
    assert wait(times, write) < CEILING


def test_what_is_missed_again_and_again_waits_the_longest_time_the_unit_may_take() -> None:
    times = taught(0.002)
    for _ in range(30):
        times.missed(Job(SLOW))
    assert wait(times, SLOW) == CEILING


def test_a_register_that_always_takes_long_is_learned_and_slows_no_other_down() -> None:
    times, misses = taught(0.002), 0
    before = wait(times)
    for _ in range(60):
        if wait(times, SLOW) < 0.08:
            misses += 1
            times.missed(Job(SLOW))
        else:
            times.answered(Job(SLOW), 0.08)
    assert misses < 20
    assert wait(times, SLOW) > 0.08
    assert wait(times) == before


@given(st.lists(st.tuples(st.sampled_from((FAST, SLOW)), st.floats(0, 0.2), st.booleans()), max_size=200))
def test_a_wait_is_never_below_the_margin_nor_above_the_ceiling(history: list[tuple[object, float, bool]]) -> None:
    times = ReplyTimes()
    for request, seconds, answered in history:
        if answered:
            times.answered(Job(request), seconds)  # type: ignore[arg-type]
        else:
            times.missed(Job(request))  # type: ignore[arg-type]
        assert MARGIN <= wait(times, request) <= CEILING


def test_requests_that_are_missed_once_each_are_not_remembered_for_ever() -> None:
    times = taught(0.002)
    for register in range(10_000):
        times.missed(Job(read_holding(1, register, 1)))
    assert wait(times, read_holding(1, 0, 1)) == wait(times)
