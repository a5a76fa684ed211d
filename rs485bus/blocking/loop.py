"""An event loop in a thread of its own, and how other threads call into it and wait."""

from __future__ import annotations

import _thread
import asyncio
import os
import threading
from collections.abc import Callable, Coroutine
from types import CoroutineType
from typing import Any

from rs485bus.blocking.interrupts import calls, interrupts
from rs485bus.errors import BusClosed, WrongThread

_SLICE = 0.05
"""Seconds for which a thread waits at a time. Between, it looks for Ctrl-C, and shows how far things are."""
_GIVING_UP = 5.0
"""Seconds within which whatever is given up has ended."""


class Call:
    """A function to be called in the loop's thread; where it returns a coroutine, that is awaited there.

    Args:
        function: what to call.
        arguments: positional ones.
        keywords: others.
    """

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...], keywords: dict[str, Any]) -> None:
        self._function = function
        self._arguments = arguments
        self._keywords = keywords
        self._coroutine: Coroutine[Any, Any, Any] | None = None
        self._task: asyncio.Task[None] | None = None
        self.result: Any = None
        self.error: BaseException | None = None
        self.ended = _thread.allocate_lock()
        """Held until it has ended. A bare lock is what wakes a thread the fastest."""
        self.ended.acquire()

    def begin(self, waited_for: set[Call]) -> None:
        """Call it. In the loop's thread."""
        self._waited_for = waited_for
        waited_for.add(self)
        try:
            result = self._function(*self._arguments, **self._keywords)
        except BaseException as error:
            self.error = error
        else:
            if isinstance(result, CoroutineType):
                self._coroutine = result
                self._task = asyncio.get_running_loop().create_task(self._finish(result))
                self._task.add_done_callback(self._cancelled)
                return
            self.result = result
        self._end()

    def cancel(self) -> None:
        """Give up what is awaited. In the loop's thread, after it has begun."""
        if self._task is not None:
            self._task.cancel()

    def without_loop(self) -> Any:
        """Its result, where nothing is to be waited for: what a bus that was closed has counted, say.

        Raises:
            BusClosed: something would have to be waited for, or done.
        """
        try:
            result = self._function(*self._arguments, **self._keywords)
            if not isinstance(result, CoroutineType):
                return result
            result.send(None)
            result.close()
        except StopIteration as ended:
            return ended.value
        except (WrongThread, RuntimeError):  # no event loop runs in this thread
            pass
        raise BusClosed("The bus was closed: nothing can be asked or stopped by it any more.")

    async def _finish(self, coroutine: Coroutine[Any, Any, Any]) -> None:
        try:
            self.result = await coroutine
        except asyncio.CancelledError:  # means nothing to a thread
            self.error = BusClosed("The bus was closed before this had ended.")
        except BaseException as error:
            self.error = error
        finally:
            self._end()

    def _cancelled(self, task: asyncio.Task[None]) -> None:
        """One that had not had its first turn has none then: it was given up, or the loop ends."""
        if task.cancelled() and self._coroutine is not None:
            self._coroutine.close()
            self.error = BusClosed("The bus was closed before this had begun.")
            self._end()

    def _end(self) -> None:
        self._waited_for.discard(self)
        if self.ended.locked():
            self.ended.release()


class LoopThread:
    """The event loop of the blocking face. All its buses share one, so that groups may span them.

    Args:
        make: makes the event loop; None for asyncio's usual one.
    """

    def __init__(self, make: Callable[[], asyncio.AbstractEventLoop] | None) -> None:
        self.loop: asyncio.AbstractEventLoop
        self._end: asyncio.Future[None]
        self._make = make
        self._process = os.getpid()
        begun = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(begun,), name="rs485bus", daemon=True)
        self._waited_for: set[Call] = set()
        """Calls on their way. Only the loop's thread looks at it."""
        self._thread.start()
        begun.wait()

    @property
    def here(self) -> bool:
        """Whether this is the loop's own thread."""
        return threading.get_ident() == self._thread.ident

    @property
    def alive(self) -> bool:
        """Whether it runs. After a fork it does not, in the child."""
        return self._thread.is_alive()

    def post(self, function: Callable[..., object], *arguments: Any) -> bool:
        """Have a function called in the loop's thread, soon. Also from a signal handler. False where it has ended."""
        try:
            self.loop.call_soon_threadsafe(function, *arguments)
        except RuntimeError:
            return False
        return True

    def begin(self, call: Call) -> bool:
        """Begin a call, and wait for nothing. False where the loop has ended."""
        return self.post(self._begin, call)

    def call(self, function: Callable[..., Any], /, *arguments: Any, **keywords: Any) -> Any:
        """Call a function in the loop's thread, and wait for its result; that of the coroutine, if it returns one."""
        return self.carry_out(Call(function, arguments, keywords))

    def carry_out(
        self,
        call: Call,
        *,
        patient: bool = False,
        give_up: Callable[[], bool] | None = None,
    ) -> Any:
        """Carry out a call.

        Args:
            call: what to do.
            patient: whether Ctrl-C waits for its end. Otherwise it is given up.
            give_up: is called again and again, and says whether to wait no longer.

        Raises:
            WrongThread: this is the loop's thread, or another process than the one that opened the bus.
            BusClosed: the loop has ended.
            TimeoutError: it was given up.
        """
        if self.here:
            raise WrongThread(
                "The blocking face was called in the thread of its own bus, by a callback say, which would then wait "
                "for itself. Let the callback put what happened into a queue.Queue, and call from the thread that "
                "reads it."
            )
        calls.depth += 1
        try:
            interrupts.watch()
            if self._process != os.getpid():
                raise WrongThread(
                    f"The bus belongs to process {self._process}; this is {os.getpid()}, forked from it. Call it there."
                )
            if not self.begin(call):
                return call.without_loop()
            try:
                self._wait(call, patient, give_up)
            except BaseException:  # what handles a signal may raise anything
                self.post(call.cancel)
                call.ended.acquire(True, _GIVING_UP)
                raise
        finally:
            calls.depth -= 1
            if calls.pressed and not calls.depth:
                interrupts.take_effect()
        if call.error is not None:
            raise call.error
        return call.result

    def end(self) -> None:
        """End the loop, and wait for its thread, unless this is it. No call is to be on its way."""
        if self.post(self._end.set_result, None) and not self.here:
            self._thread.join()

    def _begin(self, call: Call) -> None:
        if not self._end.done():  # else nobody would carry it out: who waits for it is told that the loop has ended
            call.begin(self._waited_for)

    def _wait(self, call: Call, patient: bool, give_up: Callable[[], bool] | None) -> None:
        while not call.ended.acquire(True, _SLICE):
            if not self.alive:
                raise BusClosed("The event loop of the bus has ended, and what was waited for with it.")
            if calls.pressed and not patient:
                interrupts.take_effect()
            if give_up is not None and give_up():
                raise TimeoutError

    def _run(self, begun: threading.Event) -> None:
        async def main() -> None:
            self.loop = asyncio.get_running_loop()
            if hasattr(self.loop, "hold"):  # its clock is virtual
                self.loop.hold(lambda: not self._waited_for)
            self._end = self.loop.create_future()
            begun.set()
            await self._end

        with asyncio.Runner(loop_factory=self._make) as runner:
            runner.run(main())


class SharedLoop:
    """The loop of this process' buses: its thread begins with the first of them, and ends with the last."""

    def __init__(self) -> None:
        self.make: Callable[[], asyncio.AbstractEventLoop] | None = None
        """Makes the event loop of the next thread; None for asyncio's usual one. Tests put a virtual clock here."""
        self._lock = threading.Lock()
        self._thread: LoopThread | None = None
        self._users = 0

    def borrow(self) -> LoopThread:
        """To be given back as often as it is borrowed."""
        with self._lock:
            if self._thread is None or not self._thread.alive:
                self._thread, self._users = LoopThread(self.make), 0
            self._users += 1
            return self._thread

    def sleep(self, seconds: float) -> None:
        """Let time pass on the clock of the loop; none where there is no loop."""
        thread = self._thread
        if thread is not None and thread.alive:
            thread.call(asyncio.sleep, seconds)

    def give_back(self, thread: LoopThread) -> None:
        """A bus was closed."""
        with self._lock:
            if thread is not self._thread:
                return
            self._users -= 1
            if self._users:
                return
            self._thread = None
        thread.end()


shared_loop = SharedLoop()
