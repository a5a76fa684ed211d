"""Where feeds need more than was admitted: who has which turn, and which device is given up. Pure.

Devices have become slow, or a watchdog's time was made shorter. Everything else keeps one turn in three then, as long
as no device trips for it. Where even that is too much, the slowest device is given up, and not the others starved.
"""

from __future__ import annotations

from collections.abc import Iterable
from operator import attrgetter

from rs485bus.bus.watchdog.armed import ArmedWatchdog

_ROW = 2
"""Feeds after which something else has its turn."""
_over = attrgetter("over")
_takes = attrgetter("takes")


class Strain:
    """The turns of feeds and of everything else, where feeds need more than was admitted."""

    __slots__ = ("_row", "_starved_since", "holds")

    def __init__(self) -> None:
        self.holds = False
        """Feeds need more than was admitted."""
        self._row = 0
        """How many feeds in a row were sent."""
        self._starved_since: float | None = None

    def sent(self, feeds: bool) -> None:
        """A frame goes out: a feed, or something else."""
        if feeds:
            self._row += 1
        else:
            self._row, self._starved_since = 0, None

    @property
    def yields(self) -> bool:
        """Whether something else has a turn though a device is due."""
        return self.holds and self._row >= _ROW

    def starved(self, now: float) -> None:
        """Something else had a turn, and did not fit."""
        if self._starved_since is None:
            self._starved_since = now

    def ends(self) -> None:
        """Feeds need no more than was admitted."""
        self.holds, self._starved_since = False, None

    def hopeless(self, watches: Iterable[ArmedWatchdog], now: float) -> ArmedWatchdog | None:
        """The device that must be given up, lest others trip or nothing else ever goes; None if none must.

        That is the slowest: of those that cannot all be fed in time, or of all if nothing else had a turn for half of
        the shortest of their times. For what was only guessed none is given up before it is its turn.
        """
        live = sorted(watches, key=_over)
        if len(live) < 2:
            return None
        if self._starved_since is not None and now > self._starved_since + min(watch.timeout for watch in live) / 2:
            self._starved_since = None
            return max(live, key=_takes)
        ends_at, slowest = now, None
        for watch in live:
            ends_at += watch.takes
            if not watch.guessed and (slowest is None or watch.takes > slowest.takes):
                slowest = watch
            if ends_at > watch.over:
                return watch if now + watch.takes > watch.over else slowest
        return None
