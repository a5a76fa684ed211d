"""The pure parts of a client: what it knows of the service's clock, and when it says something again."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus import errors
from rs485bus.remote.clock import DRIFT, RemoteClock
from rs485bus.remote.requests import AGAIN, AGAIN_BEGUN, Pending, PendingRequests
from rs485bus.service.schema import Answer
from rs485bus.service.topics import Topics
from rs485bus.service.troubles import raised, trouble

DELAYS = st.floats(0, 5)


@given(
    st.lists(st.tuples(DELAYS, DELAYS, st.floats(0, 100)), min_size=1, max_size=80),
    st.floats(-1e9, 1e9),
    st.floats(-DRIFT / 2, DRIFT / 2),
)
def test_the_clock_never_takes_itself_for_later_than_it_is(
    ways: list[tuple[float, float, float]], ahead: float, drift: float
) -> None:
    clock, now = RemoteClock(), 1000.0

    def there(at: float) -> float:
        return at + ahead + drift * (at - 1000.0)

    for way, back, pause in ways:
        clock.learn(there(now + way), now, now + way + back)
        now += way + back + pause
    assert clock.now(now) <= there(now) + 1e-6
    offset, wrong = clock.offset(now)
    assert abs(offset - (there(now) - now)) <= wrong + 1e-6


def test_an_answer_that_was_stored_before_tells_no_more_than_it_can() -> None:
    clock = RemoteClock()
    clock.learn(5000.0, 999.9, 1000.1)
    clock.learn(4000.0, None, 1001.0)  # it is a thousand seconds old
    assert clock.now(1001.0) == pytest.approx(5000.9, abs=0.001)
    assert clock.offset(1001.0) == pytest.approx((4000.0, 0.1), abs=0.001)


def test_what_is_not_heard_of_is_said_again_and_in_the_end_unknown() -> None:
    requests, ended = PendingRequests(patience=10), []
    verb = Pending("1", "move", "t", bytes, True, 2.0, lambda answer, error: ended.append(error))
    question = Pending("2", "position", "t", bytes, False, 2.0, lambda answer, error: ended.append(error))
    for request in (verb, question):
        requests.add(request)
        requests.sent(request, 100.0)
    assert requests.due(100.0 + AGAIN / 2) == []
    assert requests.due(100.0 + AGAIN) == [verb, question]
    requests.answered(Answer(id="1", outcome="begun", now=0), 101.0)
    requests.sent(verb, 101.0)
    assert requests.due(101.0 + AGAIN_BEGUN) == [verb, question]
    assert requests.due(110.5) == [verb]
    assert isinstance(ended[0], errors.NoReply)
    assert requests.due(111.5) == []
    assert isinstance(ended[1], errors.OutcomeUnknown)


def test_what_was_never_sent_was_not_done() -> None:
    requests, ended = PendingRequests(patience=10), []
    requests.add(Pending("1", "move", "t", bytes, True, 2.0, lambda answer, error: ended.append(error)))
    requests.give_up("the connection was closed.")
    assert isinstance(ended[0], errors.NotSent)


def test_an_end_is_told_once() -> None:
    requests, ended = PendingRequests(patience=10), []
    requests.add(Pending("1", "move", "t", bytes, True, 2.0, lambda answer, error: ended.append(answer)))
    for _ in range(2):
        requests.answered(Answer(id="1", outcome="done", now=0), 101.0)
    assert len(ended) == 1


@pytest.mark.parametrize("kind", [kind for kind in vars(errors).values() if isinstance(kind, type)])
def test_every_error_has_the_same_name_on_the_other_side(kind: type[Exception]) -> None:
    if not issubclass(kind, errors.BusError):
        return
    told = raised(trouble(kind("why")))
    assert type(told) is kind
    assert "why" in str(told)


def test_an_error_carries_what_it_knows_of_its_request() -> None:
    told = raised(trouble(errors.OutcomeUnknown("why", address=5, request=b"\1\2", attempts=3, code=4)))
    assert isinstance(told, errors.OutcomeUnknown)
    assert (told.address, told.request, told.attempts, told.code) == (5, b"\1\2", 3, 4)


def test_an_error_that_nobody_knows_there_is_told_by_the_nearest_name() -> None:
    class Special(errors.MotorStalled):
        pass

    assert type(raised(trouble(Special("why")))) is errors.MotorStalled
    assert str(raised(trouble(ZeroDivisionError("why")))) == "ZeroDivisionError: why"


@pytest.mark.parametrize("name", ["", "a b", "a/b", "+", "#", "ü"])
def test_what_cannot_be_a_topic_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="cannot be part of a topic"):
        Topics(name)
