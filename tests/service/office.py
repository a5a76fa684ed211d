"""A desk with what it needs, driven by plain calls: a ledger, axes that do as they are told, a clock moved by hand."""

from __future__ import annotations

import itertools
from collections import deque
from typing import Any

from rs485bus.service import verbs
from rs485bus.service.decisions import (
    Ask,
    Asker,
    Begin,
    Cancel,
    Decision,
    Halt,
    Hold,
    Order,
    Recall,
    Refused,
    Say,
    Settle,
    SetTo,
    Tell,
)
from rs485bus.service.desk import Desk
from rs485bus.service.leases import LeaseBook
from rs485bus.service.ledger import Ledger
from rs485bus.service.schema import Answer, AxisEvent, Message, Presence, Request, SetPoint, Stop, write
from rs485bus.service.topics import PLANT, Topics

TOPICS = Topics("cell")
AXES = {name: frozenset({name}) for name in "xyz"} | {"xy": frozenset("xy")}


def table(name: str, which: str) -> verbs.Verb | None:
    kind = verbs.PLANT if name == PLANT else verbs.GROUP if name == "xy" else verbs.AXIS
    return kind.get(which)


class Office:
    """The desk of a plant with the axes x, y, z and the group xy.

    What it decides is carried out, except that the ledger is written only when `write` is called, and that what has
    begun ends only when `end` is called.
    """

    def __init__(self, ledger: Ledger | None = None, now: float = 1000.0) -> None:
        self.now = now
        self.ledger = ledger or Ledger(":memory:", lambda: self.now)
        self._lease_numbers = itertools.count(1)
        self._ids = itertools.count(1)
        self.said: list[tuple[Asker, Answer]] = []
        self.begun: list[tuple[str, float]] = []
        self.halts_before: dict[str, int] = {}
        """How many stops there had been when each request was begun."""
        self.running: dict[str, Order] = {}
        self.halts: list[tuple[Halt, float]] = []
        self.set_points: list[tuple[str, tuple[float, ...], float]] = []
        self.refused: list[Answer] = []
        self.events: list[AxisEvent] = []
        self.asked: list[Order] = []
        self.confirms = True
        """Axes that are stopped are seen to stand."""
        self.to_write: deque[Recall | Settle | Hold] = deque()
        self.desk = self._new_desk()

    def _new_desk(self) -> Desk:
        return Desk(TOPICS, AXES, table, LeaseBook(lambda: int(self.now * 1000) + next(self._lease_numbers)))

    # What clients say

    def request(self, name: str, verb: str, client: str = "a", *, retained: bool = False, **fields: Any) -> Request:
        """Say a request, as a client does."""
        given: dict[str, Any] = {"id": f"r{next(self._ids)}", "sent": self.now, "expires": self.now + 2}
        said = Request(client=client, **(given | fields))
        self.say(name, verb, said, retained=retained)
        return said

    def say(self, name: str, verb: str, said: Message, *, retained: bool = False, asker: Asker | None = None) -> None:
        client = getattr(said, "client", "a")
        asker = asker or Asker(TOPICS.reply(client), getattr(said, "id", "").encode())
        self.do(self.desk.request(f"{name}/{verb}", write(said), asker, self.now, retained=retained))

    def take(self, *axes: str, client: str = "a", seconds: float = 1.0, lease: int | None = None) -> int:
        """Take control; the number of the lease."""
        said = self.request(PLANT, "take_control", client, lease=lease, args={"axes": list(axes), "seconds": seconds})
        answer = self.answer(said.id)
        assert answer.outcome == "done", answer
        return int(answer.value["lease"])

    def move(self, axis: str = "x", client: str = "a", lease: int | None = None, **fields: Any) -> Request:
        fields.setdefault("args", {"position": 1.0})
        return self.request(axis, "move_to", client, lease=lease, **fields)

    def presence(self, lease: int, client: str = "a", sent: float | None = None) -> str:
        said = Presence(id=f"p{next(self._ids)}", client=client, lease=lease, sent=self.now if sent is None else sent)
        asker = Asker(TOPICS.reply(client), said.id.encode())
        self.do(self.desk.presence(write(said), client, asker, self.now, retained=False))
        return said.id

    def stop(self, *axes: str, client: str = "s", emergency: bool = False) -> str:
        said = Stop(id=f"s{next(self._ids)}", client=client, axes=list(axes) or None)
        asker = Asker(TOPICS.reply(client), said.id.encode())
        self.do(self.desk.stop(write(said), asker, self.now, emergency=emergency))
        return said.id

    def gone(self, client: str) -> None:
        self.do(self.desk.gone(client, self.now))

    def set_point(self, said: SetPoint, name: str = "x") -> None:
        self.do(self.desk.setpoint(name, write(said), self.now, retained=False))

    # What happens

    def write(self, count: int | None = None) -> None:
        """The ledger writes some entries; all that wait, and those that follow, for None."""
        while self.to_write and (count is None or count > 0):
            count = None if count is None else count - 1
            entry = self.to_write.popleft()
            match entry:
                case Recall(order, keep):
                    if keep:
                        (former,) = self.ledger.carry_out([lambda ledger, o=order: ledger.store(o.id, o.digest)])
                    else:
                        (former,) = self.ledger.carry_out([lambda ledger, o=order: ledger.look_up(o.id)])
                    self.do(self.desk.recalled(order, former, self.now))  # type: ignore[arg-type]
                case Settle(order, answer):
                    self.ledger.carry_out([lambda ledger, o=order, a=answer: ledger.settle(o.id, a)])
                    self.do(self.desk.settled(order))
                case Hold(axes):
                    self.ledger.carry_out([lambda ledger, axes=axes: ledger.hold(axes)])

    def end(self, request: str, outcome: str = "done") -> None:
        """What has begun ends."""
        order = self.running.pop(request)
        self.do(self.desk.ended(order, Answer(id=request, outcome=outcome, value=1.0, now=self.now)))  # type: ignore[arg-type]

    def wait(self, seconds: float) -> None:
        """Time passes; the desk is called when it wants to be."""
        until = self.now + seconds
        while self.desk.wake <= until:
            self.now = max(self.now, self.desk.wake)
            self.do(self.desk.tick(self.now))
        self.now = until

    def restart(self, pause: float = 0.1) -> tuple[int, frozenset[str]]:
        """The service is killed and started again. What was not written is gone; drives go on by themselves."""
        self.to_write.clear()
        self.running.clear()
        self.now += pause
        recovered = self.ledger.recover()
        self.desk = self._new_desk()
        return recovered

    def do(self, decisions: list[Decision]) -> None:
        for decision in decisions:
            match decision:
                case Recall() | Settle() | Hold():
                    self.to_write.append(decision)
                case Begin(order):
                    self.begun.append((order.id, self.now))
                    self.halts_before[order.id] = len(self.halts)
                    self.running[order.id] = order
                    self.do(self.desk.began(order, Answer(id=order.id, outcome="begun", now=self.now)))
                case Cancel(order):
                    self.end(order.id, "failed")
                case Halt():
                    self.halts.append((decision, self.now))
                    for order in [order for order in self.running.values() if order.axes & decision.axes]:
                        self.end(order.id, "failed")
                    if self.confirms:
                        self.do(self.desk.halted(decision, None, self.now))
                case Say(asker, answer):
                    self.said.append((asker, answer))
                case SetTo(name, values, until):
                    self.set_points.append((name, values, until))
                case Ask(order):
                    self.asked.append(order)
                case Tell(event):
                    self.events.append(event)
                case Refused(_, answer):
                    self.refused.append(answer)

    # What was said

    def answers(self, request: str) -> list[Answer]:
        """All ends that were told of a request."""
        return [answer for _, answer in self.said if answer.id == request and answer.outcome != "begun"]

    def answer(self, request: str) -> Answer:
        (answer,) = self.answers(request)
        return answer

    def times_begun(self, request: str) -> int:
        return sum(begun == request for begun, _ in self.begun)
