"""What the desk decides: to be carried out, in this order."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import NamedTuple

from rs485bus.errors import BusError
from rs485bus.service.schema import Answer, AxisEvent
from rs485bus.service.verbs import Arguments


class Asker(NamedTuple):
    """Who waits for an answer."""

    topic: str
    """Where it is answered."""
    correlation: bytes
    """What the answer is told apart by."""


class Former(NamedTuple):
    """What was stored of an id before."""

    digest: str
    answer: Answer


class Stage(enum.Enum):
    """How far an order has come."""

    RECALLING = "recalling"
    """Its id is being looked up, and stored."""
    WAITING = "waiting"
    """For the time at which it is to begin."""
    BEGUN = "begun"
    SETTLING = "settling"
    """Its answer is being stored."""


@dataclass(eq=False)
class Order:
    """A verb that somebody asked for."""

    id: str
    client: str
    name: str
    """Of what: an axis, a group, a vehicle, or the plant."""
    verb: str
    arguments: Arguments
    axes: frozenset[str]
    """What it may move, and what ends it when it is stopped."""
    covered: frozenset[str]
    """What its lease must cover."""
    lease: int | None
    sent: float
    expires: float
    at: float | None
    digest: str
    """What it says: the same id with another digest is another request."""
    askers: list[Asker] = field(default_factory=list)
    stage: Stage = Stage.RECALLING
    problem: Exception | None = None
    """Why it must not be begun."""
    cancelled: BusError | None = None
    """Somebody wants it not to be begun."""
    why: str = ""
    """Why the service has ended it."""
    begun: Answer | None = None
    answer: Answer | None = None


@dataclass(frozen=True, slots=True)
class Recall:
    """Look the order's id up, and store it if `keep` and it is new. Then call `recalled`."""

    order: Order
    keep: bool


@dataclass(frozen=True, slots=True)
class Begin:
    """Carry an order out. Then call `began` and `ended`."""

    order: Order


@dataclass(frozen=True, slots=True)
class Cancel:
    """End an order that has begun."""

    order: Order


@dataclass(frozen=True, slots=True)
class Ask:
    """Answer a question."""

    order: Order


@dataclass(frozen=True, slots=True)
class Settle:
    """Store an answer. Then call `settled`."""

    order: Order
    answer: Answer


@dataclass(frozen=True, slots=True)
class Say:
    """Answer."""

    asker: Asker
    answer: Answer


@dataclass(frozen=True, slots=True, eq=False)
class Halt:
    """Stop some axes. Then call `halted`."""

    axes: frozenset[str]
    why: str
    emergency: bool = False
    id: str = ""
    """The request, if it was one."""
    askers: list[tuple[str, Asker]] = field(default_factory=list)
    """The requests that are answered when they stand, and who waits for that."""


@dataclass(frozen=True, slots=True)
class Hold:
    """Store which axes somebody commands: a service that is killed stops these when it is started again."""

    axes: frozenset[str]


@dataclass(frozen=True, slots=True)
class SetTo:
    """Give a stream a set-point, which holds until a time."""

    name: str
    values: tuple[float, ...]
    until: float


@dataclass(frozen=True, slots=True)
class Tell:
    """Something happened to an axis."""

    event: AxisEvent


@dataclass(frozen=True, slots=True)
class Refused:
    """Something was refused that cannot be answered."""

    topic: str
    answer: Answer


Decision = Recall | Begin | Cancel | Ask | Settle | Say | Halt | Hold | SetTo | Tell | Refused
