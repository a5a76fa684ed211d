"""Ctrl-C while motors are being stopped: put off until they are.

A second Ctrl-C is raised wherever the program happens to be. In the middle of the procedure that stops motors it would
end that for good.
"""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_log = logging.getLogger("rs485bus")


class _Interrupts:
    """Ctrl-C, of this process."""

    def __init__(self) -> None:
        self._holders = 0
        self._former: Callable[[int, FrameType | None], Any] | None = None
        self._pressed = False

    def hold(self) -> None:
        """Only note it from now on."""
        self._holders += 1
        if self._holders == 1:
            handler = signal.getsignal(signal.SIGINT)
            self._former = handler if callable(handler) else None
            if self._former is not None:
                signal.signal(signal.SIGINT, self._note)

    def let_go(self) -> None:
        """If nobody holds it any more, it takes effect: now, if it was pressed."""
        self._holders -= 1
        if self._holders or self._former is None:
            return
        former, pressed, self._former, self._pressed = self._former, self._pressed, None, False
        if signal.getsignal(signal.SIGINT) == self._note:
            signal.signal(signal.SIGINT, former)
        if pressed:
            former(signal.SIGINT, None)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if not self._pressed:
            _log.warning("Ctrl-C takes effect when the motors stand")
        self._pressed = True


_interrupts = _Interrupts()


@contextmanager
def interrupts_put_off() -> Iterator[None]:
    """While this holds, Ctrl-C is only noted; it takes effect when the last of those who hold this lets go."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals go to the main thread
        return
    _interrupts.hold()
    try:
        yield
    finally:
        _interrupts.let_go()
