"""Verbs on their way to a served plant."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from typing import Any, TypeVar, cast

from rs485bus.bus.handle import Handle
from rs485bus.motion.move import Cancellable, positions_until
from rs485bus.service.schema import Answer

T = TypeVar("T")


class RemoteMove(Cancellable[T]):
    """A verb that was asked for, as `Move` is one. Awaiting it gives what the verb gives.

    `async with move:` waits for it at the end of the block, and ends it if the block is left by an exception.

    Args:
        what: names it in messages.
        cancel: has it ended.
        position: asks where the axis is; None where there is more than one.
        unseen: told of its failure.
    """

    def __init__(
        self,
        what: str,
        cancel: Callable[[RemoteMove[Any]], None],
        position: Callable[[], Handle[float]] | None,
        unseen: Callable[[Handle[Any]], None],
    ) -> None:
        super().__init__(what, unseen)
        self.request: str | None = None
        """Its id, once it was sent."""
        self.begun = asyncio.Event()
        """Set once the service has said that it has begun."""
        self.outcome = ""
        """How it ended: "done", "refused" (nothing was done), "failed", "unknown"; empty if no answer came."""
        self.started: float | None = None
        """When it was started, by the service's clock; known at its end."""
        self.spread: float | None = None
        """Seconds between the first and the last axis that was started; known at its end."""
        self._cancel = cancel
        self._position = position

    def told(self, answer: Answer) -> None:
        """How far it has come, or how it ended."""
        if answer.outcome == "begun":
            self.begun.set()
        else:
            self.outcome = answer.outcome
        self.started, self.spread = answer.started, answer.spread

    def cancel(self) -> None:
        """End it: what waits is not begun, what is under way is stopped. It raises `MoveCancelled`."""
        if not self.done():
            self._cancel(self)

    async def positions(self, every: float = 0.1) -> AsyncIterator[float]:
        """Where the axis is, every so many seconds until the move has ended; last, where it ended.

        Raises:
            MotionError: what the move raises.
            TypeError: it moves more than one axis.
        """
        if self._position is None:
            raise TypeError(f"{self.what} moves more than one axis: look at each by itself.")
        one_axis = cast("RemoteMove[float]", self)
        async for at in positions_until(one_axis, self._position, every):
            yield float(at)
