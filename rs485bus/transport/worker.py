"""What blocks, done in a thread of its own that ends with it."""

from __future__ import annotations

import _thread
import asyncio
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


async def in_thread(function: Callable[[], T], undo: Callable[[T], None]) -> T:
    """Call a function that blocks.

    Nobody waits for the thread, neither now nor at the end. A pool's would stay, and would keep a program from ending
    whose event loop ended out of turn, as it does when a task raises `SystemExit`.

    Args:
        function: what to call.
        undo: takes back what it returns where the caller was cancelled meanwhile.
    """
    loop = asyncio.get_running_loop()
    returned: asyncio.Future[T] = loop.create_future()

    def call() -> None:
        try:
            result = function()
        except BaseException as error:
            tell(_fail, returned, error)
        else:
            if not tell(_settle, returned, result, undo):
                undo(result)

    def tell(how: Callable[..., None], *arguments: object) -> bool:
        try:
            loop.call_soon_threadsafe(how, *arguments)
        except RuntimeError:  # the loop has ended
            return False
        return True

    _thread.start_new_thread(call, ())
    try:
        return await returned
    except asyncio.CancelledError:
        if returned.done() and not returned.cancelled() and returned.exception() is None:
            undo(returned.result())
        raise


def _settle(returned: asyncio.Future[T], result: T, undo: Callable[[T], None]) -> None:
    if returned.done():
        undo(result)
    else:
        returned.set_result(result)


def _fail(returned: asyncio.Future[T], error: BaseException) -> None:
    if not returned.done():
        returned.set_exception(error)
