"""Which late replies may still arrive, and what must wait for them."""

from hypothesis import given
from hypothesis import strategies as st

from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.schedule.job import Job
from rs485bus.wire.frames import Request, read_holding, read_input, write_multiple, write_single

UNTIL = 10.0


def sent(request: Request, at: float) -> Job:
    job = Job(request)
    job.sent_at = at
    return job


def owing(*requests: Request, in_order: bool = True) -> PendingReplies:
    late = PendingReplies(in_order)
    for at, request in enumerate(requests):
        late.unanswered(sent(request, float(at)), UNTIL + at)
    return late


def test_a_read_of_the_same_length_waits_and_others_do_not() -> None:
    late = owing(read_holding(1, 0, 3))
    assert late.must_wait(read_holding(1, 40, 3)) == UNTIL
    assert late.must_wait(read_holding(1, 0, 2)) == 0
    assert late.must_wait(read_input(1, 0, 3)) == 0


def test_a_write_with_the_same_echo_waits_and_others_do_not() -> None:
    late = owing(write_single(1, 5, 7), write_multiple(1, 9, [1, 2]))
    assert late.must_wait(write_single(1, 5, 7)) == UNTIL
    assert late.must_wait(write_single(1, 5, 8)) == 0
    assert late.must_wait(write_multiple(1, 9, [3, 4])) == UNTIL + 1
    assert late.must_wait(write_multiple(1, 9, [3])) == 0


def test_a_write_of_what_a_hidden_refusal_looks_like_waits() -> None:
    late = owing(write_single(1, 5, 7, hidden_refusal=True))
    assert late.must_wait(write_single(1, 5, 0xFFFF)) == UNTIL


def test_a_further_attempt_of_the_same_job_need_not_wait() -> None:
    late = PendingReplies()
    job = sent(read_holding(1, 0, 3), 0.0)
    late.unanswered(job, UNTIL)
    assert late.must_wait(job.request, job) == 0
    assert late.must_wait(job.request, sent(job.request, 1.0)) == UNTIL


def test_an_unmistakable_answer_to_something_later_ends_the_waiting() -> None:
    late = owing(read_holding(1, 0, 3))
    assert late.answered(sent(read_holding(1, 0, 2), 5.0), 20.0) == 5.0
    assert not late


def test_behind_a_gateway_it_does_not() -> None:
    late = owing(read_holding(1, 0, 3), in_order=False)
    late.answered(sent(read_holding(1, 0, 2), 5.0), 20.0)
    assert late.must_wait(read_holding(1, 0, 3)) == UNTIL


def test_an_answer_to_a_repetition_proves_only_the_oldest_attempt_and_leaves_one_owed() -> None:
    late = PendingReplies()
    job = sent(read_holding(1, 0, 3), 0.0)
    late.unanswered(job, UNTIL)
    job.sent_at = 1.0
    assert late.answered(job, 12.0) == 0.0
    assert late.must_wait(read_holding(1, 0, 3)) == 12.0


def test_a_late_reply_that_arrives_ends_the_waiting() -> None:
    late = owing(read_holding(1, 0, 3))
    assert late.arrived(read_holding(1, 0, 3)) == 0.0
    assert not late


def test_a_late_exception_ends_the_waiting_of_the_oldest_request_of_its_function() -> None:
    late = owing(read_input(1, 0, 1), read_holding(1, 0, 3), read_holding(1, 0, 2))
    late.excepted(3)
    assert late.must_wait(read_input(1, 0, 1)) == 0  # older than what was answered
    assert late.must_wait(read_holding(1, 0, 3)) == 0
    assert late.must_wait(read_holding(1, 0, 2)) == UNTIL + 2


def test_while_a_function_is_owed_an_exception_decides_nothing() -> None:
    late = owing(read_holding(1, 0, 3))
    assert late.hides_exception(sent(read_holding(1, 0, 2), 1.0))
    assert not late.hides_exception(sent(read_input(1, 0, 2), 1.0))


def test_while_a_refusal_may_be_an_older_ones_it_decides_nothing() -> None:
    late = owing(write_single(1, 5, 7, hidden_refusal=True))
    assert late.hides_refusal(sent(write_single(1, 5, 8, hidden_refusal=True), 1.0))
    assert not late.hides_refusal(sent(write_single(1, 6, 8, hidden_refusal=True), 1.0))


def test_time_ends_the_waiting() -> None:
    late = owing(read_holding(1, 0, 3))
    late.expire(UNTIL)
    assert not late


requests = st.sampled_from(
    [read_holding(1, 0, 2), read_holding(1, 8, 2), read_holding(1, 0, 3), read_input(1, 0, 2), write_single(1, 5, 7)]
)


@given(st.lists(st.tuples(requests, st.booleans()), max_size=12), requests)
def test_whatever_happened_a_reply_that_may_still_come_is_never_taken_for_another(
    history: list[tuple[Request, bool]], asked: Request
) -> None:
    """A device that answers in order, sometimes late: what it still owes is never the answer that `asked` would get."""
    late, owed = PendingReplies(), []
    for at, (request, comes) in enumerate(history):
        if late.must_wait(request):
            continue
        job = sent(request, float(at))
        if comes:
            # It answers in order, so all that it owed before this is out by now or never comes.
            late.answered(job, UNTIL)
            owed.clear()
        else:
            late.unanswered(job, UNTIL + at)
            owed.append(request)
    if not late.must_wait(asked):
        assert not any(request.may_answer(asked) for request in owed)
