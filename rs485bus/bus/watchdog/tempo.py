"""How long feeds take: learned from each feed, and suspected of all devices where several in a row were slow. Pure.

One slow answer says nothing: a device may be busy for a moment. Two in a row say that it has become slow. And where
feeds of several devices were slow in a row, it is the line or the host: the others will be slow as well, and to find
that out one by one would take too long.
"""

from __future__ import annotations

from collections.abc import Iterable

from rs485bus.bus.watchdog.armed import ArmedWatchdog

_SLOW = 2.0
"""How many times as long feeds must take to be suspicious."""
_IN_A_ROW = 3
"""How many of them in a row, each of another device."""


class Tempo:
    """The tempo of the feeds on one bus."""

    __slots__ = ("_slow", "_times", "guessed")

    def __init__(self) -> None:
        self._slow: dict[int, ArmedWatchdog] = {}
        """Whose feeds were slow in a row, without a quick one between them."""
        self._times = float("inf")
        """How many times as long as before each of them took, at the least."""
        self.guessed = False
        """Something was concluded for other devices than the one that was fed."""

    def measured(self, watch: ArmedWatchdog, took: float, all_watches: Iterable[ArmedWatchdog]) -> None:
        """A feed took so many seconds. Updates what feeds are expected to take, also of other devices."""
        times = took / watch.known if watch.known else 1.0
        watch.measured(took)
        if times < _SLOW:
            self._slow.clear()
            self._times = float("inf")
            return
        self._slow[watch.address] = watch
        self._times = min(self._times, times)
        if len(self._slow) < _IN_A_ROW:
            return
        for other in all_watches:
            if other.address in self._slow:
                other.takes = other.known = other.latest
                self.guessed = self.guessed or other is not watch
            elif not other.guessed:
                other.takes, other.guessed = other.known * self._times, True
                self.guessed = True
