"""The topics of a served plant: `rs485bus/cell/axis/x/state`."""

from __future__ import annotations

import re
from dataclasses import dataclass

PREFIX = "rs485bus"
_NAME = re.compile(r"[A-Za-z0-9_.-]+")

PLANT = "plant"
"""What a request is about that is about no axis."""
VEHICLE = "vehicle"
"""What the vehicle of a plant is called."""


def level(what: str, name: str) -> str:
    """A name as a level of a topic. Raises `ValueError` for one that cannot be."""
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ValueError(f"{what} {name!r} cannot be part of a topic: letters, digits, '_', '.' and '-' are allowed")
    return name


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of one plant.

    Args:
        plant: its name.
        prefix: what stands before it; several levels are allowed.
    """

    plant: str
    prefix: str = PREFIX

    def __post_init__(self) -> None:
        level("the plant's name", self.plant)
        for part in self.prefix.split("/"):
            level("the prefix", part)

    @property
    def root(self) -> str:
        return f"{self.prefix}/{self.plant}"

    @property
    def service(self) -> str:
        """The description of the plant, retained."""
        return f"{self.root}/service"

    @property
    def stop(self) -> str:
        return f"{self.root}/stop"

    @property
    def emergency_stop(self) -> str:
        return f"{self.root}/emergency_stop"

    @property
    def refused(self) -> str:
        """What was refused and could not be answered."""
        return f"{self.root}/refused"

    def request(self, name: str, verb: str) -> str:
        return f"{self.root}/request/{name}/{verb}"

    def setpoint(self, name: str) -> str:
        return f"{self.root}/setpoint/{name}"

    def presence(self, client: str) -> str:
        return f"{self.root}/presence/{client}"

    def gone(self, client: str) -> str:
        return f"{self.root}/gone/{client}"

    def reply(self, client: str) -> str:
        return f"{self.root}/reply/{client}"

    def axis(self, name: str, what: str) -> str:
        """`state`, retained; `sample` or `event`."""
        return f"{self.root}/axis/{name}/{what}"

    def bus(self, name: str) -> str:
        """Load and errors of a bus, retained."""
        return f"{self.root}/bus/{name}/load"

    def traffic(self, name: str) -> str:
        """What happens on a bus, while somebody asks for it."""
        return f"{self.root}/bus/{name}/traffic"

    def parts(self, topic: str) -> list[str]:
        """The levels behind the plant's name; none for a topic of something else."""
        return topic[len(self.root) + 1 :].split("/") if topic.startswith(f"{self.root}/") else []

    def is_reply(self, topic: str) -> bool:
        """Whether a client may be answered there. The service may write to more than its clients may."""
        parts = self.parts(topic)
        return len(parts) == 2 and parts[0] == "reply" and _NAME.fullmatch(parts[1]) is not None
