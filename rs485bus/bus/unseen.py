"""Failures of commands that nobody has seen."""

from __future__ import annotations

import asyncio
import logging
from typing import Any

from rs485bus.bus.handle import Handle

_log = logging.getLogger("rs485bus")


class Unseen:
    """Commands that failed. Each is logged, and raised from the block, unless somebody sees it.

    Args:
        loop: the event loop.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._handles: list[Handle[Any]] = []

    def add(self, handle: Handle[Any]) -> None:
        """A command failed."""
        self._handles.append(handle)
        # Who awaits it goes on first, or gives up in the same moment; who is about to await it has begun by then.
        self._loop.call_soon(self._tell, handle)

    def errors(self) -> list[Exception]:
        """The failures that nobody has seen, each once."""
        errors = [handle.error for handle in self._handles if not handle.seen and handle.error is not None]
        return list({id(error): error for error in errors}.values())

    def _tell(self, handle: Handle[Any]) -> None:
        if handle.seen:
            self._handles.remove(handle)
        else:
            _log.error("%s failed: %s", handle.what, handle.error)
