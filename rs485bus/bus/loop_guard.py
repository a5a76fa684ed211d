"""Whether a call comes from where it can be carried out."""

from __future__ import annotations

import asyncio
import threading

from rs485bus.bus.handle import running_loop
from rs485bus.errors import BusClosed, LoopNotRunning, WrongThread


class LoopGuard:
    """Knows the event loop that a bus lives in, and its thread. Made in that loop."""

    def __init__(self) -> None:
        self.loop = asyncio.get_running_loop()
        self.thread = threading.get_ident()

    def check(self) -> None:
        """Refuse a call that the event loop of the bus cannot carry out.

        Raises:
            WrongThread: it comes from another thread than the loop's.
            LoopNotRunning: it comes from the loop's thread, but the loop does not run.
            BusClosed: the loop was closed.
        """
        if running_loop() is self.loop:
            return
        if threading.get_ident() != self.thread:
            raise WrongThread(
                "The bus was called from another thread than its event loop's. From there, what acts when it is called "
                "is loop.call_soon_threadsafe(axis.stop), and what is awaited is "
                "asyncio.run_coroutine_threadsafe(bus.aclose(), loop).result()."
            )
        if self.loop.is_closed():
            raise BusClosed(
                "The event loop of the bus was closed, so that nothing can be asked or stopped by it any more. Open "
                "the bus anew in the loop that runs now, and leave it before that loop ends: async with open_bus(...)."
            )
        raise LoopNotRunning(
            "The event loop of the bus does not run now, so that nothing can be sent: nothing was done. Call the bus "
            "from a coroutine of that loop. In IPython, whose loop runs only while a cell awaits something, write "
            "await bus.emergency_stop(), not bus.emergency_stop(). Motors that must stop now: use the hard-wired stop."
        )
