"""What a blocking bus is inside: opened once, stopped by Ctrl-C, closed once, however the program ends."""

from __future__ import annotations

import _thread
import asyncio
import atexit
import contextlib
import os
import signal
import threading
import warnings
import weakref
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from types import TracebackType
from typing import Any

from rs485bus.arguments import whole
from rs485bus.blocking.block import Block
from rs485bus.blocking.interrupts import interrupts
from rs485bus.blocking.loop import Call, shared_loop
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.errors import AddressInUse, BusClosed, BusError

_STANDING = 5.0
"""Seconds for which Ctrl-C waits until all axes are seen standing: as long as closing a bus may take."""
_AGAIN = 0.001
"""Seconds after which Ctrl-C comes again that could not take effect."""


def _press() -> None:
    """Ctrl-C, for the main thread. A real signal also wakes it where it sleeps."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


class Opened:
    """Something with axes that was opened in the loop's thread.

    Args:
        manager: opens it when it is entered, and closes it when it is left.

    Raises:
        PortError: it cannot be opened.
    """

    def __init__(self, manager: AbstractAsyncContextManager[Any]) -> None:
        self.axes: list[Any] = []
        """Those to be stopped by Ctrl-C."""
        self._block = Block(manager)
        self._stops: list[Handle[Any]] = []
        self._process = os.getpid()
        self._ended = _thread.allocate_lock()
        """Taken by whoever is the first to have closed it: several threads may close it at once."""
        self._finalizer: weakref.finalize[..., Any] | None = None
        interrupts.add(self)  # from here on Ctrl-C is put off until it is open
        self.loop = shared_loop.borrow()
        atexit.register(self.close)
        try:
            self._inner = self.loop.carry_out(Call(self._block.enter, (), {}))
        except BaseException as error:
            if self._block.entered:
                self.leave(type(error), error, error.__traceback__)
            else:
                self._end()
            raise

    def held_by(self, face: object) -> None:
        """Whoever has this face holds it open. When nobody has it any more, it is closed."""
        self._finalizer = weakref.finalize(face, self.forgotten)
        self._finalizer.atexit = False

    def leave(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Close it as a block does: after queued moves, or at once where the block is left by an exception."""
        self._close_by(Call(self._block.leave, (kind, error, trace), {}))

    def close(self, **how: Any) -> None:
        """Close it now: stop every axis that may move, see it stand, release the watchdogs."""
        self._close_by(Call(self._close, (), how))

    def forgotten(self) -> None:
        """Nobody has it any more, and nobody closed it. From whichever thread: nothing is waited for here.

        The end of the program waits for it, as for every bus that is not closed yet.
        """
        if not self._ended.locked() and self._process == os.getpid():
            self.loop.begin(Call(self._close_and_end, (), {}))
            warnings.warn(f"{self._inner!r} was not closed", ResourceWarning, stacklevel=2)

    def stop_soon(self) -> None:
        """Have all axes stopped. From a signal handler."""
        if self.axes:
            self.loop.post(self._stop)

    def press_again(self) -> None:
        """Have Ctrl-C come again, soon. From a signal handler."""
        self.loop.post(lambda: threading.Timer(_AGAIN, _press).start())

    def see_standing(self, give_up: Callable[[], bool]) -> None:
        """Wait until the stops of Ctrl-C are confirmed, no longer than closing would take."""
        if not self.axes:
            return
        with contextlib.suppress(BusError, TimeoutError):
            self.loop.carry_out(Call(self._stand, (), {}), patient=True, give_up=give_up)

    def _stop(self) -> None:
        self._stops.clear()
        for axis in self.axes:
            with contextlib.suppress(BusError):  # it is closed
                self._stops.append(axis.stop())

    async def _stand(self) -> None:
        stops = [asyncio.ensure_future(stop.wait()) for stop in self._stops]
        if stops:
            await asyncio.wait(stops, timeout=_STANDING)
        for stop in stops:
            stop.cancel()

    def _close_by(self, call: Call) -> None:
        if self._ended.locked() or self._process != os.getpid():
            return
        try:
            self.loop.carry_out(call, patient=True)
        except BusClosed:
            if self.loop.alive:
                raise  # otherwise another thread has closed it meanwhile
        finally:
            self._end()

    def _end(self) -> None:
        if self._ended.acquire(False):
            if self._finalizer is not None:
                self._finalizer.detach()
            interrupts.remove(self)
            atexit.unregister(self.close)
            shared_loop.give_back(self.loop)

    async def _close(self) -> None:
        await self._block.leave(GeneratorExit, GeneratorExit(), None)

    async def _close_and_end(self) -> None:
        try:
            await self._close()
        finally:
            self._end()


class OpenedBus(Opened):
    """A bus, and the axes that were made on it."""

    def __init__(self, manager: AbstractAsyncContextManager[Bus]) -> None:
        self._made: dict[tuple[type, int], tuple[Any, dict[str, Any]]] = {}
        """By their families and addresses, with the settings that they were made with."""
        super().__init__(manager)

    @property
    def bus(self) -> Bus:
        """The bus, which belongs to the loop's thread."""
        bus: Bus = self._inner
        return bus

    def make(self, cls: type, *arguments: Any, **keywords: Any) -> Any:
        """An instance of a class. In the loop's thread."""
        made = cls(*arguments, **keywords)
        if hasattr(made, "emergency_stop") and hasattr(made, "bus"):
            self.axes.append(made)
        return made

    def axis(self, family: type, address: int, settings: dict[str, Any]) -> Any:
        """The axis of a family at an address: a new one, or the one that was made before. In the loop's thread, so
        that Ctrl-C cannot come between its making and its being known."""
        whole("address", address, 1)
        known = self._made.get((family, address))
        if known is None:
            axis = self.make(family, self.bus, address, **settings)
            self._made[family, address] = axis, settings
            return axis
        axis, former = known
        if settings and settings != former:
            raise AddressInUse(
                f"{axis.name} was made already, with other settings: {former or 'the usual ones'}. Use that one, or "
                "close the bus and open it anew."
            )
        return axis

    async def _close(self, leave_running: bool | None = None) -> None:
        try:
            await self.bus.aclose(leave_running=leave_running)
        finally:
            await super()._close()
