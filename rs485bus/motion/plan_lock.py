"""Lets one plan of a drive be carried out at a time: what its axes share is changed by one."""

from __future__ import annotations

import asyncio

import anyio


class PlanLock:
    """`async with lock:` around a plan. One that waits for others may step aside for them."""

    def __init__(self) -> None:
        self._lock = asyncio.Lock()
        self._holder: asyncio.Task[object] | None = None

    async def __aenter__(self) -> None:
        await self._lock.acquire()
        self._holder = asyncio.current_task()

    async def __aexit__(self, *error: object) -> None:
        if self._holder is asyncio.current_task():  # one that was cancelled while it stood aside holds nothing
            self._release()

    async def step_aside(self, seconds: float) -> None:
        """Let others have their turn, for some seconds at least."""
        self._release()
        await anyio.sleep(seconds)
        await self.__aenter__()

    def _release(self) -> None:
        self._holder = None
        self._lock.release()
