"""The desk: who may command what, what is done once, and what a stop overtakes."""

from __future__ import annotations

import json

import pytest

from rs485bus.service.decisions import Asker
from rs485bus.service.schema import Request, SetPoint, Stop, write
from rs485bus.service.topics import PLANT
from tests.service.office import TOPICS, Office


def wrong(office: Office, request: str) -> tuple[str, str]:
    """How a request was refused."""
    answer = office.answer(request)
    assert answer.outcome == "refused"
    assert answer.error is not None
    return answer.error.type, answer.error.message


# Done once


def test_a_verb_is_begun_after_its_id_was_stored_and_answered_after_its_result_was() -> None:
    office = Office()
    move = office.move(lease=office.take("x"))
    assert office.begun == []
    office.write()
    assert office.times_begun(move.id) == 1
    office.end(move.id)
    assert office.answers(move.id) == []
    office.write()
    assert office.answer(move.id).outcome == "done"


@pytest.mark.parametrize("when", ["before it is stored", "while it is stored", "under way", "done", "expired"])
def test_said_twice_it_is_done_once_and_answered_twice(when: str) -> None:
    office = Office()
    move = office.move(lease=office.take("x", seconds=60))
    if when != "before it is stored":
        office.write(2 if when != "while it is stored" else 1)
    if when in ("done", "expired"):
        office.end(move.id)
        office.write()
    if when == "expired":
        office.wait(30)
    office.say("x", "move_to", move, asker=Asker(TOPICS.reply("a"), b"again"))
    office.write()
    if move.id in office.running:
        office.end(move.id)
        office.write()
    assert office.times_begun(move.id) == 1
    assert [answer.outcome for answer in office.answers(move.id)] == ["done", "done"]
    assert {asker.correlation for asker, answer in office.said if answer.id == move.id} == {b"again", move.id.encode()}


def test_an_id_is_remembered_over_a_restart() -> None:
    office = Office()
    move = office.move(lease=office.take("x"))
    office.write()
    office.end(move.id)
    office.write()
    office.restart()
    office.say("x", "move_to", move)
    office.write()
    assert office.times_begun(move.id) == 1
    assert [answer.outcome for answer in office.answers(move.id)] == ["done", "done"]


def test_what_was_under_way_when_the_service_was_killed_is_unknown_and_its_axis_is_one_to_stop() -> None:
    office = Office()
    move = office.move(lease=office.take("x"))
    office.write()
    assert office.restart() == (1, frozenset("x"))
    office.say("x", "move_to", move)
    office.write()
    answer = office.answer(move.id)
    assert answer.outcome == "unknown"
    assert answer.error is not None
    assert answer.error.type == "OutcomeUnknown"
    assert office.times_begun(move.id) == 1


def test_what_was_not_stored_when_the_service_was_killed_is_refused_and_nothing_was_done() -> None:
    office = Office()
    move = office.move(lease=office.take("x"))
    assert office.begun == []
    office.restart()
    office.say("x", "move_to", move)
    office.write()
    assert wrong(office, move.id)[0] == "NotInControl"
    assert office.begun == []


@pytest.mark.parametrize(("ended", "how"), [(True, "done"), (False, "unknown")])
def test_what_was_done_before_the_clock_was_set_back_is_not_said_to_be_undone(ended: bool, how: str) -> None:
    office = Office()
    move = office.move(lease=office.take("x"))
    office.write()
    if ended:
        office.end(move.id)
        office.write()
    office.said.clear()
    office.restart(pause=-10.0)
    office.say("x", "move_to", move)
    office.write()
    assert office.answer(move.id).outcome == how
    assert office.answer(move.id).now == office.now, "else the client takes itself for being in the future"
    assert office.times_begun(move.id) == 1


@pytest.mark.parametrize("first", [True, False])
def test_a_request_that_is_said_retained_and_plainly_has_one_end(first: bool) -> None:
    office = Office()
    move = office.move(lease=office.take("x"), retained=first)
    office.write()
    office.say("x", "move_to", move, retained=not first, asker=Asker(TOPICS.reply("a"), b"again"))
    office.write()
    if not first:
        office.end(move.id)
        office.write()
    assert [answer.outcome for answer in office.answers(move.id)] == [["done", "done"], ["refused", "refused"]][first]
    assert office.times_begun(move.id) == (not first)


def test_what_was_refused_for_its_clock_is_not_begun_later() -> None:
    office = Office()
    lease = office.take("x", seconds=60)
    move = office.move(lease=lease, sent=office.now + 1, expires=office.now + 3)
    office.write()
    office.wait(2)
    office.say("x", "move_to", move)
    office.write()
    assert [answer.outcome for answer in office.answers(move.id)] == ["refused", "refused"]
    assert not office.begun


def test_an_id_that_says_something_else_the_second_time_is_refused() -> None:
    office = Office()
    move = office.move(lease=office.take("x"))
    office.write()
    office.say("x", "move_to", move.model_copy(update={"args": {"position": 2.0}}))
    assert wrong(office, move.id)[0] == "RequestMalformed"
    office.end(move.id)
    office.write()
    office.said.clear()
    office.say("x", "move_to", move.model_copy(update={"args": {"position": 2.0}}))
    office.write()
    assert wrong(office, move.id)[0] == "RequestMalformed"


def test_what_was_refused_once_is_refused_again_though_it_would_be_allowed_now() -> None:
    office = Office()
    refused = office.move(lease=7, sent=office.now - 1)
    office.write()
    lease = office.take("x")
    again = refused.model_copy(update={"lease": lease})
    office.say("x", "move_to", again)
    office.write()
    assert office.begun == []
    assert len(office.answers(refused.id)) == 2


def test_where_the_ledger_cannot_be_written_nothing_is_begun() -> None:
    office = Office()
    move = office.move(lease=office.take("x"))
    order = next(entry.order for entry in office.to_write if hasattr(entry, "order"))
    office.do(office.desk.not_stored(order, "the disk is full", office.now))
    assert wrong(office, move.id)[0] == "NotSent"
    assert office.begun == []


# Control


def test_without_a_lease_nothing_is_done() -> None:
    office = Office()
    move = office.move()
    office.write()
    assert wrong(office, move.id)[0] == "NotInControl"


def test_a_lease_covers_its_axes_alone_and_a_group_needs_all_of_its_own() -> None:
    office = Office()
    lease = office.take("x")
    other = office.move("y", lease=lease)
    group = office.request("xy", "home", lease=lease)
    office.write()
    assert "does not cover y" in wrong(office, other.id)[1]
    assert "does not cover y" in wrong(office, group.id)[1]
    assert office.take("y", lease=lease) == lease
    group = office.request("xy", "home", lease=lease)
    office.write()
    assert office.times_begun(group.id) == 1


def test_an_axis_has_one_commander_at_a_time() -> None:
    office = Office()
    office.take("x")
    taken = office.request(PLANT, "take_control", "b", args={"axes": ["xy"]})
    assert wrong(office, taken.id) == (
        "NotInControl",
        "x is commanded by a: one client at a time. Nothing was done. Wait until that one leaves. Stops need no lease.",
    )
    office.take("y", client="b")


def test_a_lease_of_somebody_else_is_no_lease() -> None:
    office = Office()
    move = office.move(client="b", lease=office.take("x"))
    office.write()
    assert wrong(office, move.id)[0] == "NotInControl"


def test_who_is_silent_for_longer_than_the_lease_loses_control_and_its_axes_are_stopped() -> None:
    office = Office()
    lease = office.take("x", "y", seconds=1.0)
    move = office.move(lease=lease)
    office.write()
    office.wait(0.9)
    assert office.halts == []
    office.presence(lease)
    office.wait(0.95)
    assert office.halts == []
    office.wait(0.1)
    ((halt, at),) = office.halts
    assert halt.axes == frozenset("xy")
    assert at == pytest.approx(1001.9)
    office.write()
    assert office.answer(move.id).outcome == "failed"
    assert office.take("x", client="b")


def test_presence_counts_from_when_it_was_sent_and_not_from_when_it_came_in() -> None:
    office = Office()
    lease = office.take("x", seconds=1.0)
    sent = office.now
    office.wait(0.8)
    office.presence(lease, sent=sent)
    office.wait(0.21)
    assert len(office.halts) == 1


def test_a_lease_that_has_just_ended_is_not_saved_by_what_comes_in_before_the_clock_is_looked_at() -> None:
    office = Office()
    lease = office.take("x", seconds=1.0)
    office.now += 1.5
    assert office.answer(office.presence(lease)).outcome == "refused"
    assert len(office.halts) == 1


def test_a_client_whose_connection_breaks_loses_control_at_once() -> None:
    office = Office()
    office.take("x", seconds=60)
    office.gone("b")
    assert office.halts == []
    office.gone("a")
    assert office.halts[0][0].axes == frozenset("x")


def test_the_loss_of_the_broker_ends_all_leases() -> None:
    office = Office()
    office.take("x", client="a", seconds=60)
    office.take("y", client="b", seconds=60)
    office.do(office.desk.cut_off("the service has lost the broker", office.now))
    assert {axis for halt, _ in office.halts for axis in halt.axes} == set("xy")
    assert office.desk.wake == float("inf")


def test_who_takes_control_anew_has_lost_what_it_had() -> None:
    office = Office()
    first = office.take("x", seconds=60)
    move = office.move(lease=first)
    office.write()
    second = office.take("y", seconds=60)
    assert second != first
    assert office.halts[0][0].axes == frozenset("x")
    late = office.move(lease=first)
    office.write()
    assert office.answer(move.id).outcome == "failed"
    assert wrong(office, late.id)[0] == "NotInControl"


def test_the_same_wish_for_control_said_twice_is_one() -> None:
    office = Office()
    said = office.request(PLANT, "take_control", args={"axes": ["x"], "seconds": 5.0})
    office.say(PLANT, "take_control", said)
    assert len({answer.value["lease"] for answer in office.answers(said.id)}) == 1
    assert office.halts == []


def test_what_is_given_back_is_stopped_and_then_answered() -> None:
    office = Office()
    lease = office.take("x")
    released = office.request(PLANT, "release_control", lease=lease)
    assert office.halts[0][0].axes == frozenset("x")
    assert office.answer(released.id).outcome == "done"
    assert office.take("x", client="b")


def test_axes_are_remembered_as_held_until_they_were_seen_to_stand() -> None:
    office = Office()
    office.take("x", seconds=1.0)
    office.write()
    assert office.ledger.recover()[1] == frozenset("x")
    office.confirms = False
    office.wait(1.1)
    office.take("y", client="b", seconds=60)
    office.write()
    assert office.ledger.recover()[1] == frozenset("xy")
    office.do(office.desk.halted(office.halts[0][0], None, office.now))
    office.write()
    assert office.ledger.recover()[1] == frozenset("y")


# Age


def test_what_comes_too_late_is_refused() -> None:
    office = Office()
    lease = office.take("x", seconds=60)
    sent = office.now
    office.wait(2.5)
    move = office.move(lease=lease, sent=sent, expires=sent + 2)
    office.write()
    assert wrong(office, move.id) == ("NotSent", "x move_to expired 0.500 s before it came in. Nothing was done.")


def test_what_expires_while_its_id_is_stored_is_not_begun() -> None:
    office = Office()
    move = office.move(lease=office.take("x", seconds=60))
    office.wait(3)
    office.write()
    assert wrong(office, move.id)[0] == "NotSent"
    assert office.begun == []


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"expires": 1100.0}, "expire within 60 s"),
        ({"sent": 1000.2, "expires": 1002.0}, "from now, by the service's clock"),
        ({"at": 1003.0}, "begin when it has expired"),
        ({"retained": True}, "retained"),
    ],
)
def test_what_is_said_for_too_long_or_from_the_future_or_retained_is_refused(
    fields: dict[str, float], said: str
) -> None:
    office = Office()
    move = office.move(lease=office.take("x"), **fields)
    office.write()
    kind, message = wrong(office, move.id)
    assert kind == "RequestMalformed"
    assert said in message
    assert office.begun == []


def test_a_verb_begins_at_its_time_if_nothing_has_come_between() -> None:
    office = Office()
    lease = office.take("x", "y", seconds=60)
    one, other = office.move(lease=lease, at=1000.5), office.move("y", lease=lease, at=1000.5)
    office.write()
    office.wait(0.4)
    assert office.begun == []
    office.stop("y")
    office.wait(0.2)
    office.write()
    assert office.begun == [(one.id, 1000.5)]
    assert wrong(office, other.id)[0] == "MoveCancelled"


# Stops


def test_a_stop_needs_no_lease_and_ends_what_is_under_way() -> None:
    office = Office()
    lease = office.take("x", "y", seconds=60)
    one, other = office.move(lease=lease), office.move("y", lease=lease)
    office.write()
    stop = office.stop("x")
    office.write()
    assert office.answer(one.id).outcome == "failed"
    assert other.id in office.running
    assert office.answer(stop).value == ["x"]


def test_nothing_that_was_said_before_a_stop_is_begun_after_it() -> None:
    office = Office()
    lease = office.take("x", seconds=60)
    stored = office.move(lease=lease)  # its id is being stored
    sent = office.now
    office.wait(0.1)
    office.stop()
    office.write()
    late = office.move(lease=lease, sent=sent)  # it was on its way
    office.write()
    assert office.begun == []
    assert wrong(office, stored.id)[0] == wrong(office, late.id)[0] == "MoveCancelled"
    office.wait(0.1)
    newer = office.move(lease=lease)
    office.write()
    assert office.times_begun(newer.id) == 1


def test_a_clock_that_is_ahead_does_not_carry_an_older_verb_over_a_stop() -> None:
    office = Office()
    lease = office.take("x", seconds=60)
    move = office.move(lease=lease, sent=office.now + 0.04)
    office.wait(0.02)
    office.stop("x")
    office.wait(0.03)
    office.write()
    assert office.begun == []
    assert wrong(office, move.id)[0] == "MoveCancelled"


def test_a_stop_that_is_said_again_while_it_is_confirmed_is_the_same_stop() -> None:
    office = Office()
    office.confirms = False
    said = Stop(id="s", client="s", axes=["x"])
    for correlation in (b"1", b"2", b"2"):
        office.do(office.desk.stop(write(said), Asker(TOPICS.reply("s"), correlation), office.now))
    ((halt, _),) = office.halts
    office.do(office.desk.halted(halt, None, office.now))
    assert [asker.correlation for asker, _ in office.said] == [b"1", b"2"]
    office.do(office.desk.stop(write(said), None, office.now))
    assert len(office.halts) == 2


@pytest.mark.parametrize("payload", [b"", b"stop!", b'{"id":"s","client":"c","axes":["nope"]}', b'{"v":9}'])
def test_a_stop_that_cannot_be_understood_stops_all(payload: bytes) -> None:
    office = Office()
    office.do(office.desk.stop(payload, None, office.now, emergency=True))
    ((halt, _),) = office.halts
    assert halt.emergency
    assert halt.axes == frozenset("xyz")


def test_clearing_an_emergency_stop_that_was_said_before_another_one_is_refused() -> None:
    office = Office()
    lease = office.take("x", seconds=60)
    clear = office.request(PLANT, "clear_emergency_stop", lease=lease)
    office.wait(0.01)
    office.stop(emergency=True)
    office.write()
    assert wrong(office, clear.id)[0] == "MoveCancelled"


@pytest.mark.parametrize("when", ["being stored", "waiting", "under way", "done"])
def test_one_verb_is_cancelled_and_the_others_go_on(when: str) -> None:
    office = Office()
    lease = office.take("x", seconds=60)
    move = office.move(lease=lease, at=1001.0 if when == "waiting" else None)
    other = office.move(lease=lease)
    if when != "being stored":
        office.write()
    if when == "done":
        office.end(move.id)
    office.request(PLANT, "cancel", args={"request": move.id})
    office.write()
    outcome = {"under way": "failed", "done": "done"}.get(when, "refused")
    assert office.answer(move.id).outcome == outcome
    assert other.id in office.running


# What is malformed


def refusal(office: Office, payload: dict[str, object], topic: str = "x/move_to", reply: str | None = None) -> str:
    asker = Asker(TOPICS.reply("a") if reply is None else reply, b"1")
    office.do(office.desk.request(topic, json.dumps(payload).encode(), asker, office.now, retained=False))
    office.write()
    answers = [answer for _, answer in office.said] + office.refused
    assert office.begun == []
    assert answers[-1].outcome == "refused"
    assert answers[-1].error is not None
    return answers[-1].error.message


GOOD = {"v": 1, "id": "r1", "client": "a", "sent": 1000.0, "expires": 1001.0, "args": {"position": 1.0}}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"v": 0}, "version 0 of the schema, and this side speaks version 1"),
        ({"id": ""}, "id:"),
        ({"id": "a/b"}, "id:"),
        ({"sent": "soon"}, "sent:"),
        ({"speed": 3}, "speed: Extra inputs"),
        ({"args": {}}, "args.position: Field required"),
        ({"args": {"position": "3"}}, "args.position: Input should be a valid number"),
        ({"args": {"position": 3, "rpn": 5}}, "args.rpn: Extra inputs"),
        ({"args": []}, "args:"),
    ],
)
def test_what_the_schema_does_not_allow_is_refused_in_words(change: dict[str, object], said: str) -> None:
    assert said in refusal(Office(), GOOD | change)


def test_what_there_is_not_is_refused_with_what_there_is() -> None:
    assert "There is no 'q' here: x, y, z, xy" in refusal(Office(), GOOD, "q/move_to")
    assert "x has no verb 'jump'" in refusal(Office(), GOOD, "x/jump")


def test_answers_go_to_the_client_and_nowhere_else() -> None:
    office = Office()
    assert "response topic of a" in refusal(office, GOOD, reply=TOPICS.stop)
    assert "response topic of a" in refusal(office, GOOD, reply=TOPICS.reply("b"))
    assert all(TOPICS.is_reply(asker.topic) for asker, _ in office.said)


def test_a_request_without_a_response_topic_is_told_of_on_a_topic_for_all() -> None:
    office = Office()
    office.do(office.desk.request("x/move_to", json.dumps(GOOD).encode(), None, office.now, retained=False))
    assert office.refused[0].id == "r1"


# Set-points


def stream(office: Office, **fields: float) -> tuple[int, SetPoint]:
    lease = office.take("x", seconds=60)
    opened = office.request("x", "stream", lease=lease, args={"timeout": 0.25})
    office.write()
    return lease, SetPoint(stream=opened.id, client="a", lease=lease, sent=office.now, n=0, values=[60.0])


def test_a_set_point_holds_from_when_it_was_sent() -> None:
    office = Office()
    _, first = stream(office)
    office.wait(0.1)
    office.set_point(first)
    assert office.set_points == [("x", (60.0,), 1000.25)]


@pytest.mark.parametrize(
    "fields",
    [{"sent": 999.7}, {"lease": 5}, {"client": "b"}, {"stream": "other"}, {"n": 3, "sent": 1000.02}],
    ids=["stale", "another lease", "another client", "another stream", "older than a stop"],
)
def test_a_set_point_that_must_not_be_used_is_dropped(fields: dict[str, object]) -> None:
    office = Office()
    _, first = stream(office)
    office.wait(0.05)
    if "n" in fields:
        office.stop("y", "x")
    office.set_point(first.model_copy(update=fields))
    assert office.set_points == []


def test_of_set_points_that_overtake_each_other_the_newest_counts() -> None:
    office = Office()
    _, first = stream(office)
    for n in (0, 2, 1, 2, 3):
        office.set_point(first.model_copy(update={"n": n, "values": [float(n)]}))
    assert [values for _, values, _ in office.set_points] == [(0.0,), (2.0,), (3.0,)]


def test_a_stop_ends_a_stream_and_later_set_points_do_nothing() -> None:
    office = Office()
    _, first = stream(office)
    office.stop("x")
    office.wait(0.1)
    office.set_point(first.model_copy(update={"sent": office.now}))
    assert office.set_points == []


def test_set_points_show_that_the_client_is_there() -> None:
    office = Office()
    lease = office.take("x", seconds=1.0)
    opened = office.request("x", "stream", lease=lease, args={"timeout": 0.25})
    office.write()
    for n in range(20):
        office.wait(0.1)
        office.set_point(SetPoint(stream=opened.id, client="a", lease=lease, sent=office.now, n=n, values=[60.0]))
    assert office.halts == []
    assert len(office.set_points) == 20


def test_an_answer_to_a_question_needs_no_lease() -> None:
    office = Office()
    office.request("x", "position")
    assert [order.verb for order in office.asked] == ["position"]


def test_a_request_is_json_as_the_schema_says() -> None:
    assert json.loads(write(Request(id="1", client="a", sent=1.0, expires=2.0))) == {
        "v": 1,
        "id": "1",
        "client": "a",
        "sent": 1.0,
        "expires": 2.0,
        "args": {},
    }
