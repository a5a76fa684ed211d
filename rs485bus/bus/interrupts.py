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
_guards = 0
_former: Callable[[int, FrameType | None], Any] | None = None
_pressed = False


@contextmanager
def interrupts_put_off() -> Iterator[None]:
    """While this holds, Ctrl-C is only noted; it takes effect when the last of those who hold this lets go."""
    global _guards, _former, _pressed
    if threading.current_thread() is not threading.main_thread():
        yield  # signals go to the main thread
        return
    _guards += 1
    if _guards == 1:
        handler = signal.getsignal(signal.SIGINT)
        _former = handler if callable(handler) else None
        if _former is not None:
            signal.signal(signal.SIGINT, _note)
    try:
        yield
    finally:
        _guards -= 1
        if _guards == 0 and _former is not None:
            former, pressed, _former, _pressed = _former, _pressed, None, False
            if signal.getsignal(signal.SIGINT) is _note:
                signal.signal(signal.SIGINT, former)
            if pressed:
                former(signal.SIGINT, None)


def _note(number: int, frame: FrameType | None) -> None:
    global _pressed
    if not _pressed:
        _log.warning("Ctrl-C: the motors are being stopped; it takes effect when they stand")
    _pressed = True
