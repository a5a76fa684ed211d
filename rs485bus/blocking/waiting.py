"""Waiting for a command, and showing how far it is."""

from __future__ import annotations

import asyncio
import contextlib
import sys
import threading
import time
from collections.abc import Callable
from html import escape
from typing import Any, Protocol

from rs485bus.arguments import real
from rs485bus.blocking.interrupts import in_kernel
from rs485bus.blocking.loop import Call

_SHOWN_AFTER = 0.5
"""Seconds of waiting after which something is shown: what ends sooner needs no bar."""


def wait(self: Any, timeout: float | None = None) -> Any:
    """Wait for its end, and return its result.

    A terminal or a notebook shows how far it is. Ctrl-C stops the motors first, and is raised when they stand.

    Args:
        timeout: seconds; None for as long as it takes.

    Raises:
        LimitExceeded, TypeError: the timeout is no number. It goes on.
        RequestFailed, MotionError: why it failed.
        TimeoutError: it has not ended yet. It goes on: `cancel()` or `stop()` ends it.
    """
    timeout = None if timeout is None else real("timeout", timeout)
    picture = picture_of(self._inner, self._loop.loop.time)
    show = None if picture is None else picture.show
    try:
        return self._answer(self._loop.carry_out(Call(_wait, (self._inner, timeout), {}), give_up=show))
    finally:
        if picture is not None:
            picture.clear()


async def _wait(handle: Any, timeout: float | None) -> Any:
    if handle.done():
        return await handle.wait()
    within = asyncio.timeout(timeout)
    try:
        async with within:
            return await handle.wait()
    except TimeoutError:
        if not within.expired():
            raise
        raise TimeoutError(f"{handle!r} has not ended within {timeout:g} s. It goes on; stop() ends it.") from None


class Picture(Protocol):
    """What shows how far a command is."""

    def show(self) -> bool:
        """Show it, or how far it has come meanwhile. False: nothing of it keeps anybody from waiting on."""

    def clear(self) -> None:
        """Take it away."""


def picture_of(handle: Any, now: Callable[[], float]) -> Picture | None:
    """What shows how far a command is; None where nobody looks: no terminal, no notebook, another thread."""
    if threading.current_thread() is not threading.main_thread() or handle.done():
        return None
    if in_kernel():
        return _Notebook(handle, now)
    if sys.stderr is not None and sys.stderr.isatty():
        with contextlib.suppress(ModuleNotFoundError):
            import rich.console  # noqa: F401 - where it is not installed nothing is shown

            return _Terminal(handle, now)
    return None


def part_done(handle: Any, now: float) -> float | None:
    """Which part of the time that a command needs is over, 0..1; None where that is not known."""
    started, eta = getattr(handle, "started_at", None), getattr(handle, "eta", None)
    if started is None or eta is None or eta <= started:
        return None
    return float(min(1.0, max(0.0, (now - started) / (eta - started))))


class _Terminal:
    """A line of rich's that is there while it is waited."""

    def __init__(self, handle: Any, now: Callable[[], float]) -> None:
        self._handle = handle
        self._now = now
        self._since = time.monotonic()
        self._progress: Any = None

    def show(self) -> bool:
        if time.monotonic() - self._since < _SHOWN_AFTER:
            return False
        if self._progress is None:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

            self._progress = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TimeElapsedColumn(),
                console=Console(stderr=True),
                transient=True,
                auto_refresh=False,
            )
            self._task = self._progress.add_task(self._handle.what, total=None)
            self._progress.start()
        part = part_done(self._handle, self._now())
        self._progress.update(self._task, total=None if part is None else 1.0, completed=part or 0.0)
        self._progress.refresh()
        return False

    def clear(self) -> None:
        if self._progress is not None:
            self._progress.stop()


class _Notebook:
    """A bar of HTML that is there while it is waited. (rich would want ipywidgets for its own.)"""

    def __init__(self, handle: Any, now: Callable[[], float]) -> None:
        self._handle = handle
        self._now = now
        self._since = time.monotonic()
        self._shown: Any = None

    def show(self) -> bool:
        if time.monotonic() - self._since < _SHOWN_AFTER:
            return False
        part = part_done(self._handle, self._now())
        value = "" if part is None else f' value="{part:.2f}"'
        self._display(f"{escape(self._handle.what)} <progress{value}></progress>")
        return False

    def clear(self) -> None:
        if self._shown is not None:
            self._display("")

    def _display(self, html: str) -> None:
        import IPython.display as ipython

        content: Any = ipython.HTML(html)  # type: ignore[no-untyped-call] # IPython leaves it untyped
        if self._shown is None:
            self._shown = ipython.display(content, display_id=True)  # type: ignore[no-untyped-call] # the same
        else:
            self._shown.update(content)
