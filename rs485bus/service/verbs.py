"""What can be asked of a served plant: the verbs and questions, with what they are given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, Strict, ValidationError

from rs485bus.errors import RequestMalformed
from rs485bus.service.schema import mistakes

Number = Annotated[float, Field(allow_inf_nan=False)]
Acceleration = Annotated[float, Strict(False), Field(gt=0)]
"""rpm/s. A jump is "Infinity", in quotation marks: JSON has no infinite numbers."""
LONGEST_LEASE = 60.0
LONGEST_SAMPLING = 60.0


class Arguments(BaseModel):
    """What a verb is given."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, ser_json_inf_nan="strings")


class Nothing(Arguments):
    """No arguments."""


class MoveTo(Arguments):
    position: Number
    rpm: Number | None = None
    acceleration: Acceleration | None = None


class MoveBy(Arguments):
    distance: Number
    rpm: Number | None = None
    acceleration: Acceleration | None = None


class Run(Arguments):
    rpm: Number
    acceleration: Acceleration | None = None
    duration: Number | None = None


class Together(Arguments):
    """Positions or distances of some axes of a group, by name."""

    places: dict[str, Number]
    duration: Number | None = None
    rpm: Number | None = None


class Drive(Arguments):
    v: Number
    omega: Number


class Stream(Arguments):
    timeout: Annotated[float, Field(gt=0, le=10)] = 0.25
    """Seconds for which a set-point holds."""


class EndStream(Arguments):
    stream: str


class Cancel(Arguments):
    request: str
    """What is to be ended."""


class TakeControl(Arguments):
    axes: list[str]
    """Axes, groups or vehicles."""
    seconds: Annotated[float, Field(ge=0.1, le=LONGEST_LEASE)] = 1.0
    """For how long the client may be silent."""


class Sampling(Arguments):
    every: Annotated[float, Field(ge=0.01, le=60)] = 0.05
    seconds: Annotated[float, Field(gt=0, le=LONGEST_SAMPLING)] = 10.0
    """For how long, unless it is asked for again."""


class ReadingAlong(Arguments):
    seconds: Annotated[float, Field(gt=0, le=LONGEST_SAMPLING)] = 10.0
    """For how long, unless it is asked for again."""


@dataclass(frozen=True, slots=True)
class Verb:
    """What can be asked."""

    arguments: type[Arguments] = Nothing
    leased: bool = True
    """It is done once, by who holds the lease of the axes; others are questions."""


AXIS = {
    "enable": Verb(),
    "disable": Verb(),
    "move_to": Verb(MoveTo),
    "move_by": Verb(MoveBy),
    "run": Verb(Run),
    "home": Verb(),
    "set_zero": Verb(),
    "stream": Verb(Stream),
    "end_stream": Verb(EndStream),
    "position": Verb(leased=False),
    "velocity": Verb(leased=False),
    "idle": Verb(leased=False),
    "status": Verb(leased=False),
    "sample": Verb(Sampling, leased=False),
}
GROUP = {
    "enable": Verb(),
    "disable": Verb(),
    "home": Verb(),
    "move_to": Verb(Together),
    "move_by": Verb(Together),
    "positions": Verb(leased=False),
}
VEHICLE = {
    "drive": Verb(Drive),
    "stream": Verb(Stream),
    "end_stream": Verb(EndStream),
}
PLANT = {
    "move_to": Verb(Together),
    "move_by": Verb(Together),
    "cancel": Verb(Cancel, leased=False),
    "clear_emergency_stop": Verb(),
    "take_control": Verb(TakeControl, leased=False),
    "release_control": Verb(leased=False),
    "time": Verb(leased=False),
    "traffic": Verb(ReadingAlong, leased=False),
}


def arguments(verb: Verb, given: dict[str, Any]) -> Arguments:
    """What a verb is given, checked.

    Raises:
        RequestMalformed: something is missing, unknown, or of a wrong type.
    """
    try:
        return verb.arguments.model_validate(given)
    except ValidationError as error:
        wrong = mistakes(error, "args.")
        raise RequestMalformed(f"The request is not what its schema says ({wrong}). Nothing was done.") from None
