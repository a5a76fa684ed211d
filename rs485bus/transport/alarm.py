"""A precise wake-up. Event loops round their timers up to a millisecond, which is a third of a fast transaction."""

from __future__ import annotations

import asyncio
import ctypes
import os
import struct
import sys
import time
from collections.abc import Callable
from typing import Protocol

from rs485bus.transport.clock import clock_of

_CLOCK_MONOTONIC = 1
_ABSOLUTE = 1
_NONBLOCK_CLOEXEC = 0o4000 | 0o2000000
_FOREVER = float("inf")
_MARGIN = 0.000_01
"""Seconds by which what is woken for should be ready too early on average, so that it is seldom late."""
_LONGEST_LEAD = 0.000_25
_LATEST = 1e9
"""Seconds since the computer was started that a timer can be set to."""
_FAR = 0.004
"""Seconds within which the loop's own timer, late as it may be, is not relied on."""


class Alarm(Protocol):
    """Calls back once at the time it was set to, on the event loop's clock."""

    lead: float
    """Seconds before a time at which to wake up for it, because waking up and getting ready takes as long."""

    def learn(self, late: float) -> None:
        """What it woke up for was ready so many seconds late; negative: early, and the rest was waited out."""

    def set(self, when: float, *, likely: bool = True) -> None:
        """Call back at `when` instead of what was set before; infinity for not at all.

        What is not `likely` mostly is put off again before it comes, as a reply timeout is.
        """

    def close(self) -> None:
        """Never call back again."""


class LoopAlarm:
    """The event loop's own timer: late by up to a millisecond, but on whatever clock the loop has."""

    lead = 0.0

    def __init__(self, loop: asyncio.AbstractEventLoop, callback: Callable[[], None]) -> None:
        self._loop = loop
        self._callback = callback
        self._handle: asyncio.TimerHandle | None = None
        self._when = _FOREVER

    def learn(self, late: float) -> None:
        """Nothing to be learned: it is too coarse."""

    def set(self, when: float, *, likely: bool = True) -> None:
        if when == self._when:
            return
        self._when = when
        if self._handle is not None:
            self._handle.cancel()
        self._handle = None if when == _FOREVER else self._loop.call_at(when, self._fire)

    def close(self) -> None:
        self.set(_FOREVER)

    def _fire(self) -> None:
        self._when = _FOREVER
        self._handle = None
        self._callback()


class TimerfdAlarm:
    """A Linux timerfd in the loop's selector: precise to a tenth of a millisecond.

    It learns how long waking up and getting ready takes, so that whoever waits is woken that much early. What is far
    away and not likely to come is left to the loop's timer first: putting it off again costs no system call.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, callback: Callable[[], None]) -> None:
        self._loop = loop
        self._time = clock_of(loop)
        self._callback = callback
        self._fd = _create()
        self._when = _FOREVER
        self._armed_at = _FOREVER
        self._looks_at = _FOREVER
        """When the loop's timer comes back to a time that was far away."""
        self._look: asyncio.TimerHandle | None = None
        self.lead = 0.000_1
        loop.add_reader(self._fd, self._fire)

    def learn(self, late: float) -> None:
        if abs(late) < 0.001:  # beyond that it was something else
            self.lead = min(max(self.lead + (late + _MARGIN) / 16, 0.0), _LONGEST_LEAD)

    def set(self, when: float, *, likely: bool = True) -> None:
        if when == self._when or self._fd < 0:
            return
        self._when = when
        if likely and when != _FOREVER:
            if self._looks_at < when:
                self._stop_looking()
            self._arm(when)
        # What goes off before that will see that it is too early, and set itself anew.
        elif when < self._armed_at and when < self._looks_at + _FAR:
            self._watch_for(when)

    def close(self) -> None:
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            os.close(self._fd)
            self._fd = -1
            self._stop_looking()

    def _watch_for(self, when: float) -> None:
        if when > self._time() + 2 * _FAR:
            self._stop_looking()
            self._looks_at = when - _FAR
            self._look = self._loop.call_at(self._looks_at, self._look_again)
        else:
            self._arm(when)

    def _arm(self, when: float) -> None:
        self._armed_at = when
        # The time 0 would disarm it; what is past is due at once. And the system knows no time that is ages away.
        _settime(self._fd, min(max(when, 1e-9), _LATEST))

    def _stop_looking(self) -> None:
        self._looks_at = _FOREVER
        if self._look is not None:
            self._look.cancel()
            self._look = None

    def _look_again(self) -> None:
        self._stop_looking()
        if self._when < self._armed_at:
            self._watch_for(self._when)

    def _fire(self) -> None:
        try:
            os.read(self._fd, 8)
        except BlockingIOError:
            return  # it was set anew after it had become readable
        self._armed_at = _FOREVER
        when = self._when
        if when > self._time():
            if when < self._looks_at + _FAR:
                self._watch_for(when)
            return
        self._when = _FOREVER
        self._callback()


def make_alarm(loop: asyncio.AbstractEventLoop, callback: Callable[[], None]) -> Alarm:
    """The most precise alarm that this loop and system have."""
    # The loop's clock must be the one that timerfd goes by. A test's loop may have one of its own, that shows the same.
    own = isinstance(loop, asyncio.BaseEventLoop) and clock_of(loop) is not time.monotonic
    real = not own and abs(loop.time() - time.monotonic()) < 0.1
    if sys.platform == "linux" and real and hasattr(loop, "add_reader"):
        try:
            return TimerfdAlarm(loop, callback)
        except (OSError, NotImplementedError):
            pass
    return LoopAlarm(loop, callback)


if sys.version_info >= (3, 13) and sys.platform == "linux":

    def _create() -> int:
        return os.timerfd_create(_CLOCK_MONOTONIC, flags=os.TFD_NONBLOCK | os.TFD_CLOEXEC)

    def _settime(fd: int, when: float) -> None:
        os.timerfd_settime(fd, flags=os.TFD_TIMER_ABSTIME, initial=when)

else:
    _SPEC = struct.Struct("llll")
    _libc: ctypes.CDLL | None = None

    def _create() -> int:
        global _libc  # noqa: PLW0603 - loaded where it is needed, once
        if _libc is None:
            _libc = ctypes.CDLL(None, use_errno=True)
        fd = int(_libc.timerfd_create(_CLOCK_MONOTONIC, _NONBLOCK_CLOEXEC))
        if fd < 0:
            raise OSError(ctypes.get_errno(), "timerfd_create failed")
        return fd

    def _settime(fd: int, when: float) -> None:
        seconds = int(when)
        spec = _SPEC.pack(0, 0, seconds, int((when - seconds) * 1e9))
        if _libc is None or _libc.timerfd_settime(fd, _ABSOLUTE, spec, None) < 0:
            raise OSError(ctypes.get_errno(), "timerfd_settime failed")
