"""Ctrl-C: the motors are stopped first, then it takes effect as ever.

The handler of SIGINT asks every open bus to stop its axes, at once and without waiting. What comes then depends on what
the main thread does: in the user's own code `KeyboardInterrupt` is raised there and then; inside of a call of the
blocking face it is put off until the call can be left without anything half done.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
import threading
from collections.abc import Callable
from types import CodeType, FrameType
from typing import Any, Protocol

_AFTER_A_CELL = 0.1
"""Seconds after which a notebook's kernel has put its own handler back."""


class Calls(threading.local):
    """The calls of the blocking face in which a thread is now."""

    depth = 0
    """How many there are, one within the other."""
    pressed = 0
    """How often Ctrl-C was pressed since the outermost one began. Only the main thread is told of it."""


calls = Calls()
blocks: set[CodeType] = set()
"""The code of the methods that leave a block. Ctrl-C at their first instruction must not keep them from doing so."""


class Stoppable(Protocol):
    """An open bus, as Ctrl-C sees it."""

    def stop_soon(self) -> None:
        """Have all its axes stopped. Called from a signal handler: it waits for nothing."""

    def see_standing(self, give_up: Callable[[], bool]) -> None:
        """Wait until they were seen standing, in bounded time, or until `give_up` says so."""


class _Interrupts:
    """SIGINT, of this process."""

    def __init__(self) -> None:
        self._former: Any = None
        self._buses: tuple[Stoppable, ...] = ()
        self._main = threading.main_thread().ident

    def add(self, bus: Stoppable) -> None:
        """Have Ctrl-C stop the axes of a bus."""
        self._buses = (*self._buses, bus)
        self.watch()
        _follow_cells(True)

    def remove(self, bus: Stoppable) -> None:
        """It was closed. With the last one the former handler is put back."""
        self._buses = tuple(other for other in self._buses if other is not bus)
        if self._buses:
            return
        _follow_cells(False)
        if threading.get_ident() == self._main and signal.getsignal(signal.SIGINT) == self._handle:
            signal.signal(signal.SIGINT, self._former)

    def watch(self) -> None:
        """Handle SIGINT from now on. Others may have taken it over meanwhile, as a notebook does before each cell."""
        if threading.get_ident() != self._main or not self._buses:
            return
        handler = signal.getsignal(signal.SIGINT)
        if handler != self._handle and handler is not None:
            self._former = handler
            signal.signal(signal.SIGINT, self._handle)

    def take_effect(self) -> None:
        """It was put off: see the motors stand, then do what it would have done. Pressed again, it does so at once.

        Raises:
            KeyboardInterrupt: as a rule; whatever the former handler raises.
        """
        pressed = calls.pressed
        calls.depth += 1
        try:
            for bus in self._buses:
                bus.see_standing(lambda: calls.pressed > pressed)
        finally:
            calls.depth -= 1
        self._hand_on()

    def _hand_on(self) -> None:
        calls.pressed = 0
        if callable(self._former):
            self._former(signal.SIGINT, None)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        for bus in self._buses:
            bus.stop_soon()
        if calls.depth or _leaves_a_block(frame):
            calls.pressed += 1
        else:
            self._hand_on()


def _leaves_a_block(frame: FrameType | None) -> bool:
    """Whether a block is about to be left, and nothing of that was done yet."""
    return frame is not None and frame.f_code in blocks and frame.f_lineno == frame.f_code.co_firstlineno


interrupts = _Interrupts()


def _follow_cells(follow: bool) -> None:
    """Watch in IPython's cells, too, and in a notebook between them: an interrupt of an idle kernel stops motors."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    if shell is None:
        return
    for event, callback in (("pre_run_cell", _before_cell), ("post_run_cell", _after_cell)):
        with contextlib.suppress(ValueError):  # it is not registered
            shell.events.unregister(event, callback)
        if follow:
            shell.events.register(event, callback)
    if follow:
        _after_cell(None)


def _before_cell(info: object) -> None:
    interrupts.watch()


def _after_cell(result: object) -> None:
    with contextlib.suppress(RuntimeError):  # plain IPython has no loop that runs between cells
        asyncio.get_running_loop().call_later(_AFTER_A_CELL, interrupts.watch)
