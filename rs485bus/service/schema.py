"""The messages between a served plant and its clients: typed JSON, version 1.

All times are seconds of the service's clock: Unix time when the service was started, and what has passed since then.
"""

from __future__ import annotations

import json
import re
from typing import Annotated, Any, ClassVar, Final, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rs485bus.errors import RequestMalformed

VERSION: Final = 1
LONGEST = 16_384
"""Bytes of the longest message that a client may send."""
_TOLD_AT_MOST = 5
"""Mistakes in a message that are named, of many."""
_ID = r"^[A-Za-z0-9._:-]+$"
_WORD = 60
"""Characters of what somebody else has written that are repeated in a message."""

Id = Annotated[str, Field(min_length=1, max_length=64, pattern=_ID)]
"""What names a request: a UUID, say. It is used once."""
Time = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Lease = Annotated[int, Field(ge=0, lt=2**53)]


class Message(BaseModel):
    """What all messages have."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    longest: ClassVar[float] = LONGEST

    v: Literal[1] = VERSION
    """The version of the schema."""


# From clients


class Request(Message):
    """A verb or a question. The topic says of what, and which: `request/x/move_to`."""

    id: Id
    """Said twice with the same id, it is done once."""
    client: Id
    """Who asks: the identifier of its connection to the broker."""
    lease: Lease | None = None
    """The number of the lease that covers the axes. A question needs none."""
    sent: Time
    """When it was sent, by the service's clock. What was sent before a stop is not begun after it."""
    expires: Time
    """From when on it must not be begun: at most a minute after it was sent."""
    at: Time | None = None
    """When it is to be begun; None for at once."""
    args: dict[str, Any] = {}
    """What the verb is given."""


class Stop(Message):
    """A stop. It needs no lease, and goes to the topic `stop` or `emergency_stop`."""

    id: Id
    client: Id
    axes: list[str] | None = None
    """Axes, groups or vehicles; None for all of the plant."""


class Presence(Message):
    """Who holds a lease is there."""

    id: Id
    client: Id
    lease: Lease
    sent: Time


class Gone(Message):
    """The last will of a client: it is gone. Its leases end at once."""

    client: Id


class SetPoint(Message):
    """What a stream is set to. Of several only the newest one counts."""

    stream: Id
    """The request that opened the stream."""
    client: Id
    lease: Lease
    sent: Time
    n: Annotated[int, Field(ge=0)]
    """Counts up within the stream. One that is overtaken by a newer one is dropped."""
    values: list[Annotated[float, Field(allow_inf_nan=False)]]
    """rpm of an axis; of a vehicle m/s ahead and rad/s."""


# From the service


class Told(Message):
    """What the service says. A later release may say more."""

    model_config = ConfigDict(extra="ignore", frozen=True, strict=False)

    longest: ClassVar[float] = float("inf")


class Trouble(Told):
    """Why something was not done: an exception of `rs485bus.errors`, by its name."""

    type: str
    message: str
    address: int | None = None
    attempts: int | None = None
    code: int | None = None
    request: str | None = None
    """The frame, as hex digits."""


class Answer(Told):
    """What became of a request."""

    id: str
    outcome: Literal["begun", "done", "refused", "failed", "unknown"]
    """"begun" comes before the others, and may be missing. "refused": nothing was done. "unknown": nobody knows whether
    it was done; the axis was stopped."""
    value: Any = None
    error: Trouble | None = None
    started: float | None = None
    """When its first frame was sent that starts a motor."""
    spread: float | None = None
    """Seconds between the first and the last of such frames, of a group."""
    now: float
    """The time, by the service's clock."""


class Holding(Told):
    """The state of a lease."""

    lease: int
    client: str
    axes: list[str]
    until: float
    """When it ends, unless the client shows that it is there."""
    seconds: float


class AxisReport(Told):
    """What is known of an axis. None stands for what is not known."""

    n: int
    """Counts up, in states and in samples: where one is missing, it was lost on the way."""
    at: float
    """When this was so."""
    position: float | None = None
    """In the axis' units."""
    rpm: float | None = None
    moving: bool | None = None
    enabled: bool | None = None
    fault: str = ""
    """What the drive reports, in words; empty if nothing is known of a fault."""
    stalled: bool = False
    limit: str = ""
    """The limit that is reached, in words."""
    lost: str = ""
    """Why positions are not to be trusted."""
    target: float | None = None
    verb: str | None = None
    """What it was told last that has not ended."""
    holder: str | None = None
    """Who holds its lease."""
    stop: str | None = None
    """The id of the latest stop."""
    watchdog: float | None = None
    """Seconds to which its drive's watchdog is armed; None where none is."""
    connected: bool = True
    """Whether its port is there."""
    latched: bool = False
    """Whether an emergency stop holds."""


class AxisEvent(Told):
    """Something that happened to an axis."""

    at: float
    axis: str
    event: str
    what: str
    """What happened, in words."""


class UnitReport(Told):
    """What one unit was asked since the service was started, and how it answered."""

    requests: int
    replies: int
    retries: int
    timeouts: int
    refusals: int
    crc_errors: int
    late_replies: int


class BusReport(Told):
    """Load and errors of a bus."""

    n: int
    at: float
    port: str
    baudrate: int = 115200
    parity: Literal["N", "E", "O"] = "N"
    stopbits: Literal[1, 2] = 1
    connected: bool
    latched: bool
    load: float
    """The share of the last interval in which bytes were on the pair."""
    transactions: int
    """Since the service was started."""
    units: dict[str, UnitReport]


class TrafficReport(Told):
    """What has happened on a bus, for who asked for its traffic."""

    before: int
    """Exchanges of this bus that were told before, or lost. Where one told less than this, some were lost."""
    lines: list[str]
    """Exchanges, as lines of a capture. Their times are the service's clock."""


class AxisFacts(Told):
    """What does not change of an axis."""

    family: str
    bus: str
    address: int = 0
    unit: str = "turns"
    """What its positions are called."""
    units_per_turn: float
    rpm: float
    acceleration: float
    limits: tuple[float, float] | None = None
    verbs: list[str]


class Description(Told):
    """The plant, and whether it is served. Retained; the last will of the service says that it is offline."""

    status: Literal["online", "offline"]
    session: str
    """Names this run of the service."""
    plant: str
    version: str = ""
    host: str = ""
    axes: dict[str, AxisFacts] = {}
    groups: dict[str, list[str]] = {}
    vehicles: dict[str, list[str]] = {}
    buses: list[str] = []


M = TypeVar("M", bound=Message)


def read(kind: type[M], payload: bytes | str) -> M:
    """A message.

    Raises:
        RequestMalformed: it is not what the schema says.
    """
    if len(payload) > kind.longest:
        raise RequestMalformed(
            f"The message has {len(payload)} bytes: {kind.longest:g} are allowed. It was not read. Nothing was done."
        )
    try:
        return kind.model_validate_json(payload)
    except ValidationError as error:
        raise RequestMalformed(_what_is_wrong(kind, payload, error)) from None


def write(message: Message) -> bytes:
    """A message as JSON."""
    return message.model_dump_json(exclude_none=True).encode()


def told_id(payload: bytes) -> str:
    """The id in a message that may be malformed; empty if none can be found."""
    told = _fields(payload).get("id")
    return told if isinstance(told, str) and len(told) <= 64 and re.fullmatch(_ID, told) else ""


def mistakes(error: ValidationError, where: str = "") -> str:
    """What is wrong, in words: the first few mistakes."""
    told = error.errors(include_url=False, include_context=False, include_input=False)
    named = [f"{where}{'.'.join(map(str, one['loc']))[:_WORD] or 'payload'}: {one['msg']}" for one in told]
    more = f"; and {len(named) - _TOLD_AT_MOST} more" if len(named) > _TOLD_AT_MOST else ""
    return "; ".join(named[:_TOLD_AT_MOST]) + more


def _fields(payload: bytes | str) -> dict[str, Any]:
    if len(payload) > LONGEST:
        return {}
    try:
        fields = json.loads(payload)
    except (ValueError, RecursionError):
        return {}
    return fields if isinstance(fields, dict) else {}


def _what_is_wrong(kind: type[Message], payload: bytes | str, error: ValidationError) -> str:
    told = _fields(payload).get("v", VERSION)
    if told != VERSION:
        return (
            f"The message is of version {repr(told)[:_WORD]} of the schema, and this side speaks version {VERSION}: "
            "install the same release of rs485bus on both sides. Nothing was done."
        )
    return f"{kind.__name__} is not what its schema says ({mistakes(error)}). Nothing was done."


def json_schema() -> dict[str, Any]:
    """The JSON schema of every message, by its name."""
    kinds: tuple[type[Message], ...] = (
        Request,
        Stop,
        Presence,
        Gone,
        SetPoint,
        Answer,
        Holding,
        AxisReport,
        AxisEvent,
        BusReport,
    )
    kinds += (TrafficReport, Description)
    return {kind.__name__: kind.model_json_schema() for kind in kinds}


if __name__ == "__main__":
    print(json.dumps(json_schema(), indent=2))
