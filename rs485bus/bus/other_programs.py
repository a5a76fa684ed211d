"""Other programs that have the port open, too: each byte goes to one of them only. Looked for off the event loop."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from rs485bus.bus.handle import start_task
from rs485bus.transport.interface import Transport
from rs485bus.transport.worker import in_thread

_log = logging.getLogger("rs485bus")

FIRST_PAUSE = 5.0
LONGEST_PAUSE = 60.0
"""Seconds between two looks, while requests go on being unanswered: they grow from the first to the longest."""


class OtherPrograms:
    """Who reads along at a transport, as far as it can tell."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._loop = asyncio.get_running_loop()
        self._readers: Callable[[], list[str]] | None = getattr(transport, "readers", None)
        self._found: list[str] = []
        self._look_at = float("-inf")
        """An unanswered request before that is no reason to look again."""
        self._pause = FIRST_PAUSE
        self._looking: asyncio.Task[None] | None = None

    def __str__(self) -> str:
        """What is wrong and what to do about it, as it was seen last; empty where nobody reads along."""
        if not self._found:
            return ""
        programs, one = " and ".join(self._found), "it" if len(self._found) == 1 else "them"
        return f"{programs} has {self._transport.name} open, too, and takes bytes away: close {one}."

    def missed(self) -> None:
        """A request was not answered: somebody may have taken the answer."""
        if self._readers is not None and self._loop.time() >= self._look_at:
            self._look_at = self._loop.time() + self._pause
            self._pause = min(2 * self._pause, LONGEST_PAUSE)
            self.look()

    def look(self) -> None:
        """Look who it is; that takes a while."""
        if self._readers is not None and (self._looking is None or self._looking.done()):
            self._looking = start_task(self._look(self._readers), "rs485bus looking who reads along")

    def close(self) -> None:
        """Look no more."""
        self._readers = None
        if self._looking is not None:
            self._looking.cancel()

    async def _look(self, readers: Callable[[], list[str]]) -> None:
        before = self._found
        self._found = await in_thread(readers, lambda _: None)
        if self._found and self._found != before:
            _log.warning("%s", self)
