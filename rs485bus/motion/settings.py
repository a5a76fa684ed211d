"""Settings: tables say what there is, what it costs and how it is written; this carries it out, for all families."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, ParamSpec

from rs485bus.motion.plan import Ask, MustStand, Plan
from rs485bus.wire.frames import Request

P = ParamSpec("P")


class Cost(enum.Flag):
    """What it costs to change a setting."""

    KEPT = enum.auto()
    """The drive keeps it when it is switched off. That wears its flash: it is nothing for every cycle. The manual says
    so of the current and of the power-on run alone; the others are taken to be kept too."""
    STANDING = enum.auto()
    """The motor must stand, or `NotStanding` is raised."""
    SLOW = enum.auto()
    """It may be answered after 1.6 s, in which the pair is taken; refused while a watchdog on the bus is armed."""
    HOMING = enum.auto()
    """Limits count only after the next homing (5.3.2)."""


@dataclass(frozen=True, slots=True)
class Setting(Generic[P]):
    """One setting."""

    title: str
    section: str
    """Of the manual."""
    cost: Cost
    frames: Callable[P, list[Request]]
    """The requests that write it. Raises `LimitExceeded`, `NotSupported`."""


def written(title: str, cost: Cost, requests: Sequence[Request], slowest: float | None = None) -> Plan[None]:
    """Write a setting: each request as often as it takes, on a standing motor where it must stand.

    Args:
        title: names it in messages.
        cost: what it costs.
        requests: what writes it.
        slowest: seconds that the drive may take to answer, where it is slow; None for as long as usual.
    """
    if Cost.STANDING in cost:
        yield MustStand(title)
    for request in requests:
        yield Ask(request, reply_timeout=slowest if Cost.SLOW in cost else None)
