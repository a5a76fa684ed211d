"""The service's clock: Unix time when it was started, and what has passed since then, suspends of the computer too."""

from __future__ import annotations

import asyncio
import time


def _passed() -> float:
    """Seconds since some moment. They go on while the computer is suspended, where the system can tell."""
    boottime = getattr(time, "CLOCK_BOOTTIME", None)
    return time.monotonic() if boottime is None else time.clock_gettime(boottime)


class Clock:
    """Never steps, whatever becomes of the time of day."""

    def __init__(self) -> None:
        self._offset = time.time() - _passed()

    def now(self) -> float:
        return self._offset + _passed()

    def of_loop(self, at: float) -> float:
        """The time of a moment that is given on the clock of the event loop that runs."""
        return self.now() + at - asyncio.get_running_loop().time()
