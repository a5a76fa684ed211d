"""A plant is served by one service: two would not know of each other, and do everything twice."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import aiomqtt

from rs485bus.errors import BrokerError, RequestMalformed
from rs485bus.service.broker import KEEPALIVE, NO_RETAINED, WITH_RETAINED, Client, asking, payload_of
from rs485bus.service.decisions import Asker
from rs485bus.service.schema import Description, Request, read, write
from rs485bus.service.topics import PLANT, Topics

_log = logging.getLogger("rs485bus.service")

_FORMER = 0.3
"""Seconds within which the broker tells that the plant is served already."""
_PAUSE = 0.3
"""Seconds after which a service says anew what somebody else has replaced."""
_DEAD = 2.0 * KEEPALIVE
"""Seconds within which the broker notices that a service is gone."""
_ASKED = 1.0
"""Seconds after which a service is asked again whether it is there."""
_RETURN = 5.0
"""Seconds within which the broker must tell the service what the service has said."""


class Claim:
    """One service's claim to one plant.

    Args:
        description: what it says of itself and of the plant.
        where: the broker, for messages.
        topics: the plant's.
        publish: publishes a message, if there is a broker.
    """

    def __init__(self, description: Description, where: str, topics: Topics, publish: Callable[..., None]) -> None:
        self._mine = description
        self._where = where
        self._topics = topics
        self._publish = publish
        self._again: asyncio.TimerHandle | None = None
        self._rivals: set[str] = set()
        """Sessions of others that have said so while this one served."""

    async def take(self, client: Client) -> None:
        """Say that the plant is served here. Of several services that say so at once, the first one has it: the broker
        tells all of them in the same order.

        Raises:
            BrokerError: another service has it; or the broker does not tell.
        """
        await client.subscribe(self._topics.service, options=WITH_RETAINED)
        await self._wait_for_the_former(client)
        await client.deliver(self._topics.service, write(self._mine), retain=True)
        other: Description | None = None
        while True:
            message = await client.next_message(_RETURN)
            if message is None:
                raise BrokerError(
                    f"The broker {self._where} does not tell what is said at {self._topics.service}: its access "
                    "control list must let the service read that, too."
                )
            told = _described(message)
            if self._is_mine(told):
                break
            if told is not None and told.status == "online":
                other = told
            elif told is not None and other is not None and told.session == other.session:
                other = None
        if other is not None:
            raise self._taken(other)

    def look_at(self, message: aiomqtt.Message) -> None:
        """Something was said of the plant. What somebody else says, a service that came later say, is replaced after a
        while. Of two services that both go on saying it, one gives way.

        Raises:
            BrokerError: this one does.
        """
        told = _described(message)
        if told is not None and told.session != self._mine.session and told.status == "online":
            # One that came too late says it once, and leaves.
            if told.session in self._rivals and told.session < self._mine.session:
                raise self._taken(told)
            self._rivals.add(told.session)
        if not self._is_mine(told) and self._again is None:
            who = f"{told.host or 'somebody'}, session {told.session}" if told is not None else "somebody"
            _log.warning("%s says at %s what this plant is: this service says it anew", who, self._where)
            self._again = asyncio.get_running_loop().call_later(_PAUSE, self._say_again)

    def _say_again(self) -> None:
        self._again = None
        self._publish(self._topics.service, self._mine, retain=True)

    async def _wait_for_the_former(self, client: Client) -> None:
        """Raise `BrokerError` where another service serves this plant. One that only seems to, because the broker was
        killed together with it, neither answers nor goes offline."""
        former = await client.next_message(_FORMER)
        other = None if former is None else _described(former)
        if other is None or other.status == "offline" or other.session == self._mine.session:
            return
        reply = self._topics.reply(self._mine.session)
        await client.subscribe(reply, options=NO_RETAINED)
        question = Request(id=self._mine.session, client=self._mine.session, sent=0.0, expires=1.0)
        loop = asyncio.get_running_loop()
        give_up, ask_at = loop.time() + _DEAD, loop.time()
        while loop.time() < give_up:
            if loop.time() >= ask_at:
                ask_at = loop.time() + _ASKED
                asked = self._topics.request(PLANT, "time")
                await client.deliver(asked, write(question), properties=asking(Asker(reply, b""), _ASKED))
            message = await client.next_message(max(0.0, ask_at - loop.time()))
            if message is None:
                continue
            if message.topic.value == reply:
                raise self._taken(other)
            told = _described(message)
            if told is None or (told.session, told.status) == (other.session, "offline"):
                return
        _log.warning("the service at %s that served %s does not answer: it is gone", other.host, self._mine.plant)

    def _is_mine(self, told: Description | None) -> bool:
        return told is not None and (told.session, told.status) == (self._mine.session, "online")

    def _taken(self, other: Description) -> BrokerError:
        return BrokerError(
            f"The plant {self._mine.plant} is served at {self._where} already, by {other.host}: two would not know of "
            "each other. Stop that one, or give this plant another name."
        )


def _described(message: aiomqtt.Message) -> Description | None:
    try:
        return read(Description, payload_of(message))
    except RequestMalformed:
        return None
