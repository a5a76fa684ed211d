"""Two wheels that carry out one command: each brings its part, and what both need is done once."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Generator
from typing import Any, Generic, TypeVar, cast

from rs485bus.bus.handle import Handle, settle
from rs485bus.devices.move import Move
from rs485bus.devices.zlac.values import Side
from rs485bus.errors import MoveCancelled

P = TypeVar("P")
R = TypeVar("R")
T = TypeVar("T")


class Together:
    """Where the orders of both wheels meet.

    Args:
        drop: ends a wheel's part of the command, because the other wheel's failed.
    """

    def __init__(self, drop: Callable[[Side], None]) -> None:
        self._drop = drop
        self._in = set(Side)
        self._parts: dict[Side, Any] = {}
        self._outcome: asyncio.Future[Any] | None = None

    def join(self, side: Side, part: Handle[Any]) -> None:
        """A wheel's part of the command. Where it fails, however it does, it takes the other one along."""
        part.add_done_callback(lambda ended: self._leave(side, ended.error is not None))

    async def meet(self, side: Side, part: P, act: Callable[[dict[Side, P]], Awaitable[R]]) -> R:
        """Wait for the other wheel's part and have both acted on, once. Both get what comes of it."""
        self._parts[side] = part
        if len(self._parts) < len(Side):
            self._outcome = asyncio.get_running_loop().create_future()
            result: R = await self._outcome
            return result
        parts, self._parts = self._parts, {}
        outcome = self._outcome
        assert outcome is not None
        try:
            result = await act(parts)
        except Exception as error:
            if not outcome.done():
                outcome.set_exception(error)
            raise
        settle(outcome, result)
        return result

    def _leave(self, side: Side, failed: bool) -> None:
        self._in.discard(side)
        if failed and self._in:
            (other,) = self._in
            self._in.clear()
            self._drop(other)


class Both(Generic[T]):
    """A command of both wheels, on its way. Awaiting it gives the result of the left and of the right one.

    Args:
        left: the left wheel's part.
        right: the right wheel's part.
    """

    def __init__(self, left: Handle[T], right: Handle[T]) -> None:
        self.left = left
        self.right = right

    def __repr__(self) -> str:
        return f"<{self.left!r} and {self.right!r}>"

    def done(self) -> bool:
        """Whether both have ended, well or not."""
        return self.left.done() and self.right.done()

    def cancel(self) -> None:
        """End it: one that waits leaves the queues, one under way stops both wheels. It raises `MoveCancelled`."""
        for part in (self.left, self.right):
            if isinstance(part, Move):
                part.cancel()

    async def wait(self) -> tuple[T, T]:
        """Wait for both to end.

        Raises:
            RequestFailed, MotionError: why the first one failed that was not just taken along.
        """
        # Both at once: neither is one that fails and nobody waits for.
        left, right = await asyncio.gather(self.left.wait(), self.right.wait(), return_exceptions=True)
        errors = [ended for ended in (left, right) if isinstance(ended, BaseException)]
        if errors:
            raise min(errors, key=lambda error: isinstance(error, MoveCancelled))
        return cast("tuple[T, T]", (left, right))

    def __await__(self) -> Generator[Any, None, tuple[T, T]]:
        return self.wait().__await__()
