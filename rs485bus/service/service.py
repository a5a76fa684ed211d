"""Serves a plant over a broker: carries out what the desk decides, and tells what becomes of it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
from typing import Any

import aiomqtt
from paho.mqtt.reasoncodes import ReasonCode

from rs485bus.errors import BrokerError
from rs485bus.service import discovery
from rs485bus.service.broker import NO_RETAINED, Broker, Client, asker_of, last_will, payload_of
from rs485bus.service.claim import Claim
from rs485bus.service.clock import Clock
from rs485bus.service.description import offline, online
from rs485bus.service.dispatcher import Dispatcher
from rs485bus.service.ledger import Ledger
from rs485bus.service.machine import Machine, Plant
from rs485bus.service.schema import Message, write
from rs485bus.service.topics import PREFIX, Topics

_log = logging.getLogger("rs485bus.service")

_PAUSES = (0.1, 0.2, 0.5, 1.0, 2.0)
"""Seconds before the broker is looked for again."""
_FAREWELL = 1.0
"""Seconds within which the broker takes it that the service ends."""


class Service:
    """One plant, served.

    Args:
        plant: an open plant.
        broker: where it is served.
        ledger: where the ids of requests are remembered.
        prefix: what its topics begin with.
        rate: how often the state of what moves is published, in Hz.
        home_assistant: have Home Assistant find states and stops.

    Raises:
        ValueError: a name of the plant cannot be served.
    """

    def __init__(
        self,
        plant: Plant,
        broker: Broker,
        ledger: Ledger,
        *,
        prefix: str = PREFIX,
        rate: float = 5.0,
        home_assistant: bool = False,
    ) -> None:
        self.topics = Topics(plant.name, prefix)
        self.session = secrets.token_hex(8)
        self._plant = plant
        self._broker = broker
        self._home_assistant = home_assistant
        self._machine = Machine(plant)
        self._dispatcher = Dispatcher(self._machine, ledger, Clock(), self.topics, self._publish, rate)
        self._description = online(self._machine, self.session)
        self._claim = Claim(self._description, str(broker), self.topics, self._publish)
        self._client: Client | None = None
        self.online = asyncio.Event()
        """Set while it is connected to the broker."""

    async def run(self) -> None:
        """Serve until cancelled. A broker that is lost is looked for again.

        Raises:
            BrokerError: the broker cannot be reached at first, or refuses; or the plant is served already.
        """
        await self._dispatcher.recover()
        served = False
        pause, told = 0, ""
        try:
            while True:
                try:
                    await self._serve()
                except BrokerError as error:
                    if not (served or self.online.is_set()):
                        raise
                    pause = 0 if self.online.is_set() else min(pause + 1, len(_PAUSES) - 1)
                    served = True
                    if str(error) != told:
                        _log.warning("%s The axes that somebody commanded are stopped.", error)
                    told = str(error)
                finally:
                    self._client = None
                    self.online.clear()
                    self._dispatcher.cut_off()
                await asyncio.sleep(_PAUSES[pause])
        finally:
            await self._dispatcher.leave()

    async def _serve(self) -> None:
        """Be online, until the broker is lost."""
        name = f"rs485bus-{self._plant.name}-{self.session}"
        gone = write(offline(self._plant.name, self.session))
        will = last_will(self.topics.service, gone, retain=True)
        async with self._broker.connect(name, will) as client, self._broker.connect(f"{name}-stops") as stops:
            await self._claim.take(client)
            self._client = client
            await stops.subscribe([(topic, NO_RETAINED) for topic in self._urgent])
            await client.subscribe([(topic, NO_RETAINED) for topic in self._usual])
            await self._help_find(client)
            self.online.set()
            _log.info("%s is served at %s", self._plant.name, self._broker)
            try:
                await self._listen_and_report(client, stops)
            except asyncio.CancelledError:
                await self._dispatcher.leave()
                with contextlib.suppress(aiomqtt.MqttError, BrokerError, TimeoutError):
                    async with asyncio.timeout(_FAREWELL):
                        await client.deliver(self.topics.service, gone, retain=True)
                raise

    async def _help_find(self, client: Client) -> None:
        """Have Home Assistant find the plant, if that is wanted."""
        if self._home_assistant:
            for topic, entry in discovery.entries(self.topics, self._description).items():
                await client.deliver(topic, entry, retain=True)

    async def _listen_and_report(self, client: Client, stops: Client) -> None:
        """Raise `BrokerError` once the broker is lost."""
        # No task group: it would take a cancellation for its own where the broker is lost in the same moment.
        work = (self._listen(client), self._listen(stops), self._dispatcher.reporter.run())
        tasks = [asyncio.create_task(part) for part in work]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        for task in done:
            task.result()

    @property
    def _usual(self) -> list[str]:
        return [self.topics.request("+", "+"), self.topics.setpoint("+")]

    @property
    def _urgent(self) -> list[str]:
        """What has a connection of its own, so that it overtakes everything else."""
        return [
            self.topics.stop,
            self.topics.emergency_stop,
            self.topics.presence("+"),
            self.topics.gone("+"),
        ]

    # What comes in

    async def _listen(self, client: Client) -> None:
        async for message in client.messages:
            if message.topic.value == self.topics.service:
                self._claim.look_at(message)
                continue
            parts = self.topics.parts(message.topic.value)
            self._dispatcher.hear(parts, payload_of(message), asker_of(message), retained=message.retain)

    # What goes out

    def _publish(self, topic: str, message: Message, **options: Any) -> None:
        """Publish, if there is a broker: what cannot be said now is asked for again."""
        client = self._client
        if client is None:
            return

        def taken(future: asyncio.Future[ReasonCode]) -> None:
            if not future.cancelled() and future.result().is_failure:
                _log.warning("%s", client.refusal(topic, future.result()))

        client.send(topic, write(message), **options).add_done_callback(taken)
