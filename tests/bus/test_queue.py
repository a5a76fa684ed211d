"""Urgency first; first in, first out for each address; the addresses take turns."""

from collections import defaultdict

from hypothesis import given
from hypothesis import strategies as st

from rs485bus.bus.schedule.job import Job, Urgency
from rs485bus.bus.schedule.queue import GONE, READY, Queue
from rs485bus.wire.frames import read_holding, write_single

urgencies = st.sampled_from(list(Urgency))


def job(address: int, urgency: Urgency = Urgency.COMMAND) -> Job:
    return Job(read_holding(address, 0, 1), urgency=urgency)


def order(queue: Queue) -> list[Job]:
    taken = []
    while (next_job := queue.take(lambda _: READY)[0]) is not None:
        taken.append(next_job)
    return taken


def test_a_more_urgent_job_goes_before_all_that_wait_longer() -> None:
    queue = Queue()
    jobs = [job(1, urgency) for urgency in (Urgency.POLL, Urgency.COMMAND, Urgency.FEED, Urgency.STOP)]
    for waiting in jobs:
        queue.put(waiting)
    assert order(queue) == jobs[::-1]


def test_the_addresses_take_turns() -> None:
    queue = Queue()
    jobs = [job(address) for address in (1, 1, 1, 2, 2, 3)]
    for waiting in jobs:
        queue.put(waiting)
    assert [taken.address for taken in order(queue)] == [1, 2, 3, 1, 2, 1]


def test_a_repetition_goes_to_the_head_of_its_own_line_only() -> None:
    queue = Queue()
    first, second, other = job(1), job(1), job(2)
    for waiting in (second, other):
        queue.put(waiting)
    assert queue.take(lambda _: READY)[0] is second
    queue.put(second)
    queue.put(first, first=True)
    assert [taken.address for taken in order(queue)] == [2, 1, 1]


def test_a_question_of_the_bus_own_holds_nobody_back_behind_it() -> None:
    """It asks less and less often, on behalf of those who wait: they go as soon as they may, it before those only that
    must wait."""
    queue = Queue()
    question, behind = Job(read_holding(1, 0, 1), urgency=Urgency.POLL, backs_off=True), job(1, Urgency.POLL)
    for waiting in (question, behind):
        queue.put(waiting)
    assert queue.take(lambda asked: 7.0) == (None, 7.0)
    assert queue.take(lambda asked: 7.0 if asked is behind else READY)[0] is question
    queue.put(question, first=True)
    assert queue.take(lambda asked: 7.0 if asked is question else READY)[0] is behind
    queue.put(behind)
    assert order(queue) == [behind, question]


def test_a_job_that_must_wait_holds_back_its_own_address_only() -> None:
    queue = Queue()
    blocked, behind, other = job(1), job(1), job(2)
    for waiting in (blocked, behind, other):
        queue.put(waiting)
    taken, again = queue.take(lambda asked: 7.0 if asked is blocked else READY)
    assert taken is other
    taken, again = queue.take(lambda asked: 7.0 if asked is blocked else READY)
    assert (taken, again) == (None, 7.0)


def test_what_is_not_worth_sending_leaves_the_queue() -> None:
    queue = Queue()
    stale, good = job(1), job(1)
    queue.put(stale)
    queue.put(good)
    assert queue.take(lambda asked: GONE if asked is stale else READY)[0] is good
    assert queue.size == 0


@given(st.lists(st.tuples(st.integers(1, 5), urgencies, st.booleans()), max_size=60))
def test_nothing_is_lost_and_every_rule_of_order_holds(plan: list[tuple[int, Urgency, bool]]) -> None:
    queue = Queue()
    jobs = [(job(address, urgency), leaves) for address, urgency, leaves in plan]
    for waiting, _ in jobs:
        queue.put(waiting)
    for waiting, leaves in jobs:
        assert not leaves or queue.remove(waiting)
        assert not leaves or not queue.remove(waiting)
    left = [waiting for waiting, leaves in jobs if not leaves]
    assert queue.size == len(left)
    assert set(queue) == set(left)
    taken = order(queue)
    assert sorted(map(id, taken)) == sorted(map(id, left))
    assert [one.urgency for one in taken] == sorted(one.urgency for one in taken)
    lines: dict[tuple[int, Urgency], list[Job]] = defaultdict(list)
    for one in left:
        lines[one.address, one.urgency].append(one)
    for one in taken:
        assert lines[one.address, one.urgency].pop(0) is one
    # Between two turns of one address, every other that waited had its turn.
    for urgency in Urgency:
        turns = [one.address for one in taken if one.urgency is urgency]
        for at, address in enumerate(turns):
            later = turns[at + 1 :]
            if address in later:
                between = set(later[: later.index(address)])
                assert set(later) - {address} <= between | {address}


def test_commands_that_never_end_leave_a_poll_every_fourth_turn() -> None:
    queue = Queue()
    for address in range(1, 5):
        queue.put(job(address))
        queue.put(job(address, Urgency.POLL))
    polled = []
    for _ in range(16):
        taken, _ = queue.take_rest(lambda _: READY)
        assert taken is not None
        queue.put(job(taken.address, taken.urgency))
        polled.append(taken.address if taken.urgency is Urgency.POLL else 0)
    assert polled == [0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 4]


def test_commands_owe_nothing_to_polls_that_came_later() -> None:
    queue = Queue()
    for _ in range(10):
        queue.put(job(1))
        queue.take_rest(lambda _: READY)
    queue.put(job(1, Urgency.POLL))
    queue.put(job(1))
    taken, _ = queue.take_rest(lambda _: READY)
    assert taken is not None
    assert taken.urgency is Urgency.COMMAND


def test_what_waits_for_one_address_is_found_the_most_urgent_first() -> None:
    queue = Queue()
    other, poll, dead, command = job(2), job(1, Urgency.POLL), job(1), job(1)
    stop, feed = job(1, Urgency.STOP), job(1, Urgency.FEED)
    for waiting in (other, poll, dead, command, stop, feed):
        queue.put(waiting)

    def admit(asked: Job) -> float:
        return GONE if asked is dead else READY

    assert queue.take_of(1, admit) is command
    assert queue.take_of(1, lambda _: 7.0) is None
    assert queue.take_of(1, admit) is poll
    assert queue.take_of(1, admit) is None
    assert queue.size == 3


def set_point(address: int = 1, yields_until: float = float("inf"), *, goes_on: bool = False) -> Job:
    return Job(write_single(address, 0, 1), urgency=Urgency.CONFIRM, yields_until=yields_until, goes_on=goes_on)


def test_a_question_has_its_turn_after_three_set_points_unless_the_next_one_has_waited_for_too_long() -> None:
    for yields_until, goes_first in ((6.0, False), (4.0, True)):
        queue = Queue()
        question, newest = job(2), set_point(yields_until=yields_until)
        queue.put(question)
        for _ in range(3):
            queue.put(set_point())
            queue.take_soon(lambda _: READY, 5.0)
        queue.put(newest)
        assert (queue.take_soon(lambda _: READY, 5.0)[0] is newest) is goes_first
        queue.put(set_point(yields_until=6.0))
        second = queue.take_soon(lambda _: READY, 5.0)[0]
        assert not goes_first or second is question  # put off, not dropped


def test_the_last_frame_of_a_set_point_puts_off_a_question_only_until_five_have_gone() -> None:
    queue = Queue()
    question = job(2)
    queue.put(question)
    taken = []
    for _ in range(8):
        queue.put(set_point(goes_on=True))
        taken.append(queue.take_soon(lambda _: READY, 5.0)[0])
    assert taken.index(question) == 5


def test_a_look_has_its_turn_though_set_points_to_its_drive_always_go_first() -> None:
    queue = Queue()
    look = Job(read_holding(1, 0, 1), urgency=Urgency.CONFIRM)
    queue.put(look)
    taken = []
    for _ in range(4):
        queue.put(set_point(yields_until=6.0), first=True)
        taken.append(queue.take_soon(lambda _: READY, 5.0)[0])
    assert taken[3] is look


def test_looks_behind_set_points_and_questions_of_others_take_turns() -> None:
    queue = Queue()
    taken = []
    for _ in range(16):
        if not queue.has(Urgency.COMMAND):
            queue.put(job(2))
        if not any(waiting.is_look for waiting in queue.of(1)):
            queue.put(Job(read_holding(1, 0, 1), urgency=Urgency.CONFIRM))
        queue.put(set_point(yields_until=6.0), first=True)
        taken.append(queue.take_soon(lambda _: READY, 5.0)[0])
    others = [each for each in taken if each is not None and not each.request.writes]
    assert [each.is_look for each in others] == [True, False, True, False]
