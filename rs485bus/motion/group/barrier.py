"""Where several that carry out one command meet: each brings its part, and what all need is done once."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection
from typing import Any, Generic, TypeVar

from rs485bus.bus.handle import settle

K = TypeVar("K")
P = TypeVar("P")
R = TypeVar("R")


class Barrier(Generic[K]):
    """A meeting, as often as they come to it.

    Args:
        members: who must come.
    """

    def __init__(self, members: Collection[K]) -> None:
        self._size = len(members)
        self._parts: dict[K, Any] = {}
        self._outcome: asyncio.Future[Any] | None = None

    async def meet(self, who: K, part: P, act: Callable[[dict[K, P]], Awaitable[R]]) -> R:
        """Wait for the others' parts and have all of them acted on, once. All get what comes of it."""
        if self._outcome is None:
            self._outcome = asyncio.get_running_loop().create_future()
        outcome = self._outcome
        self._parts[who] = part
        if len(self._parts) < self._size:
            # One that is cancelled here does not cancel the others with it.
            result: R = await asyncio.shield(outcome)
            return result
        parts, self._parts, self._outcome = self._parts, {}, None
        try:
            result = await act(parts)
        except Exception as error:
            if not outcome.done():
                outcome.set_exception(error)
                outcome.exception()  # it may be that nobody waits any more
            raise
        settle(outcome, result)
        return result
