"""Calls back at the earliest of the times that were asked for."""

from __future__ import annotations

from collections.abc import Callable

from rs485bus.bus.bus import Bus

_FOREVER = float("inf")
_SAME = 1e-4
"""Seconds that make no difference."""


class Wake:
    """Calls back, once, at the earliest of the times that were asked for since it last did.

    Args:
        bus: whose owner calls back.
        callback: what is called.
    """

    __slots__ = ("_at", "_bus", "_callback")

    def __init__(self, bus: Bus, callback: Callable[[], None]) -> None:
        self._bus = bus
        self._callback = callback
        self._at = _FOREVER

    def at(self, when: float) -> None:
        """Call back at this time, if not sooner. Infinity is never."""
        if when < self._at - _SAME and when < _FOREVER:
            self._at = when
            self._bus.call_at(when, self._go_off)

    def _go_off(self) -> None:
        self._at = _FOREVER
        self._callback()
