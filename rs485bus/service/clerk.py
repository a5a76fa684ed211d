"""Writes the ledger in a thread: the event loop, in which the wire is served, does not wait for the disk."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from typing import Any

import anyio.to_thread

from rs485bus.service.ledger import Ledger

_log = logging.getLogger("rs485bus.service")

Entry = Callable[[Ledger], Any]
Done = Callable[[Any, Exception | None], None]


class Clerk:
    """Takes entries and writes them in order; what came meanwhile is written at once.

    Args:
        ledger: where they are written.
    """

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._waiting: deque[tuple[Entry, Done]] = deque()
        self._work: asyncio.Task[None] | None = None

    def write(self, entry: Entry, done: Done) -> None:
        """Write an entry; call `done` with its result, or with why it could not be written."""
        self._waiting.append((entry, done))
        if self._work is None:
            self._work = asyncio.create_task(self._write(), name="rs485bus ledger")

    async def drain(self) -> None:
        """Wait until all is written."""
        while self._work is not None:
            await asyncio.wait([self._work])

    async def _write(self) -> None:
        try:
            while self._waiting:
                batch = [self._waiting.popleft() for _ in range(len(self._waiting))]
                try:
                    results = await anyio.to_thread.run_sync(self._ledger.carry_out, [entry for entry, _ in batch])
                except Exception as error:
                    _log.exception("requests cannot be remembered")
                    for _, done in batch:
                        _tell(done, None, error)
                else:
                    for (_, done), result in zip(batch, results, strict=True):
                        _tell(done, result, None)
        finally:
            self._work = None


def _tell(done: Done, result: Any, error: Exception | None) -> None:
    try:
        done(result, error)
    except Exception:  # who waits for the next entry is told all the same
        _log.exception("what follows an entry could not be done")
