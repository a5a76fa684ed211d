"""Messages that are wrong in every way: nothing is begun, stops stop, and the service goes on. By plain calls."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from rs485bus import Bus, BusConfig, MksServo, open_bus
from rs485bus.errors import BusError, StopUnconfirmed
from rs485bus.motion.axis import Axis
from rs485bus.service.clock import Clock
from rs485bus.service.decisions import Asker, Halt, Order
from rs485bus.service.dispatcher import Dispatcher
from rs485bus.service.ledger import Ledger
from rs485bus.service.machine import Machine
from rs485bus.service.schema import LONGEST, Answer, Message, write
from rs485bus.service.topics import PLANT
from rs485bus.service.verbs import Nothing
from rs485bus.sim import SimMks, VirtualLine
from tests.integration.support import virtual
from tests.service.office import TOPICS, Office
from tests.service.test_reporter import Plant

ME = Asker(TOPICS.reply("a"), b"c")
DEEP = b"[" * 5_000

GARBAGE = {
    "nothing": b"",
    "bytes": b"\xff\xfe{}",
    "a number": b"1",
    "brackets without an end": DEEP,
    "objects without an end": b'{"a":' * 2_500,
    "half a surrogate for an id": b'{"v": 1, "id": "\\ud800"}',
    "a megabyte": b" " * 1_000_000,
    "a megabyte of brackets": b"[" * 1_000_000,
    "a version that is none": b'{"v": {}, "id": "1"}',
    "a long version": json.dumps({"v": "9" * 10_000, "id": "1"}).encode(),
    "ten thousand unknown fields": json.dumps({f"k{number}": 0 for number in range(1_000)}).encode(),
}


@pytest.mark.parametrize("payload", GARBAGE.values(), ids=GARBAGE)
def test_what_is_garbage_is_refused_in_few_words_and_stops_all_where_it_is_a_stop(payload: bytes) -> None:
    office = Office()
    office.take("x", seconds=60)
    desk = office.desk
    for name in ("x/move_to", "xy/move_to", "plant/move_to", "plant/take_control", "x/position", "none/none"):
        office.do(desk.request(name, payload, ME, office.now, retained=False))
    office.do(desk.presence(payload, "a", ME, office.now, retained=False))
    office.do(desk.setpoint("x", payload, office.now, retained=False))
    office.do(desk.gone("somebody", office.now))
    office.write()
    refusals = [answer for _, answer in office.said if answer.outcome == "refused"] + office.refused
    assert len(refusals) == 8
    assert all(len(write(answer)) < 1_000 for answer in refusals)
    assert not office.begun
    for emergency in (False, True):
        office.do(desk.stop(payload, ME, office.now, emergency=emergency))
    assert [(halt.axes, halt.emergency) for halt, _ in office.halts] == [
        (frozenset("xyz"), False),
        (frozenset("xyz"), True),
    ]


WRONG_TYPES: dict[str, dict[str, Any]] = {
    "a number in quotation marks": {"args": {"position": "1"}},
    "a lease in quotation marks": {"lease": "LEASE"},
    "a truth for a lease": {"lease": True},
    "a truth for a position": {"args": {"position": True}},
    "a position that is no number": {"args": {"position": float("nan")}},
    "an endless position": {"args": {"position": float("inf")}},
    "a list": {"args": [1.0]},
    "no arguments at all": {"args": None},
    "a time in quotation marks": {"sent": "1000"},
    "an endless time": {"at": float("inf")},
    "a time that is no number": {"sent": float("nan")},
    "a number for an id": {"id": 5},
    "an id with a new line": {"id": "a\n"},
    "an id that is too long": {"id": "a" * 65},
    "a negative lease": {"lease": -1},
    "a lease that is too long": {"lease": 2**60},
    "a field that nobody knows": {"force": True},
}


@pytest.mark.parametrize("fields", WRONG_TYPES.values(), ids=WRONG_TYPES)
def test_what_has_a_wrong_type_is_refused_and_not_guessed(fields: dict[str, Any]) -> None:
    office = Office()
    lease = office.take("x", seconds=60)
    said = {"v": 1, "id": "m", "client": "a", "lease": lease, "sent": office.now, "expires": office.now + 2}
    said |= {"args": {"position": 1.0}, **fields}
    if said["lease"] == "LEASE":
        said["lease"] = str(lease)
    office.do(office.desk.request("x/move_to", json.dumps(said).encode(), ME, office.now, retained=False))
    office.write()
    assert not office.begun
    assert "what its schema says" in office.said[-1][1].error.message  # type: ignore[union-attr]


def test_a_message_of_the_longest_length_is_read_and_a_longer_one_is_not() -> None:
    office = Office()
    said = {"v": 1, "id": "m", "client": "a", "sent": office.now, "expires": office.now + 2, "args": {}}
    payload = json.dumps(said).encode()
    payload += b" " * (LONGEST - len(payload))
    office.do(office.desk.request("plant/time", payload, ME, office.now, retained=False))
    assert office.said[-1][1].outcome == "done"
    office.do(office.desk.request("plant/time", payload + b" ", ME, office.now, retained=False))
    assert "16385 bytes: 16384 are allowed" in office.said[-1][1].error.message  # type: ignore[union-attr]


def test_who_is_there_is_what_the_topic_names_for_that_is_what_an_access_list_guards() -> None:
    office = Office()
    lease = office.take("x", client="a", seconds=1)
    office.wait(0.8)
    said = {"v": 1, "id": "p", "client": "a", "lease": lease, "sent": office.now}
    office.do(office.desk.presence(json.dumps(said).encode(), "other", None, office.now, retained=False))
    assert "The topic names other, and the message a" in office.refused[-1].error.message  # type: ignore[union-attr]
    office.wait(0.3)
    assert office.desk.leases.of("a") is None


def test_of_a_thousand_stops_at_once_one_is_carried_out_and_all_are_answered() -> None:
    office = Office()
    office.confirms = False
    stops = [office.stop("x") for _ in range(1_000)]
    ((halt, _),) = office.halts
    office.do(office.desk.halted(halt, None, office.now))
    assert [len(office.answers(stop)) for stop in stops] == [1] * 1_000
    office.stop("x")
    assert len(office.halts) == 2


def test_a_stop_is_carried_out_anew_where_something_has_begun_since_the_one_before() -> None:
    office = Office()
    office.confirms = False
    lease = office.take("x", "y", seconds=60)
    office.stop("x")
    office.wait(0.01)
    office.move(lease=lease)
    office.write()
    assert office.begun
    office.stop("x")
    assert len(office.halts) == 2


def test_a_stop_that_another_one_does_already_ends_what_waits_for_its_time() -> None:
    office = Office()
    office.confirms = False
    lease = office.take("x", seconds=60)
    office.stop("x")
    office.wait(0.01)
    move = office.move(lease=lease, at=office.now + 0.5)
    office.write()
    office.stop("x")
    office.write()
    assert office.answer(move.id).outcome == "refused"
    office.wait(1)
    assert not office.begun


class Desk:
    """A service without a broker: what it publishes is kept."""

    def __init__(self, bus: Bus, *axes: MksServo) -> None:
        self.said: list[tuple[str, Message]] = []
        self.fails = False
        self.plant = Plant({"main": bus}, {f"a{number}": axis for number, axis in enumerate(axes)}, groups={})
        machine = Machine(self.plant)
        self.clock = Clock()
        self.dispatcher = Dispatcher(machine, Ledger(":memory:"), self.clock, TOPICS, self._publish, 5.0)

    def _publish(self, topic: str, message: Message, **options: Any) -> None:
        if self.fails:
            raise ValueError("a surprise")
        self.said.append((topic, message))

    def ask(self, request: str, name: str, verb: str, **fields: Any) -> None:
        now = self.clock.now()
        said = {"v": 1, "id": request, "client": "a", "sent": now, "expires": now + 5, **fields}
        self.dispatcher.hear(["request", name, verb], json.dumps(said).encode(), ME, retained=False)

    def answers(self) -> list[Answer]:
        return [said for _, said in self.said if isinstance(said, Answer)]


@virtual
async def test_a_thousand_questions_at_once_are_answered_by_two_frames_the_second_one_after_them() -> None:
    async with open_bus(VirtualLine(SimMks(1), baudrate=115200)) as bus:
        desk = Desk(bus, MksServo(bus, 1))
        await desk.plant.axes["a0"].position()
        before = bus.stats.transactions
        for number in range(1_000):
            desk.ask(f"q{number}", "a0", "position")
            await asyncio.sleep(1e-6)
        await asyncio.sleep(1)
        assert bus.stats.transactions - before == 2
        assert {answer.id for answer in desk.answers()} == {f"q{number}" for number in range(1_000)}
        assert all(answer.outcome == "done" for answer in desk.answers())
        await desk.dispatcher.leave()


@virtual
@pytest.mark.parametrize("emergency", [False, True])
async def test_a_stop_of_all_stops_the_others_where_one_cannot_even_be_asked_for(
    monkeypatch: pytest.MonkeyPatch, emergency: bool
) -> None:
    async with open_bus(VirtualLine(SimMks(1), baudrate=115200)) as away, open_bus(VirtualLine(SimMks(1))) as bus:
        broken, axis = MksServo(away, 1), MksServo(bus, 1)
        desk = Desk(away, broken, axis)
        desk.plant.buses = {"away": away, "main": bus}

        def fail(*arguments: object) -> None:
            raise RuntimeError("a surprise")

        await axis.enable()
        await axis.run(60)
        monkeypatch.setattr(MksServo, "stop", lambda self: fail() if self is broken else Axis.stop(self))
        monkeypatch.setattr(Bus, "emergency_stop", lambda self: fail() if self is away else stop_bus(self))
        topic = "emergency_stop" if emergency else "stop"
        desk.dispatcher.hear([topic], b'{"v": 1, "id": "1", "client": "a"}', ME, retained=False)
        await asyncio.sleep(1)
        assert not axis.motion.may_move
        (answer,) = desk.answers()
        assert answer.outcome == "failed"
        assert answer.error is not None
        assert "a surprise" in answer.error.message
        await desk.dispatcher.leave()


stop_bus = Bus.emergency_stop


@virtual
async def test_an_emergency_stop_is_cleared_on_all_buses_or_on_none(monkeypatch: pytest.MonkeyPatch) -> None:
    silent = SimMks(1)
    config = BusConfig(close_timeout=0.5)
    async with open_bus(VirtualLine(SimMks(1))) as one, open_bus(VirtualLine(silent), config=config) as other:
        axes = {"a": MksServo(one, 1), "b": MksServo(other, 1)}
        machine = Machine(Plant({"one": one, "other": other}, axes, groups={}))
        monkeypatch.setattr(silent, "receive", lambda frame, now: None)
        standing = asyncio.ensure_future(machine.halt(Halt(frozenset("ab"), "", emergency=True)))
        await asyncio.sleep(0.3)
        clear = Order(
            "c", "a", PLANT, "clear_emergency_stop", Nothing(), frozenset("ab"), frozenset(), 1, 0, 9, None, ""
        )
        with pytest.raises(BusError, match="still being confirmed"):
            machine.begin(clear)
        assert [one.latched, other.latched] == [True, True]
        with pytest.raises(StopUnconfirmed):
            await standing
        machine.begin(clear)
        assert [one.latched, other.latched] == [False, False]
        monkeypatch.undo()


@virtual
async def test_whatever_cannot_be_carried_out_a_lease_ends_in_its_time(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with open_bus(VirtualLine(SimMks(1), baudrate=115200)) as bus:
        axis = MksServo(bus, 1)
        desk = Desk(bus, axis)
        await axis.enable()
        await axis.run(60)
        desk.fails = True
        monkeypatch.setattr(desk.clock, "now", asyncio.get_running_loop().time)
        desk.ask("t", "plant", "take_control", args={"axes": ["a0"]})
        assert "could not be carried out" in caplog.text
        await asyncio.sleep(2)
        assert not axis.motion.may_move
        await desk.dispatcher.leave()


@virtual
async def test_a_message_that_nobody_has_thought_of_does_not_end_the_service_and_a_stop_is_a_stop(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with open_bus(VirtualLine(SimMks(1), baudrate=115200)) as bus:
        axis = MksServo(bus, 1)
        desk = Desk(bus, axis)
        await axis.enable()
        await axis.run(60)

        def fail(*arguments: object, **options: object) -> None:
            raise RecursionError("a surprise")

        monkeypatch.setattr("rs485bus.service.intake.Intake.order", fail)
        desk.ask("q", "a0", "position")
        assert "could not be dealt with" in caplog.text
        monkeypatch.setattr("rs485bus.service.intake.Intake.halt", _once_failing(fail))
        desk.dispatcher.hear(["stop"], b"{}", None, retained=False)
        await asyncio.sleep(1)
        assert await axis.idle()
        await desk.dispatcher.leave()


def _once_failing(fail: Any) -> Any:
    from rs485bus.service.decisions import Halt
    from rs485bus.service.intake import Intake

    calls = []

    def halt(self: Intake, payload: bytes, asker: Asker | None, *, emergency: bool) -> Halt:
        calls.append(payload)
        if len(calls) == 1:
            fail()
        return Halt(self.named(self._axes), "A stop was asked for.", emergency)

    return halt
