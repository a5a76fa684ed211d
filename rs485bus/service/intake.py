"""Reads what clients say. Pure."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping

from rs485bus.errors import NotSent, RequestMalformed
from rs485bus.service.decisions import Asker, Halt, Order
from rs485bus.service.schema import Request, Stop, read, told_id
from rs485bus.service.topics import PLANT, Topics
from rs485bus.service.verbs import Together, Verb, arguments

LONGEST_LIFE = 60.0
"""Seconds after which a request must have expired."""
_WORD = 60
"""Characters of somebody else's that are repeated in an answer."""
AHEAD = 0.05
"""Seconds by which a client's idea of the service's clock may be ahead of it."""


class Intake:
    """What the plant has, and what can be asked of it.

    Args:
        topics: those of the plant.
        axes: its axes, by the names that verbs can be said to: of axes, groups and vehicles.
        verb: what can be asked of a name; None for what cannot.
    """

    def __init__(
        self, topics: Topics, axes: Mapping[str, frozenset[str]], verb: Callable[[str, str], Verb | None]
    ) -> None:
        self._topics = topics
        self._axes = dict(axes)
        self._verb = verb

    def order(
        self, topic: str, payload: bytes, asker: Asker | None, now: float, *, retained: bool
    ) -> tuple[Order, Verb]:
        """A request, with its `problem` if it has one. Raises `RequestMalformed` for what is none."""
        if asker is None:
            raise RequestMalformed(
                "A request needs a response topic (MQTT 5), so that what becomes of it can be told. Nothing was done."
            )
        said = read(Request, payload)
        self.check_asker(asker, said.client)
        name, _, which = topic.partition("/")
        axes = self.named(self._axes if name == PLANT else [name])
        verb = self._verb(name, which)
        if verb is None:
            raise RequestMalformed(f"{name} has no verb {_short(which)}. Nothing was done.")
        if said.expires - said.sent > LONGEST_LIFE:
            raise RequestMalformed(f"It must expire within {LONGEST_LIFE:g} s after it was sent. Nothing was done.")
        if said.at is not None and said.at >= said.expires:
            raise RequestMalformed("It is to begin when it has expired. Nothing was done.")
        given = arguments(verb, said.args)
        if name == PLANT and isinstance(given, Together):
            axes = self.named(given.places)
        every = name == PLANT and not isinstance(given, Together)
        order = Order(
            said.id,
            said.client,
            name,
            which,
            given,
            axes,
            frozenset() if every else axes,
            said.lease,
            min(said.sent, now),
            min(said.expires, now + 2 * LONGEST_LIFE),  # what is refused is remembered until then
            said.at,
            _digest(topic, said),
            [asker],
        )
        order.problem = _problem(said, now, retained)
        return order, verb

    def halt(self, payload: bytes, asker: Asker | None, *, emergency: bool) -> Halt:
        """A stop. What cannot be understood stops all."""
        try:
            axes = self.named(read(Stop, payload).axes or self._axes)
        except RequestMalformed:
            axes = self.named(self._axes)
        why = "An emergency stop was asked for." if emergency else "A stop was asked for."
        request = told_id(payload)
        askers = [(request, asker)] if asker is not None and self.may_answer(asker) else []
        return Halt(axes, why, emergency, request, askers)

    def named(self, names: Iterable[str]) -> frozenset[str]:
        """The axes that names stand for. Raises `RequestMalformed` for a name that there is not."""
        axes: set[str] = set()
        for name in names:
            if name not in self._axes:
                raise RequestMalformed(f"There is no {_short(name)} here: {', '.join(self._axes)}. Nothing was done.")
            axes |= self._axes[name]
        return frozenset(axes)

    def check_asker(self, asker: Asker | None, client: str) -> None:
        """Raise `RequestMalformed` where a client wants to be answered elsewhere than where its answers go."""
        if asker is not None and asker.topic != self._topics.reply(client):
            raise RequestMalformed(f"The response topic of {client} is {self._topics.reply(client)}. Nothing was done.")

    def may_answer(self, asker: Asker | None) -> bool:
        """Whether that is where some client's answers go."""
        return asker is not None and self._topics.is_reply(asker.topic)


def check_age(order: Order, now: float) -> None:
    """Raise why a request is not of this time: `RequestMalformed` for one from the future, `NotSent` for a late one."""
    if order.problem is not None:
        raise order.problem
    if order.expires <= now:
        late = now - order.expires
        raise NotSent(f"{order.name} {order.verb} expired {late:.3f} s before it came in. Nothing was done.")


def _problem(said: Request, now: float, retained: bool) -> RequestMalformed | None:
    """Why a request must not be begun, which does not tell that it was not: it may have been said before, without being
    retained, or to a service whose clock was ahead."""
    try:
        refuse_retained(retained)
    except RequestMalformed as error:
        return error
    if said.sent <= now + AHEAD:
        return None
    return RequestMalformed(
        f"It was sent {said.sent - now:.3f} s from now, by the service's clock: ask the service for its time. "
        "Nothing was done."
    )


def refuse_retained(retained: bool) -> None:
    """Raise `RequestMalformed` for a retained message."""
    if retained:
        raise RequestMalformed(
            "It was published as a retained message, and would come again with every connection: publish it without "
            "retain. Nothing was done."
        )


def check_topic(named: str, client: str) -> None:
    """Raise `RequestMalformed` where the topic names another client than the message."""
    if named != client:
        raise RequestMalformed(f"The topic names {named}, and the message {client}. Nothing was done.")


def used_before(order: Order) -> RequestMalformed:
    """What is wrong with a request whose id was another one's."""
    return RequestMalformed(
        f"The id {order.id} was used for another request before: each needs an id of its own. Nothing was done."
    )


def _short(name: str) -> str:
    """What somebody else calls something, in quotes."""
    return repr(name if len(name) <= _WORD else f"{name[:_WORD]}...")


def _digest(topic: str, said: Request) -> str:
    fields = {"topic": topic, "client": said.client, "args": said.args, "at": said.at}
    return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()[:32]
