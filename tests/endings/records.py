"""What a run is made of: what stands still, what happens, what was asked and what became of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rs485bus.bus.schedule.job import Job, Outcome
from tests.endings.cable import Sent

REPLY_TIMEOUT = 0.03
RETRIES = 2
MEMORY = 12
"""The address of the slave that holds what was written to it."""
NEVER = float("inf")


class Boom(Exception):
    """What the application's own functions raise."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What stands still during a run."""

    baudrate: int = 115_200
    gateway: bool = False
    echo: str = ""
    echo_config: Any = "auto"
    latency: float = 0.0
    by_silence: bool = True
    drives: int = 2
    slaves: int = 2
    missing: int = 1
    answers_broadcasts: bool = False
    lying: bool = False
    """The drives' status says that they stand while they turn, and the other way round."""
    raising: bool = False
    """Some of the application's own functions raise."""


@dataclass(frozen=True, slots=True)
class Step:
    """After so many seconds, do that."""

    after: float
    name: str
    args: tuple[Any, ...] = ()


@dataclass(eq=False)
class Asked:
    """A job, and what became of it."""

    job: Job
    number: int
    at: float
    ends: int = 0
    ended_at: float = NEVER
    outcome: Outcome | None = None
    cancelled_at: float = NEVER
    sent: list[Sent] | None = None
    attempts: int = 0
    raises: bool = False
    waited_for: int = 0
    """How many others were open during its time."""


@dataclass(eq=False)
class Stop:
    """A stop that was asked for."""

    address: int
    at: float
    told: list[tuple[float, bool]]
    was_latest: bool = True
