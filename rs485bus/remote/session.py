"""The connection of a client to a served plant: it asks, is answered, and comes back when the broker does."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
from collections.abc import Callable
from typing import Any

import aiomqtt
from paho.mqtt.reasoncodes import ReasonCode

from rs485bus.bus.handle import Handle, start_task
from rs485bus.errors import BrokerError, RequestMalformed
from rs485bus.remote.clock import RemoteClock
from rs485bus.remote.handles import RemoteMove
from rs485bus.remote.requests import Pending, PendingRequests
from rs485bus.service.broker import NO_RETAINED, WITH_RETAINED, Broker, Client, asking, last_will, payload_of
from rs485bus.service.decisions import Asker
from rs485bus.service.schema import (
    Answer,
    AxisEvent,
    AxisReport,
    BusReport,
    Description,
    Gone,
    Message,
    Request,
    TrafficReport,
    read,
    write,
)
from rs485bus.service.topics import PLANT, Topics

_log = logging.getLogger("rs485bus.remote")

_PAUSES = (0.05, 0.1, 0.2, 0.5, 1.0)
_BRIEF = 2.0
_BRIEF_IN_A_ROW = 5
"""Connections that are lost within `_BRIEF` seconds, one after another, after which it does not come back."""
_LONGEST = 50.0
"""Seconds for which a question may be answered, at most."""
_LOOK = 0.25
"""Seconds between two looks for what is to be said again."""
_TIMES = 3
"""How often the service is asked for its time at first."""
_FOUND = 1.5
"""Seconds within which the broker tells that there is the plant."""


class Session:
    """One client of one plant.

    Args:
        broker: where the plant is served.
        topics: its topics.
        client: the name of the client, which nobody else has.
        patience: seconds within which something must be heard of a request.
    """

    def __init__(self, broker: Broker, topics: Topics, client: str, patience: float) -> None:
        self.broker = broker
        self.topics = topics
        self.client = client
        self.clock = RemoteClock()
        self.requests = PendingRequests(patience)
        self.plant: Description | None = None
        self.changed = False
        """The service was started again with another plant than the one that this client was made for."""
        self.reports: dict[str, AxisReport] = {}
        self.buses: dict[str, BusReport] = {}
        self.on_report: list[Callable[[str, AxisReport], None]] = []
        """Told of states and samples."""
        self.on_state: list[Callable[[str, AxisReport], None]] = []
        self.on_event: list[Callable[[AxisEvent], None]] = []
        self.on_traffic: list[Callable[[str, TrafficReport], None]] = []
        """Told of what happens on the buses, by name; it comes once `hear_traffic` was called."""
        self.on_lost: list[Callable[[], None]] = []
        self.connected = asyncio.Event()
        self._hears_traffic = False
        self._loop = asyncio.get_running_loop()
        self._mqtt: Client | None = None
        self._found = asyncio.Event()
        self._trouble: Exception | None = None
        self._task: asyncio.Task[None] | None = None
        self._repeating: asyncio.Task[None] | None = None
        self._connected_at = float("-inf")
        self._over: BrokerError | None = None
        """Why it does not come back."""

    def now(self) -> float:
        """The service's clock, at the earliest."""
        return self.clock.now(self._loop.time())

    @property
    def served(self) -> bool:
        """Whether the plant is served, as far as is known. Where it is not, nobody commands it."""
        return self.plant is not None and self.plant.status == "online"

    async def open(self) -> None:
        """Connect, and find the plant.

        Raises:
            BrokerError: the broker cannot be reached or refuses, or nobody serves the plant.
            RequestMalformed: the service speaks another version of the schema.
        """
        first: asyncio.Future[None] = self._loop.create_future()
        self._task = start_task(self._keep(first), name=f"rs485bus remote {self.client}")
        self._repeating = start_task(self._repeat_forever(), name=f"rs485bus remote {self.client} again")
        try:
            await first
            await self._find()
            for _ in range(_TIMES):  # a single one may have been late
                await self.ask(PLANT, "time", {}, f"the time of {self.topics.plant}").wait()
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        """Close the connection. What is not answered by then is unknown."""
        task, self._task = self._task, None
        if self._repeating is not None:
            self._repeating.cancel()
        if task is not None:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError, BrokerError):
                await task
        self.requests.give_up("the connection was closed.")

    # What goes out

    def ask(
        self,
        name: str,
        verb: str,
        arguments: dict[str, Any],
        what: str,
        *,
        once: bool = False,
        lease: int | None = None,
        life: float | None = None,
        at: float | None = None,
        handle: Handle[Any] | None = None,
        request: str | None = None,
    ) -> Handle[Any]:
        """Send a request. What is returned ends with its answer: the value, or what was raised.

        A question may be answered as long as somebody waits; a verb says within how many seconds it must be begun.
        """
        life = min(self.requests.patience, _LONGEST) if life is None else life
        request = request or new_id()
        asked = self._loop.time()

        def make() -> Request:
            sent = self.clock.now(asked)
            return Request(
                id=request, client=self.client, lease=lease, sent=sent, expires=sent + life, at=at, args=arguments
            )

        timeless = (name, verb) == (PLANT, "time")
        topic = self.topics.request(name, verb)
        return self.say(topic, request, make, what, once=once, life=life, handle=handle, timeless=timeless)

    def say(
        self,
        topic: str,
        request: str,
        make: Callable[[], Message],
        what: str,
        *,
        once: bool = False,
        life: float = 2.0,
        handle: Handle[Any] | None = None,
        timeless: bool = False,
    ) -> Handle[Any]:
        """Send a message that is answered. Unless it is `timeless`, it waits until the service's time is known."""
        waiting: Handle[Any] = handle or Handle(what)

        def ended(answer: Answer | None, error: Exception | None) -> None:
            if error is not None:
                waiting.fail(error)
            else:
                waiting.finish(None if answer is None else answer.value)

        pending = Pending(request, what, topic, lambda: write(make()), once, life, ended, asked=self._loop.time())
        pending.timeless = timeless
        if isinstance(waiting, RemoteMove):
            pending.told = waiting.told
        if self._over is not None:
            ended(None, self._over)
            return waiting
        self.requests.add(pending)
        self._send(pending)
        return waiting

    def put(self, topic: str, message: Message) -> None:
        """Send a message that is not answered, and may be lost."""
        if self._mqtt is not None:
            self._mqtt.send(topic, write(message), qos=0)

    async def hear_traffic(self) -> None:
        """Have the broker hand on what happens on the buses, from now on."""
        self._hears_traffic = True
        if self._mqtt is not None:
            await self._subscribe_to_traffic(self._mqtt)

    async def _subscribe_to_traffic(self, client: Client) -> None:
        await client.subscribe(self.topics.traffic("+"), options=NO_RETAINED)

    def _send(self, pending: Pending) -> None:
        client = self._mqtt
        if client is None or not (pending.timeless or self.clock.known):
            return
        pending.payload = pending.payload or pending.make()
        asker = Asker(self.topics.reply(self.client), pending.id.encode())

        def taken(future: asyncio.Future[ReasonCode]) -> None:
            if not future.cancelled() and future.result().is_failure:
                error = BrokerError(f"{pending.what}: {client.refusal(pending.topic, future.result())}")
                self.requests.refused(pending, error)

        sent = client.send(pending.topic, pending.payload, properties=asking(asker, pending.life))
        self.requests.sent(pending, self._loop.time())
        sent.add_done_callback(taken)

    # The connection

    async def _keep(self, first: asyncio.Future[None]) -> None:
        attempt, told, brief = 0, "", 0
        while True:
            self._connected_at = float("-inf")
            try:
                await self._connect(first)
            except BrokerError as error:
                if not first.done():
                    first.set_exception(error)
                    return
                brief = brief + 1 if self._loop.time() - self._connected_at < _BRIEF else 0
                if brief == _BRIEF_IN_A_ROW:
                    self._end(error)
                    return
                attempt = 0 if self.connected.is_set() else min(attempt + 1, len(_PAUSES) - 1)
                if str(error) != told:
                    _log.warning("%s", error)
                told = str(error)
            finally:
                self._mqtt = None
                if self.connected.is_set():
                    self.connected.clear()
                    for callback in self.on_lost:
                        callback()
            await asyncio.sleep(_PAUSES[attempt])

    def _end(self, error: BrokerError) -> None:
        """Do not come back: it would go on like that, and two clients of one name would cut each other off for ever."""
        self._over = BrokerError(
            f"{error} That was {_BRIEF_IN_A_ROW} times within {_BRIEF:g} s after it was made: is another client called "
            f"{self.client}, too? Give each a name of its own, and connect anew."
        )
        _log.error("%s", self._over)
        self.requests.give_up(str(self._over))

    async def _connect(self, first: asyncio.Future[None]) -> None:
        topics = self.topics
        will = last_will(topics.gone(self.client), write(Gone(client=self.client)))
        async with self.broker.connect(self.client, will) as client:
            own = [(topics.reply(self.client), NO_RETAINED)]
            told = [topics.service, topics.axis("+", "state"), topics.axis("+", "event"), topics.bus("+")]
            await client.subscribe([*own, *((topic, WITH_RETAINED) for topic in told)])
            await client.subscribe(topics.axis("+", "sample"), options=NO_RETAINED)
            if self._hears_traffic:
                await self._subscribe_to_traffic(client)
            self._mqtt = client
            self._connected_at = self._loop.time()
            self.connected.set()
            if not first.done():
                first.set_result(None)
            self._repeat(anew=True)
            async for message in client.messages:
                self._hear(message)

    async def _repeat_forever(self) -> None:
        while True:
            await asyncio.sleep(_LOOK)
            self._repeat()

    def _repeat(self, *, anew: bool = False) -> None:
        """Say again what was not heard of."""
        for pending in self.requests.due(self._loop.time(), anew=anew):
            self._send(pending)

    async def _find(self) -> None:
        """Wait until the broker has told of the plant."""
        name, where = self.topics.plant, self.broker
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_FOUND):
                await self._found.wait()
        if self._trouble is not None:
            raise self._trouble
        if self.plant is None:
            others = await self._others()
            served = (
                f"Served there: {', '.join(others)}." if others else "Nothing is served there that this client sees."
            )
            raise BrokerError(f"There is no plant {name!r} at {where}. {served} Start it: rs485bus serve plant.toml")
        if self.plant.status == "offline":
            raise BrokerError(
                f"The plant {name!r} was served at {where}, and is offline now. Start it: rs485bus serve plant.toml"
            )

    async def _others(self) -> list[str]:
        """The plants that are served."""
        names = set()
        async with self.broker.connect(f"{self.client}-looking") as client:
            await client.subscribe(f"{self.topics.prefix}/+/service", options=WITH_RETAINED)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(0.3):
                    async for message in client.messages:
                        with contextlib.suppress(RequestMalformed):
                            told = read(Description, payload_of(message))
                            if told.status == "online":
                                names.add(told.plant)
        return sorted(names)

    # What comes in

    def _hear(self, message: aiomqtt.Message) -> None:
        try:
            self._take(self.topics.parts(message.topic.value), payload_of(message))
        except RequestMalformed as error:
            if self._trouble is None:
                self._trouble = error
                _log.error("%s: %s", message.topic, error)
            if not self._found.is_set() and message.topic.value == self.topics.service:
                self._found.set()
        except Exception:  # of who is told of reports and events, say: the connection outlives it
            _log.exception("a message at %s could not be dealt with", message.topic)

    def _take(self, parts: list[str], payload: bytes) -> None:
        match parts:
            case ["reply", _]:
                self._answered(read(Answer, payload))
            case ["axis", name, "state" | "sample" as what]:
                report = read(AxisReport, payload)
                self.reports[name] = report
                for tell in (*self.on_report, *(self.on_state if what == "state" else ())):
                    tell(name, report)
            case ["axis", _, "event"]:
                event = read(AxisEvent, payload)
                for tell_event in tuple(self.on_event):
                    tell_event(event)
            case ["bus", name, "load"]:
                self.buses[name] = read(BusReport, payload)
            case ["bus", name, "traffic"]:
                traffic = read(TrafficReport, payload)
                for tell_traffic in tuple(self.on_traffic):
                    tell_traffic(name, traffic)
            case ["service"]:
                self._described(read(Description, payload))

    def _answered(self, answer: Answer) -> None:
        now = self._loop.time()
        pending = self.requests.get(answer.id)
        if pending is not None:
            # What became of a verb may have been stored before the service was started again.
            waited = not self.clock.known
            self.clock.learn(answer.now, None if pending.once else pending.first_sent, now)
            if waited:
                self._repeat()
        self.requests.answered(answer, now)

    def _described(self, told: Description) -> None:
        former = self.plant
        if told.status == "offline" and former is not None:
            told = former.model_copy(update={"status": "offline"})  # what there is is known still
        self.plant = told
        self._trouble = None
        if told.status == "online":
            if former is not None and former.session != told.session:
                self.changed |= _facts(former) != _facts(told)
                self.clock.reset()
                self.ask(PLANT, "time", {}, f"the time of {self.topics.plant}").seen = True
            self._found.set()
            self._repeat(anew=True)  # what was said while it was not there has reached nobody
        elif former is None:
            self._loop.call_later(_FOUND / 2, self._found.set)  # it may be about to come back


def _facts(plant: Description) -> object:
    """What a client relies on: an axis whose unit has become another one would go somewhere else."""
    return plant.axes, plant.groups, plant.vehicles


def new_id() -> str:
    """The id of a request: no other one has it."""
    return secrets.token_hex(12)
