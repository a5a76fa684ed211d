"""A machine that others use, too: what was measured while it stood still, or shortly after, is left out."""

from __future__ import annotations

import asyncio

_LOOK = 0.1
_STANDSTILL = 1.0
"""Seconds without a turn of the event loop that are no mere load: the process was stopped."""
_AFTERWARDS = 20.0
"""Seconds after which connections that were lost are back."""


class Standstills:
    """Tells whether the machine has run without a break."""

    def __init__(self) -> None:
        self.count = 0
        self.stood = 0.0
        """Seconds for which it stood still."""
        self.undisturbed = 0.0
        """Seconds that count."""
        self._until = float("-inf")

    @property
    def disturbed(self) -> bool:
        """Whether what is measured now is to be left out."""
        return asyncio.get_running_loop().time() < self._until

    async def wait_for(self, seconds: float) -> None:
        """Wait until so many seconds have passed undisturbed; but twice as long at most."""
        loop = asyncio.get_running_loop()
        wanted, end = self.undisturbed + seconds, loop.time() + 2 * seconds
        last = loop.time()
        while self.undisturbed < wanted and last < end:
            await asyncio.sleep(_LOOK)
            now = loop.time()
            if now - last > _STANDSTILL:
                self.count += 1
                self.stood += now - last
                self._until = now + _AFTERWARDS
            elif not self.disturbed:
                self.undisturbed += now - last
            last = now
