"""Ctrl-C: the motors are stopped first, then it takes effect as ever.

The handler of SIGINT asks every open bus to stop its axes, at once and without waiting. What comes then depends on what
the main thread does: in the user's own code `KeyboardInterrupt` is raised there and then; inside of a call of the
blocking face it is put off until the call can be left without anything half done.
"""

from __future__ import annotations

import _weakrefset
import asyncio
import contextlib
import signal
import sys
import threading
import weakref
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


_FINALIZERS = ("__del__", "_asyncgen_finalizer_hook", "forgotten")
"""Functions, by name, out of which no exception comes."""
_CALLBACKS = (weakref.__file__, _weakrefset.__file__)
"""Modules whose functions are called when something was let go of."""


class Stoppable(Protocol):
    """An open bus, as Ctrl-C sees it."""

    def stop_soon(self) -> None:
        """Have all its axes stopped. Called from a signal handler: it waits for nothing."""

    def press_again(self) -> None:
        """Have Ctrl-C come again, soon. Called from a signal handler."""

    def see_standing(self, give_up: Callable[[], bool]) -> None:
        """Wait until they were seen standing, in bounded time, or until `give_up` says so."""


class _Handler:
    """Handles SIGINT in the place of another handler.

    Each knows its own former one. A notebook puts the handler that held between two cells aside, and back after the
    cell; what was put in place meanwhile is gone then.
    """

    def __init__(self, former: Any, pressed: Callable[[_Handler, FrameType | None], None]) -> None:
        self.former = former
        self._pressed = pressed

    def __call__(self, number: int, frame: FrameType | None) -> None:
        self._pressed(self, frame)

    def hand_on(self) -> None:
        """Do what the former handler does."""
        if callable(self.former):
            self.former(signal.SIGINT, None)

    def would_break(self, frame: FrameType | None) -> bool:
        """Whether the former handler would raise in a notebook's kernel while that does its own work."""
        return self.former is signal.default_int_handler and in_kernel() and not _runs_a_cell(frame)


class _Interrupts:
    """SIGINT, of this process."""

    def __init__(self) -> None:
        self._buses: tuple[Stoppable, ...] = ()
        self._changing = threading.Lock()
        """Any thread opens and closes buses."""
        self._main = threading.main_thread().ident
        self._put_off: Callable[[], None] | None = None
        """What Ctrl-C does when it takes effect."""

    def add(self, bus: Stoppable) -> None:
        """Have Ctrl-C stop the axes of a bus."""
        with self._changing:
            self._buses = (*self._buses, bus)
        self.watch()
        _follow_cells(True)

    def remove(self, bus: Stoppable) -> None:
        """It was closed. With the last one the former handler is put back."""
        with self._changing:
            self._buses = tuple(other for other in self._buses if other is not bus)
        if self._buses:
            return
        _follow_cells(False)
        handler = signal.getsignal(signal.SIGINT)
        if threading.get_ident() == self._main and isinstance(handler, _Handler):
            signal.signal(signal.SIGINT, handler.former)

    def watch(self) -> None:
        """Handle SIGINT from now on. Others may have taken it over meanwhile, as a notebook does before each cell.

        A program that was started to ignore it, as a shell starts its background jobs, goes on ignoring it.
        """
        if threading.get_ident() != self._main or not self._buses:
            return
        handler = signal.getsignal(signal.SIGINT)
        if isinstance(handler, _Handler) or handler is None:
            return
        if handler is not signal.SIG_IGN or in_kernel():
            signal.signal(signal.SIGINT, _Handler(handler, self._pressed))

    def only_stop(self) -> None:
        """From now on SIGINT stops motors and does nothing else, until somebody sets a handler."""
        if threading.get_ident() == self._main and self._buses:
            signal.signal(signal.SIGINT, _Handler(signal.SIG_IGN, self._pressed))

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
        calls.pressed = 0
        hand_on, self._put_off = self._put_off, None
        if hand_on is not None:
            hand_on()

    def press_again(self) -> None:
        """Have Ctrl-C come again, soon, where it can take effect."""
        for bus in self._buses[:1]:
            bus.press_again()

    def _pressed(self, handler: _Handler, frame: FrameType | None) -> None:
        for bus in self._buses:
            bus.stop_soon()
        if calls.depth or _leaves_a_block(frame):
            calls.pressed += 1
            self._put_off = handler.hand_on
        elif self._buses and (_would_be_lost(frame) or handler.would_break(frame)):
            self.press_again()
        else:
            handler.hand_on()


def _leaves_a_block(frame: FrameType | None) -> bool:
    """Whether a block is about to be left, and nothing of that was done yet."""
    return frame is not None and frame.f_code in blocks and frame.f_lineno == frame.f_code.co_firstlineno


def _would_be_lost(frame: FrameType | None) -> bool:
    """Whether Python ignores what is raised here: something is just being let go of."""
    while frame is not None:
        if frame.f_code.co_name in _FINALIZERS or frame.f_code.co_filename in _CALLBACKS:
            return True
        frame = frame.f_back
    return False


def _runs_a_cell(frame: FrameType | None) -> bool:
    """Whether code of a cell is being run, or what it has called."""
    names = _shell().user_global_ns
    while frame is not None:
        if frame.f_globals is names:
            return True
        frame = frame.f_back
    return False


interrupts = _Interrupts()


def _shell() -> Any:
    """IPython, where it runs."""
    ipython = sys.modules.get("IPython")
    return None if ipython is None else ipython.get_ipython()


def in_kernel() -> bool:
    """Whether this is the kernel of a notebook."""
    return hasattr(_shell(), "kernel")


def _follow_cells(follow: bool) -> None:
    """Watch in IPython's cells, too, and in a notebook between them: an interrupt of an idle kernel stops motors.

    A kernel takes the signal over as soon as a cell comes, and would not survive it before the cell's first line: its
    hook is followed.
    """
    shell = _shell()
    if shell is None:
        return
    hooks: dict[str, Callable[[object], None]] = {"pre_run_cell": _before_cell}
    if in_kernel():
        hooks["post_run_cell"] = _after_cell
    for event, callback in hooks.items():
        with contextlib.suppress(ValueError):  # it is not registered
            shell.events.unregister(event, callback)
        if follow:
            shell.events.register(event, callback)
    kernel: Any = getattr(shell, "kernel", None)
    hook = getattr(kernel, "pre_handler_hook", None)
    if isinstance(hook, _BeforeMessage) and not follow:
        kernel.pre_handler_hook = hook.former
    elif hook is not None and not isinstance(hook, _BeforeMessage) and follow:
        kernel.pre_handler_hook = _BeforeMessage(hook)


class _BeforeMessage:
    """What a kernel does before it handles a message: it takes SIGINT over, and it is taken from it again."""

    def __init__(self, former: Callable[[], None]) -> None:
        self.former = former

    def __call__(self) -> None:
        try:
            self.former()
            interrupts.watch()
        except KeyboardInterrupt:  # it came between the two
            interrupts.watch()
            interrupts.press_again()


def _before_cell(info: object) -> None:
    interrupts.watch()


def _after_cell(result: object) -> None:
    """What is left of the cell is the kernel's own work, which must not be interrupted. Afterwards it puts its handler
    back, which ignores the signal; motors are to stop all the same."""
    interrupts.only_stop()
    with contextlib.suppress(RuntimeError):
        asyncio.get_running_loop().call_later(_AFTER_A_CELL, interrupts.watch)
