"""The handle of one move, and how far it has come."""

from __future__ import annotations

import asyncio
import enum
from abc import abstractmethod
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Self, TypeVar

from rs485bus.bus.async_block import AsyncBlock
from rs485bus.bus.handle import Handle
from rs485bus.errors import MoveCancelled
from rs485bus.motion.pace import Pace

if TYPE_CHECKING:
    from rs485bus.bus.schedule.burst import BurstSlot
    from rs485bus.motion.carrier import PlanCarrier
    from rs485bus.motion.plan import Ended

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class MoveTarget:
    """Where a move is to go, in the axis' units."""

    what: str
    """Names the move in messages."""
    target: float | None
    """Where that is, if it is said as a position."""
    planned: float | None
    """Where that is, as far as is known before those that are queued before it."""
    position: Callable[[int], float]
    """Where that is, from the counts at which the move starts."""
    reach: tuple[int, int]
    """Between which targets it may lie, in counts."""


class MoveState(enum.Enum):
    """How far a move has come."""

    QUEUED = "queued"
    STARTING = "starting"
    MOVING = "moving"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


class Cancellable(Handle[T], AsyncBlock):
    """A command that can be ended.

    `async with` waits for it at the end of the block, and ends it if the block is left by an exception.
    """

    @abstractmethod
    def cancel(self) -> None:
        """End it."""

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        if error is None:
            try:
                await self.wait()
            except asyncio.CancelledError:
                self.cancel()
                self.seen = True
                raise
        else:
            self.cancel()
            self.seen = True
        return False


class Move(Cancellable[float]):
    """A move that was asked for. Awaiting it gives the position reached, in the axis' units.

    `async with move:` waits for it at the end of the block, and stops the axis if the block is left by an exception.

    Args:
        what: names it in messages.
        target: where it goes, in the axis' units; None where it goes on or the drive decides.
        position: asks the axis where it is.
        cancel: stops the axis on behalf of this move.
        unseen: told of its failure, as a `Handle` is.
    """

    def __init__(
        self,
        what: str,
        target: float | None,
        position: Callable[[], Awaitable[float]],
        cancel: Callable[[Move], None],
        unseen: Callable[[Handle[Any]], None],
    ) -> None:
        super().__init__(what, unseen)
        self.target = target
        self.state = MoveState.QUEUED
        self.rpm: float | None = None
        """The speed really used: what the drive can do of what was asked for."""
        self.acceleration: float | None = None
        """The acceleration really used, in rpm/s; infinity for a jump."""
        self.started_at: float | None = None
        """When its start was sent, on the event loop's clock."""
        self.eta: float | None = None
        """When it should be done, on the event loop's clock."""
        self._position = position
        self._cancel = cancel

    def finish(self, result: float) -> None:
        self.state = MoveState.DONE
        super().finish(result)

    def fail(self, error: Exception) -> None:
        if not self.done():
            self.state = MoveState.CANCELLED if isinstance(error, MoveCancelled) else MoveState.FAILED
        super().fail(error)

    def cancel(self) -> None:
        """End the move: one that waits leaves the queue, one under way stops the axis. It raises `MoveCancelled`."""
        if not self.done():
            self._cancel(self)

    async def positions(self, every: float = 0.1) -> AsyncIterator[float]:
        """Where the axis is, every so many seconds until the move has ended; last, where it ended.

        Raises:
            MotionError: what the move raises.
        """
        async for at in positions_until(self, self._position, every):
            yield at


async def positions_until(handle: Handle[T], ask: Callable[[], Awaitable[T]], every: float) -> AsyncIterator[T]:
    """What somebody says who is asked every so many seconds until a command has ended; last, what came of it."""
    if not handle.done():
        handle._check_wait()
    now = asyncio.get_running_loop().time
    pace = Pace(every, now())
    while not handle.done():
        yield await ask()
        ended = asyncio.ensure_future(handle.wait())
        try:
            await asyncio.wait([ended], timeout=pace.left(now()))
        finally:
            if ended.done():
                ended.exception()  # it is raised below
            else:
                ended.cancel()
    yield await handle.wait()


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
