"""Carries out what the desk decides, and tells the desk what became of it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any

from rs485bus.errors import BusError
from rs485bus.service.broker import answering
from rs485bus.service.clerk import Clerk
from rs485bus.service.clock import Clock
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
    Tell,
)
from rs485bus.service.desk import Desk
from rs485bus.service.ledger import Ledger
from rs485bus.service.machine import Machine, Performance
from rs485bus.service.reporter import Reporter
from rs485bus.service.schema import Answer
from rs485bus.service.topics import Topics
from rs485bus.service.troubles import ending, trouble
from rs485bus.service.verbs import ReadingAlong, Sampling

_log = logging.getLogger("rs485bus.service")


class Dispatcher:
    """Between the messages, the desk, the ledger and the plant.

    Args:
        machine: the plant.
        ledger: where the ids of requests are remembered.
        clock: the service's.
        topics: the plant's.
        publish: publishes a message, if there is a broker.
        rate: how often the state of what moves is published, in Hz.
    """

    def __init__(
        self,
        machine: Machine,
        ledger: Ledger,
        clock: Clock,
        topics: Topics,
        publish: Callable[..., None],
        rate: float,
    ) -> None:
        self._machine = machine
        self._ledger = ledger
        self._clock = clock
        self._topics = topics
        self._publish = publish
        self._clerk = Clerk(ledger)
        self._desk = Desk(topics, machine.names, machine.verb)
        self.reporter = Reporter(machine.plant, self._desk, clock, topics, publish, rate)
        self._performances: dict[str, Performance] = {}
        """What is being carried out, by request."""
        self._questions: dict[tuple[str, str], list[Order]] = {}
        """The questions of which one is being asked, and those that wait for its end."""
        self._alarm: asyncio.TimerHandle | None = None
        self._tasks: set[asyncio.Task[Any]] = set()

    async def recover(self) -> None:
        """Stop what the service that ran last has left under somebody's command."""
        unknown, axes = await asyncio.to_thread(self._ledger.recover)
        if unknown:
            _log.warning("%d requests of the service that ran last have become unknown", unknown)
        held = axes & set(self._machine.plant.axes)
        if held:
            _log.warning("the service that ran last did not end well: %s are stopped", ", ".join(sorted(held)))
            await self._stop(Halt(frozenset(held), "The service was started again."))

    def hear(self, parts: list[str], payload: bytes, asker: Asker | None, *, retained: bool) -> None:
        """A message came in. `parts` are the levels of its topic."""
        try:
            self._hear(parts, payload, asker, self._clock.now(), retained)
        except Exception:  # no message ends who serves
            _log.exception("a message to %s could not be dealt with", "/".join(parts))
            if parts in (["stop"], ["emergency_stop"]):
                self._carry_out(self._desk.stop(b"", None, self._clock.now(), emergency=parts == ["emergency_stop"]))

    def _hear(self, parts: list[str], payload: bytes, asker: Asker | None, now: float, retained: bool) -> None:
        match parts:
            case ["stop"]:
                decisions = self._desk.stop(payload, asker, now)
            case ["emergency_stop"]:
                decisions = self._desk.stop(payload, asker, now, emergency=True)
            case ["gone", client]:
                decisions = self._desk.gone(client, now)
            case ["presence", client]:
                decisions = self._desk.presence(payload, client, asker, now, retained=retained)
            case ["request", name, verb]:
                decisions = self._desk.request(f"{name}/{verb}", payload, asker, now, retained=retained)
            case ["setpoint", name]:
                decisions = self._desk.setpoint(name, payload, now, retained=retained)
            case _:
                return
        self._carry_out(decisions)

    def cut_off(self, why: str = "the service has lost the broker") -> None:
        """Nobody can be heard: nobody commands anything any more."""
        self._carry_out(self._desk.cut_off(why, self._clock.now()))

    async def leave(self) -> None:
        """The service ends: what somebody commanded is stopped first, and whoever asked is answered."""
        self.cut_off("the service was ended")
        if self._alarm is not None:
            self._alarm.cancel()
        while self._tasks:
            await asyncio.wait(self._tasks)
        await self._clerk.drain()

    # Inside

    def _carry_out(self, decisions: list[Decision]) -> None:
        for decision in decisions:
            try:
                self._carry_out_one(decision)
            except Exception:  # the next one may be a stop
                _log.exception("%s could not be carried out", type(decision).__name__)
        self._set_alarm()

    def _carry_out_one(self, decision: Decision) -> None:
        match decision:
            case Halt():
                self._spawn(self._stop(decision))
            case Begin(order):
                self._begin(order)
            case SetTo(name, values, until):
                self._machine.set_to(name, values, until - self._clock.now())
            case Recall(order, keep):
                self._recall(order, keep)
            case Settle(order, answer):
                self._settle(order, answer)
            case Hold(axes):
                self._clerk.write(partial(Ledger.hold, axes=axes), _nothing)
            case Say(asker, answer):
                self._publish(asker.topic, answer, properties=answering(asker))
            case Cancel(order):
                self._performances[order.id].cancel()
            case Ask(order):
                self._ask(order)
            case Tell(event):
                self.reporter.touch(frozenset({event.axis}))
                self._publish(self._topics.axis(event.axis, "event"), event)
            case Refused(topic, answer):
                _log.warning("%s was refused: %s", topic, answer.error.message if answer.error else "")
                self._publish(self._topics.refused, answer)

    def _recall(self, order: Order, keep: bool) -> None:
        def recalled(former: Former | None, error: Exception | None) -> None:
            now = self._clock.now()
            if error is not None:
                self._carry_out(self._desk.not_stored(order, f"The ledger cannot be written ({error})", now))
            else:
                self._carry_out(self._desk.recalled(order, former, now))

        keeping = partial(Ledger.store, request=order.id, digest=order.digest, axes=order.axes)
        self._clerk.write(keeping if keep else partial(Ledger.look_up, request=order.id), recalled)

    def _settle(self, order: Order, answer: Answer) -> None:
        # One that cannot be stored is told all the same.
        self._clerk.write(
            partial(Ledger.settle, request=order.id, answer=answer),
            lambda result, error: self._carry_out(self._desk.settled(order)),
        )

    def _begin(self, order: Order) -> None:
        try:
            performance = self._machine.begin(order)
        except Exception as error:
            self._carry_out(self._desk.ended(order, self._failed(order, error, begun=False)))
            return
        self._performances[order.id] = performance
        self.reporter.began(order, performance)
        begun = Answer(id=order.id, outcome="begun", now=self._clock.now())
        self._carry_out(self._desk.began(order, begun))
        self._spawn(self._see_through(order, performance))

    async def _see_through(self, order: Order, performance: Performance) -> None:
        try:
            value = await performance.wait()
        except Exception as error:
            answer = self._failed(order, error, begun=True)
        else:
            answer = Answer(id=order.id, outcome="done", value=value, now=self._clock.now())
        self._performances.pop(order.id, None)
        starts = performance.starts()
        if starts:
            answer = answer.model_copy(
                update={"started": self._clock.of_loop(min(starts)), "spread": max(starts) - min(starts)}
            )
        self._carry_out(self._desk.ended(order, answer))
        self.reporter.touch(order.axes)

    def _failed(self, order: Order, error: Exception, *, begun: bool) -> Answer:
        if not isinstance(error, BusError | ValueError | TypeError):
            _log.error("%s %s failed", order.name, order.verb, exc_info=error)
        return Answer(id=order.id, outcome=ending(error, begun=begun), error=trouble(error), now=self._clock.now())

    def _ask(self, order: Order) -> None:
        """Answer a question. Of each question one is asked at a time, and answers all that came in before it began."""
        if isinstance(order.arguments, Sampling | ReadingAlong):
            value = self.reporter.subscribe(order)
            self._answer([order], Answer(id="", outcome="done", value=value, now=self._clock.now()))
            return
        waiting = self._questions.get((order.name, order.verb))
        if waiting is not None:
            waiting.append(order)
            return
        self._questions[order.name, order.verb] = [order]
        self._spawn(self._ask_all(order.name, order.verb))

    async def _ask_all(self, name: str, question: str) -> None:
        while orders := self._questions[name, question]:
            self._questions[name, question] = []
            try:
                value = await self._machine.ask(orders[0])
                answer = Answer(id="", outcome="done", value=value, now=self._clock.now())
            except Exception as error:
                answer = self._failed(orders[0], error, begun=True)
            self._answer(orders, answer)
        del self._questions[name, question]

    def _answer(self, orders: list[Order], answer: Answer) -> None:
        for order in orders:
            for asker in order.askers:
                told = answer.model_copy(update={"id": order.id})
                self._publish(asker.topic, told, properties=answering(asker))

    def _stop(self, halt: Halt) -> Coroutine[Any, Any, None]:
        """Stop axes at once; what is returned tells the desk whether they stand."""
        standing = self._machine.halt(halt)

        async def confirm() -> None:
            error: Exception | None = None
            try:
                await standing
            except Exception as failed:
                _log.error("%s: %s", halt.why, failed)
                error = failed
            self._carry_out(self._desk.halted(halt, error, self._clock.now()))

        return confirm()

    def _spawn(self, coroutine: Coroutine[Any, Any, Any]) -> None:
        task = asyncio.create_task(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _set_alarm(self) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None
        wake = self._desk.wake
        if wake != float("inf"):
            self._alarm = asyncio.get_running_loop().call_later(wake - self._clock.now(), self._tick)

    def _tick(self) -> None:
        self._carry_out(self._desk.tick(self._clock.now()))


def _nothing(result: Any, error: Exception | None) -> None:
    """Nobody waits for it."""
