"""How a bus is closed: motors first, then the watchdogs, the port, and whoever waits."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Coroutine
from typing import Any

from rs485bus.arguments import flag
from rs485bus.bus.config import BusConfig
from rs485bus.bus.handle import outlast, outside_of_blocks, settle, start_task
from rs485bus.bus.owner import Owner
from rs485bus.bus.port import Port
from rs485bus.bus.recording import Recording
from rs485bus.bus.runner import OwnerRunner
from rs485bus.bus.stopping.closing import shut_down, still_stopping
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.units.adapter import BusMember, abandon

_log = logging.getLogger("rs485bus")


class Shutdown:
    """What has to end with a bus, and how it does.

    Args:
        owner: the machine.
        runner: drives it.
        port: its port.
        loop: the event loop.
        config: how the bus behaves.
    """

    def __init__(
        self, owner: Owner, runner: OwnerRunner, port: Port, loop: asyncio.AbstractEventLoop, config: BusConfig
    ) -> None:
        self._owner = owner
        self._runner = runner
        self._port = port
        self._loop = loop
        self._config = config
        self._closing: asyncio.Task[None] | None = None
        self._tasks: set[asyncio.Task[Any]] = set()
        self.members: list[BusMember] = []
        """The facades on the bus."""
        self.recordings: list[Recording] = []
        """What records it."""
        self.stopped: list[Halted] = []
        """How each device that might have moved ended up."""

    @property
    def done(self) -> bool:
        """Whether the bus is closed."""
        return self._closing is not None and self._closing.done()

    def spawn(self, coroutine: Coroutine[Any, Any, None], name: str) -> asyncio.Task[None]:
        """A task that ends with the bus, outside of any task group."""
        task = start_task(coroutine, name, outside_of_blocks())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    async def keep(self) -> None:
        """Stand by for the end of the event loop: a bus that was not closed by then stops its motors first."""
        try:
            await self._loop.create_future()
        finally:
            if self._closing is None:
                await self.close(self._config.leave_running)

    async def close(self, leave_running: bool) -> None:
        """Close the bus, once. A cancellation is raised when that is done."""
        flag("leave_running", leave_running)
        if self._closing is None:
            self._owner.gate.closing = True
            self._closing = start_task(self._close(leave_running), "rs485bus closing")
        cancelled = await outlast(self._closing)
        if cancelled is not None:
            raise cancelled
        self._closing.result()

    async def _close(self, leave_running: bool) -> None:
        abandon(self.members, "the bus was closed")
        stopped = self._loop.create_future()
        deadline = self._loop.call_later(self._config.close_timeout, self._give_up, stopped)
        self._owner.now = self._loop.time()
        self._owner.start(
            shut_down(self._owner, leave_running),
            lambda halted: settle(stopped, halted),
            lambda _: self._give_up(stopped),
        )
        self._runner.run()
        await outlast(stopped)
        deadline.cancel()
        self.stopped = stopped.result()
        for halted in self.stopped:
            if not halted.standing:
                _log.critical("%s %d was NOT CONFIRMED STANDING when the bus was closed", halted.family, halted.address)
        self._owner.close(self._loop.time())
        self._runner.close()
        for task in tuple(self._tasks):
            if task is not asyncio.current_task():
                task.cancel()
        await outlast(start_task(self._port.close()))
        for recording in self.recordings:
            recording.close()

    def _give_up(self, stopped: asyncio.Future[list[Halted]]) -> None:
        settle(stopped, still_stopping(self._owner))
