"""The handle of a command of both wheels."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Generator
from typing import Any, Generic, TypeVar, cast

from rs485bus.arguments import function
from rs485bus.bus.handle import Handle
from rs485bus.errors import MoveCancelled
from rs485bus.motion.group.several import first_failure, when_all_have_ended
from rs485bus.motion.move import Move

T = TypeVar("T")


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

    @property
    def error(self) -> Exception | None:
        """Why it failed, once both have ended: of the wheel that was not just taken along."""
        return first_failure((self.left, self.right))

    def add_done_callback(self, callback: Callable[[Both[T]], object]) -> None:
        """Have `callback` called with this once both have ended, as `Handle.add_done_callback`."""
        function("callback", callback)
        when_all_have_ended((self.left, self.right), lambda: callback(self))

    async def wait(self) -> tuple[T, T]:
        """Wait for both to end.

        Raises:
            RequestFailed, MotionError: why the first one failed that was not just taken along.
        """
        for part in (self.left, self.right):
            part._check_wait()
        # Both at once: neither is one that fails and nobody waits for.
        left, right = await asyncio.gather(self.left.wait(), self.right.wait(), return_exceptions=True)
        errors = [ended for ended in (left, right) if isinstance(ended, BaseException)]
        if errors:
            raise min(errors, key=lambda error: isinstance(error, MoveCancelled))
        return cast("tuple[T, T]", (left, right))

    def __await__(self) -> Generator[Any, None, tuple[T, T]]:
        return self.wait().__await__()
