"""A command that sets an axis in motion, while it is carried out."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.motion.move import Move
from rs485bus.motion.plan import Ended

if TYPE_CHECKING:
    from rs485bus.motion.carrier import PlanCarrier


@dataclass(slots=True)
class Task:
    """A command that sets the axis in motion, as far as it has come."""

    move: Move
    start: int | None = None
    """Where it begins, in counts."""
    target: int | None = None
    """Where it goes."""
    rpm: float | None = None
    """The speed that it is to have, for a run."""
    before: float = 0.0
    """The speed that it had, in rpm."""
    slot: BurstSlot | None = None
    """When its start is sent, if not at once."""
    under_way: bool = False
    """It only changes a move that is under way."""
    begun: bool = False
    """Its start was sent."""
    lost: str = ""
    """Why its positions were not to be trusted then."""
    ended: Callable[[Ended], Awaitable[None]] | None = None
    """Waits for the end of a routine of the drive's own."""
    partners: tuple[tuple[PlanCarrier, Task], ...] = ()
    """Other axes of the drive that the same plan sets in motion."""
    since: float | None = field(init=False)
    """When its move began, where this only changes or ends what goes on."""

    def __post_init__(self) -> None:
        self.since = self.move.started_at
