"""Takes what clients say, and decides what is done: once, by who commands, and nothing older after a stop. Pure.

Messages and the time are arguments. What comes back is a list of decisions, which the service carries out in order.
What became of them is told to the desk in turn. Times are the service's clock.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable, Mapping

from rs485bus.errors import BusError, MoveCancelled, NotInControl, NotSent, RequestMalformed
from rs485bus.service import verbs
from rs485bus.service.decisions import (
    Ask,
    Asker,
    Begin,
    Cancel,
    Decision,
    Former,
    Halt,
    Hold,
    Order,
    Recall,
    Refused,
    Say,
    Settle,
    SetTo,
    Stage,
    Tell,
)
from rs485bus.service.intake import Intake, check_age, check_topic, refuse_retained, used_before
from rs485bus.service.leases import Lease, LeaseBook
from rs485bus.service.refusals import Refusal, Refusals
from rs485bus.service.schema import Answer, AxisEvent, Presence, SetPoint, read, told_id
from rs485bus.service.stops import StopBook
from rs485bus.service.streams import StreamBook
from rs485bus.service.topics import Topics
from rs485bus.service.troubles import ending, trouble
from rs485bus.service.verbs import TakeControl, Verb


class Desk:
    """What is asked for of one plant.

    Args:
        topics: those of the plant.
        axes: its axes, by the names that verbs can be said to: of axes, groups and vehicles.
        verb: what can be asked of a name; None for what cannot.
        leases: who commands what.
    """

    def __init__(
        self,
        topics: Topics,
        axes: Mapping[str, frozenset[str]],
        verb: Callable[[str, str], Verb | None],
        leases: LeaseBook | None = None,
    ) -> None:
        self._axes = dict(axes)
        self._intake = Intake(topics, axes, verb)
        self.leases = leases or LeaseBook()
        self.streams = StreamBook()
        self._orders: dict[str, Order] = {}
        self.stops = StopBook()
        self._refusals = Refusals()
        self._due: list[tuple[float, int, Order]] = []
        self._number = itertools.count()

    @property
    def wake(self) -> float:
        """When `tick` is due."""
        return min(self.leases.first_end, self._due[0][0] if self._due else float("inf"))

    def under_way(self, axis: str) -> Order | None:
        """The latest order of an axis that has begun and not ended."""
        begun = [order for order in self._orders.values() if axis in order.axes and order.stage is Stage.BEGUN]
        return begun[-1] if begun else None

    # Requests

    def request(self, topic: str, payload: bytes, asker: Asker | None, now: float, *, retained: bool) -> list[Decision]:
        """A request came in."""
        return [*self.tick(now), *self._request(topic, payload, asker, now, retained)]

    def _request(self, topic: str, payload: bytes, asker: Asker | None, now: float, retained: bool) -> list[Decision]:
        try:
            order, verb = self._intake.order(topic, payload, asker, now, retained=retained)
        except RequestMalformed as error:
            return self._refuse(told_id(payload), asker, error, now, topic)
        same = self._known(order, now)
        if same is not None:
            return same
        if not verb.leased:
            return self._question(order, now)
        try:
            self._check(order, now)
        except BusError as error:
            order.problem = error  # but what was done before is answered as what it was
        self._orders[order.id] = order
        return [Recall(order, keep=order.problem is None)]

    def recalled(self, order: Order, former: Former | None, now: float) -> list[Decision]:
        """An order's id was looked up, and stored if it was new. `former` is what was stored of it before."""
        return [*self.tick(now), *self._recalled(order, former, now)]

    def _recalled(self, order: Order, former: Former | None, now: float) -> list[Decision]:
        if former is not None:
            del self._orders[order.id]
            if former.digest != order.digest:
                error = used_before(order)
                return [
                    said for asker in order.askers for said in self._refuse(order.id, asker, error, now, order.name)
                ]
            # The clock may have been set since: who is answered goes by the time in it.
            return [Say(asker, former.answer.model_copy(update={"now": now})) for asker in order.askers]
        kept = order.problem is None
        if kept:
            try:
                self._check(order, now)
            except BusError as error:
                order.problem = error
        if order.problem is not None:
            return self._reject(order, order.problem, now) if kept else self._drop(order, now)
        if order.at is not None and order.at > now:
            order.stage = Stage.WAITING
            heapq.heappush(self._due, (order.at, next(self._number), order))
            return []
        return self._begin(order)

    def not_stored(self, order: Order, why: str, now: float) -> list[Decision]:
        """An order's id could not be stored: so it is not begun."""
        order.problem = NotSent(f"{why}. What cannot be remembered is not begun: nothing was done.")
        return self._drop(order, now)

    def began(self, order: Order, answer: Answer) -> list[Decision]:
        """An order was begun: who asks is told when it should be done."""
        order.begun = answer
        return [Say(asker, answer) for asker in order.askers]

    def ended(self, order: Order, answer: Answer) -> list[Decision]:
        """An order has ended."""
        if order.why and answer.error is not None:
            error = answer.error.model_copy(update={"message": f"{answer.error.message} {order.why}"})
            answer = answer.model_copy(update={"error": error})
        self.streams.close(order.id)
        order.stage, order.answer = Stage.SETTLING, answer
        return [Settle(order, answer)]

    def settled(self, order: Order) -> list[Decision]:
        """What became of an order was stored."""
        self._orders.pop(order.id, None)
        assert order.answer is not None
        return [Say(asker, order.answer) for asker in order.askers]

    # Stops

    def stop(self, payload: bytes, asker: Asker | None, now: float, *, emergency: bool = False) -> list[Decision]:
        """Somebody wants axes to be stopped. What cannot be understood stops all."""
        halt = self._intake.halt(payload, asker, emergency=emergency)
        decisions: list[Decision] = []
        earlier = self.stops.same(halt)
        if earlier is None:
            earlier = self.stops.covering(halt)
            if earlier is None:
                return self._halt(halt, now)
            self.stops.said(halt, now)
            decisions = self._close(halt, now)
        earlier.askers.extend(asked for asked in halt.askers if asked not in earlier.askers)
        return decisions

    def halted(self, halt: Halt, error: Exception | None, now: float) -> list[Decision]:
        """Axes were seen to stand after a stop; or not, and why."""
        standing = error is None
        self.stops.ended(halt, standing=standing)
        answer = Answer(id="", outcome="done", value=sorted(halt.axes), now=now)
        if error is not None:
            answer = Answer(id="", outcome="failed", error=trouble(error), now=now)
        return [
            *([self._hold()] if standing else []),
            *(_tell(axis, "stopped" if standing else "not standing", halt.why, now) for axis in sorted(halt.axes)),
            *(Say(asker, answer.model_copy(update={"id": request})) for request, asker in halt.askers),
        ]

    # Control

    def presence(
        self, payload: bytes, client: str, asker: Asker | None, now: float, *, retained: bool
    ) -> list[Decision]:
        """Who holds a lease says that it is there. `client` is what the topic names: an access list guards that."""
        decisions = self.tick(now)
        try:
            refuse_retained(retained)
            said = read(Presence, payload)
            check_topic(client, said.client)
            self._intake.check_asker(asker, said.client)
        except RequestMalformed as error:
            return [*decisions, *self._refuse(told_id(payload), asker, error, now, "presence")]
        lease = self.leases.get(said.lease, client)
        if lease is None:
            over = NotInControl(f"The lease of {client} has ended, and its axes were stopped. Take control again.")
            return [*decisions, *self._refuse(said.id, asker, over, now, "presence")]
        lease.seen(said.sent, now)
        if asker is not None:
            decisions.append(self._say_holding(said.id, asker, lease, now))
        return decisions

    def gone(self, client: str, now: float) -> list[Decision]:
        """The last will of a client: its connection broke. `client` is what the topic names."""
        lease = self.leases.of(client)
        return [] if lease is None else self._lapse(lease, f"Control of {client} ended: its connection broke.", now)

    def cut_off(self, why: str, now: float) -> list[Decision]:
        """Nobody can be heard any more."""
        return [
            decision for lease in list(self.leases) for decision in self._lapse(lease, f"Control ended: {why}.", now)
        ]

    def tick(self, now: float) -> list[Decision]:
        """Whatever is due now."""
        decisions: list[Decision] = []
        for lease in list(self.leases):
            if lease.until <= now:
                why = f"Control of {lease.client} ended: it was silent for {lease.seconds:g} s."
                decisions += self._lapse(lease, why, now)
        while self._due and self._due[0][0] <= now:
            order = heapq.heappop(self._due)[2]
            if order.stage is Stage.WAITING:
                try:
                    check_age(order, now)
                except NotSent as error:
                    decisions += self._reject(order, error, now)
                else:
                    decisions += self._begin(order)
        return decisions

    def setpoint(self, name: str, payload: bytes, now: float, *, retained: bool) -> list[Decision]:
        """A set-point came in. Those that are refused are counted, not answered; what is malformed is told."""
        return [*self.tick(now), *self._setpoint(name, payload, now, retained)]

    def _setpoint(self, name: str, payload: bytes, now: float, retained: bool) -> list[Decision]:
        try:
            refuse_retained(retained)
            said = read(SetPoint, payload)
        except RequestMalformed as error:
            return self._refuse("", None, error, now, f"setpoint/{name}")
        lease = self.leases.get(said.lease, said.client)
        axes = self._axes.get(name, frozenset())
        held = lease is not None and bool(axes) and axes <= lease.axes
        until = self.streams.accept(name, said, now, held=held, stopped=self.stops.latest(axes))
        if until is None or lease is None:
            return []
        lease.seen(said.sent, now)
        return [SetTo(name, tuple(said.values), until)]

    # Inside

    def _known(self, order: Order, now: float) -> list[Decision] | None:
        """What is said to a request whose id is known; None for a new one."""
        asker = order.askers[0]
        earlier, refusal = self._orders.get(order.id), self._refusals.get(order.id, now)
        former = earlier or refusal
        if former is not None and former.digest != order.digest:
            return self._refuse(order.id, order.askers[0], used_before(order), now, order.name)
        if earlier is not None:
            if asker not in earlier.askers:
                earlier.askers.append(asker)
            return [] if earlier.begun is None else [Say(asker, earlier.begun)]
        return None if refusal is None else [Say(asker, refusal.answer)]

    def _check(self, order: Order, now: float) -> None:
        """Raise why an order must not be begun."""
        if order.cancelled is not None:
            raise order.cancelled
        check_age(order, now)
        lease = self.leases.check(order.lease, order.client, order.covered, f"{order.name} {order.verb}")
        self.stops.check(order)
        lease.seen(order.sent, now)

    def _begin(self, order: Order) -> list[Decision]:
        order.stage = Stage.BEGUN
        self.stops.moved(order.axes)
        if order.verb == "stream":
            assert isinstance(order.arguments, verbs.Stream)
            self.streams.open(order.id, order.name, order.arguments.timeout)
        return [Begin(order)]

    def _question(self, order: Order, now: float) -> list[Decision]:
        if order.verb == "time":
            return [Say(order.askers[0], Answer(id=order.id, outcome="done", value=now, now=now))]
        try:
            check_age(order, now)
            if isinstance(order.arguments, TakeControl):
                return self._take(order, order.arguments, now)
        except BusError as error:
            return self._refuse(order.id, order.askers[0], error, now, order.name)
        if isinstance(order.arguments, verbs.Cancel):
            return self._cancel(order, order.arguments.request, now)
        return self._release(order, now) if order.verb == "release_control" else [Ask(order)]

    def _cancel(self, asked: Order, request: str, now: float) -> list[Decision]:
        """Somebody ends one order. The others of its axes go on."""
        said = Say(asked.askers[0], Answer(id=asked.id, outcome="done", now=now))
        order = self._orders.get(request)
        if order is None or order.stage is Stage.SETTLING:
            return [said]
        cancelled = MoveCancelled(f"{order.name} {order.verb} was cancelled before it began. Nothing was done.")
        if order.stage is Stage.BEGUN:
            return [Cancel(order), said]
        if order.stage is Stage.WAITING:
            return [*self._reject(order, cancelled, now), said]
        order.cancelled = cancelled
        return [said]

    def _take(self, order: Order, wanted: TakeControl, now: float) -> list[Decision]:
        axes = self._intake.named(wanted.axes)
        self.leases.check_free(order.client, axes)
        mine = self.leases.of(order.client)
        if mine is not None and order.id in mine.asked:
            return [self._say_holding(order.id, order.askers[0], mine, now)]
        ended: list[Decision] = []
        if mine is not None and mine.number != order.lease:
            ended = self._lapse(mine, f"Control of {order.client} ended: it takes control anew.", now)
            mine = None
        new = axes - (mine.axes if mine is not None else set())
        lease = self.leases.take(order.client, axes, wanted.seconds, order.lease)
        lease.asked.add(order.id)
        lease.seen(order.sent, now)
        told = [_tell(axis, "control taken", f"{order.client} commands it.", now) for axis in sorted(new)]
        return [*ended, self._hold(), *told, self._say_holding(order.id, order.askers[0], lease, now)]

    @staticmethod
    def _say_holding(request: str, asker: Asker, lease: Lease, now: float) -> Say:
        return Say(asker, Answer(id=request, outcome="done", value=lease.told(), now=now))

    def _release(self, order: Order, now: float) -> list[Decision]:
        lease = self.leases.get(order.lease, order.client)
        if lease is None:
            return [Say(order.askers[0], Answer(id=order.id, outcome="done", now=now))]
        return self._lapse(lease, f"{order.client} has released control.", now, order.id, order.askers)

    def _lapse(
        self, lease: Lease, why: str, now: float, request: str = "", askers: Iterable[Asker] = ()
    ) -> list[Decision]:
        """A lease ends: what it covers is stopped."""
        self.leases.end(lease)
        axes = frozenset(lease.axes)
        self.stops.unsettled |= axes
        told = [_tell(axis, "control ended", why, now) for axis in sorted(axes)]
        return [*told, *self._halt(Halt(axes, why, id=request, askers=[(request, asker) for asker in askers]), now)]

    def _halt(self, halt: Halt, now: float) -> list[Decision]:
        """Axes are stopped: nothing older is begun after that."""
        self.stops.begun(halt, now)
        return [halt, *self._close(halt, now)]

    def _close(self, halt: Halt, now: float) -> list[Decision]:
        """What is under way on axes that are stopped ends, and what waits is not begun."""
        decisions: list[Decision] = []
        for order in list(self._orders.values()):
            if not order.axes & halt.axes:
                continue
            order.why = halt.why
            self.streams.close(order.id)
            if order.stage is Stage.WAITING:
                stopped = MoveCancelled(
                    f"{order.name} {order.verb}: it was stopped before this began. Nothing was done."
                )
                decisions += self._reject(order, stopped, now)
        return decisions

    def _reject(self, order: Order, error: Exception, now: float) -> list[Decision]:
        """An order that was stored is not begun."""
        order.why = ""
        answer = Answer(id=order.id, outcome="refused", error=trouble(error), now=now)
        order.stage, order.answer = Stage.SETTLING, answer
        return [Settle(order, answer)]

    def _drop(self, order: Order, now: float) -> list[Decision]:
        """An order that was not stored is refused. That is remembered until it would have expired anyway."""
        del self._orders[order.id]
        assert order.problem is not None
        answer = Answer(id=order.id, outcome="refused", error=trouble(order.problem), now=now)
        if order.expires > now:
            self._refusals.add(order.id, Refusal(order.digest, answer), order.expires)
        return [Say(asker, answer) for asker in order.askers]

    def _refuse(self, request: str, asker: Asker | None, error: Exception, now: float, topic: str) -> list[Decision]:
        answer = Answer(id=request, outcome=ending(error, begun=False), error=trouble(error), now=now)
        if asker is not None and self._intake.may_answer(asker):
            return [Say(asker, answer)]
        return [Refused(topic, answer)]

    def _hold(self) -> Hold:
        return Hold(self.stops.unsettled.union(*(lease.axes for lease in self.leases)))


def _tell(axis: str, event: str, what: str, now: float) -> Tell:
    return Tell(AxisEvent(at=now, axis=axis, event=event, what=what))
