"""The buses in a thread of their own, so that a slow terminal delays no frame."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import Generic, Protocol, TypeVar

from rs485bus.monitor.snapshot import Snapshot

T = TypeVar("T")


class Watching(Protocol):
    """What watches a plant: a `Watcher` in this program, a `ServedWatcher` of one that is served."""

    def start(self) -> None: ...

    async def aclose(self) -> None: ...

    def snapshot(self) -> Snapshot: ...

    def stop(self, name: str) -> None: ...

    def stop_all(self) -> None: ...

    def emergency_stop(self) -> None: ...


class BusThread:
    """Holds a plant open in a thread, with a watcher in it.

    Args:
        opening: makes a context manager that opens the plant and gives a watcher of it. Called in the thread.
    """

    def __init__(self, opening: Callable[[], AbstractAsyncContextManager[Watching]]) -> None:
        self._opening = opening
        self._watcher: Watching | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._leave: asyncio.Event | None = None
        self._error: BaseException | None = None
        self._opened = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rs485bus buses", daemon=True)

    def __enter__(self) -> BusThread:
        """Open it. Raises what opening raises."""
        self._thread.start()
        self._opened.wait()
        if self._watcher is None:
            self._thread.join()
            assert self._error is not None
            raise self._error
        return self

    def __exit__(self, *error: object) -> None:
        """Close it: motors that may move are stopped. Raises what closing raises."""
        if self._loop is not None and self._leave is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._leave.set)
        self._thread.join()
        if self._error is not None:
            raise self._error

    @property
    def ended(self) -> bool:
        """Whether it ended by itself."""
        return not self._thread.is_alive()

    def snapshot(self) -> Snapshot | None:
        """What is seen now; None if it ended."""
        return self._ask(lambda watcher: watcher.snapshot())

    def tell(self, act: Callable[[Watching], None]) -> None:
        """Have the watcher do something, without waiting for it."""
        if self._loop is not None and self._watcher is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(act, self._watcher)

    def _ask(self, question: Callable[[Watching], T]) -> T | None:
        answer = _Answer(question)
        if self._loop is None or self._watcher is None or not self._thread.is_alive():
            return None
        self._loop.call_soon_threadsafe(answer.give, self._watcher)
        while not answer.there.wait(0.2):
            if not self._thread.is_alive():
                return None
        return answer.value

    def _run(self) -> None:
        try:
            asyncio.run(self._hold())
        except BaseException as error:
            self._error = error
        finally:
            self._opened.set()

    async def _hold(self) -> None:
        self._loop, self._leave = asyncio.get_running_loop(), asyncio.Event()
        async with self._opening() as watcher:
            watcher.start()
            self._watcher = watcher
            self._opened.set()
            try:
                await self._leave.wait()
            finally:
                await watcher.aclose()


class _Answer(Generic[T]):
    def __init__(self, question: Callable[[Watching], T]) -> None:
        self._question = question
        self.there = threading.Event()
        self.value: T | None = None

    def give(self, watcher: Watching) -> None:
        try:
            self.value = self._question(watcher)
        finally:
            self.there.set()
