"""What commands return: something that was begun already, to await or to leave alone."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Coroutine, Generator, Iterable
from contextvars import Context, ContextVar, copy_context
from typing import Any, Generic, TypeVar

import anyio

from rs485bus.arguments import function
from rs485bus.bus.interrupts import interrupts_put_off
from rs485bus.errors import LoopNotRunning, MotionError

T = TypeVar("T")

_log = logging.getLogger("rs485bus")
_blocks: ContextVar[tuple[Handle[Any], ...]] = ContextVar("blocks", default=())
"""What goes on until a block is left in which the present task is, or was begun."""


def outside_of_blocks() -> Context:
    """A context for a task that is no part of the block in which it is begun."""
    context = copy_context()
    context.run(_blocks.set, ())
    return context


def start_task(
    coroutine: Coroutine[Any, Any, T], name: str | None = None, context: Context | None = None
) -> asyncio.Task[T]:
    """A task that begins after its caller has gone on, whatever task factory the application has.

    What it sets at its end must not be overwritten by whoever began it: an eager task may have ended before.
    """
    return asyncio.Task(coroutine, loop=asyncio.get_running_loop(), name=name, context=context)


class Handle(Generic[T]):
    """A command on its way. It happens whether it is awaited or not.

    Awaiting gives its result or raises why it failed; any number may await it, at any time, in any event loop.
    Cancelling an await leaves the command alone.

    Args:
        what: names it in messages.
        unseen: told of a failure, which those who await it have not seen yet.
    """

    def __init__(self, what: str, unseen: Callable[[Handle[Any]], None] | None = None) -> None:
        self.what = what
        self.seen = False
        """Its failure was raised to somebody."""
        self._kept_open_by: asyncio.Task[Any] | None = None
        """The task in whose block it goes on until that is left."""
        self._end_block: Callable[[], object] | None = None
        """Ends it, where it goes on until a block is left."""
        self._ahead: Callable[[], Iterable[Handle[Any]]] = tuple
        """What is done before it."""
        self._waits_for: list[Callable[[], Iterable[Handle[Any]]]] = []
        """What it waits for elsewhere: those that it begins together with, and others that keep it from beginning."""
        self._unseen = unseen
        self._home = running_loop()
        self._over = False
        self._result: T | None = None
        self._error: Exception | None = None
        self._waiters: list[asyncio.Future[None]] = []
        self._callbacks: list[Callable[[Handle[Any]], object]] = []

    def __repr__(self) -> str:
        state = "on its way" if not self._over else "done" if self._error is None else f"failed: {self._error}"
        return f"<{self.what}: {state}>"

    def done(self) -> bool:
        """Whether it has ended, well or not."""
        return self._over

    @property
    def error(self) -> Exception | None:
        """Why it failed, once it has."""
        return self._error

    def add_done_callback(self, callback: Callable[[Handle[Any]], object]) -> None:
        """Have `callback` called with this handle when it ends, before anybody who awaits it goes on.

        Where it has ended already, `callback` is called at once. An exception that `callback` raises is logged.

        Raises:
            TypeError: it cannot be called.
        """
        function("callback", callback)
        if self._over:
            self._call(callback)
        else:
            self._callbacks.append(callback)

    async def wait(self) -> T:
        """Wait for its end. As a coroutine function it suits `TaskGroup.create_task` and `start_soon`.

        Raises:
            RequestFailed, MotionError: why it failed.
            LoopNotRunning: the event loop in which it was begun does not run, so that it would not end.
        """
        if not self._over:
            self._check_wait()
            here, home = asyncio.get_running_loop(), self._home
            if home is not None and home is not here and not home.is_running():
                raise LoopNotRunning(
                    f"{self.what} goes on only while the event loop runs in which it was begun. Await it in that one."
                )
            waiter = here.create_future()
            self._waiters.append(waiter)
            try:
                if not self._over:  # another thread may end it between the question and the waiter
                    await waiter
            finally:
                self._waiters.remove(waiter)
        if self._error is not None:
            self.seen = True
            raise self._error
        return self._result  # type: ignore[return-value] # set where it ended well

    def __await__(self) -> Generator[Any, None, T]:
        return self.wait().__await__()

    def _keep_open(self) -> None:
        """It goes on until the present task leaves its block. Tasks that are begun in the block must not wait for it,
        either: as a rule, the block waits for them."""
        self._kept_open_by = asyncio.current_task()
        _blocks.set((*(each for each in _blocks.get() if not each.done()), self))

    def _check_wait(self) -> None:
        """Raise `MotionError` where the present task would wait for itself, or for the block in which it was begun."""
        me, seen, found = asyncio.current_task(), {self}, [self]
        while found:
            one = found.pop()
            for before in (one, *one._ahead()):
                keeper = before._kept_open_by
                if keeper is not None and (keeper is me or before in _blocks.get()):
                    raise MotionError(
                        f"{self.what} begins after {before.what}, and is awaited in the block of that: leave the block "
                        "first."
                    )
                others = {other for waits in before._waits_for for other in waits() if not other.done()} - seen
                seen |= others
                found += others

    def finish(self, result: T) -> None:
        """It ended well. For those who carry it out."""
        if not self._over:
            self._result = result
            self._end()

    def fail(self, error: Exception) -> None:
        """It failed. For those who carry it out."""
        if self._over:
            return
        self._error = error
        self._end()
        if self._unseen is not None:
            self._unseen(self)

    def _end(self) -> None:
        self._over = True
        callbacks, self._callbacks = self._callbacks, []
        try:
            for callback in callbacks:
                self._call(callback)
        finally:  # a callback may raise Ctrl-C
            here = running_loop()
            for waiter in list(self._waiters):
                _wake(waiter, here)

    def _call(self, callback: Callable[[Handle[Any]], object]) -> None:
        try:
            callback(self)
        except Exception:
            _log.exception("a done-callback of %s failed", self.what)


def running_loop() -> asyncio.AbstractEventLoop | None:
    """The event loop that runs in this thread, if one does."""
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None


def _wake(waiter: asyncio.Future[None], here: asyncio.AbstractEventLoop | None) -> None:
    """Let the one go on who waits by this future, in whichever event loop that is."""
    loop = waiter.get_loop()
    if loop is here:
        settle(waiter, None)
    else:
        with contextlib.suppress(RuntimeError):  # that loop was closed
            loop.call_soon_threadsafe(settle, waiter, None)


def settle(future: asyncio.Future[T], result: T) -> None:
    """Give a future its result, unless it has one."""
    if not future.done():
        future.set_result(result)


async def outlast(future: asyncio.Future[Any]) -> asyncio.CancelledError | None:
    """Wait until a future is done, however often the caller is cancelled. Returns the cancellation to raise then.

    Ctrl-C is put off, too.
    """
    cancelled = None
    with interrupts_put_off(), anyio.CancelScope(shield=True):
        while not future.done():
            try:
                await asyncio.wait([future])
            except asyncio.CancelledError as error:
                cancelled = error
    return cancelled
