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
_IN_VAIN = 4
"""Feeds without an answer after which it has its turn as well: more than the two that are reckoned with may be lost."""
_ABOUT = 0.9
_over = attrgetter("over")


class Strain:
    """The turns of feeds and of everything else, where feeds need more than was admitted."""

    __slots__ = ("_in_vain", "_row", "_starved_since", "holds")

    def __init__(self) -> None:
        self.holds = False
        """Feeds need more than was admitted."""
        self._row = 0
        """How many feeds in a row were sent."""
        self._in_vain = 0
        """How many of them were not answered."""
        self._starved_since: float | None = None

    def sent(self, feeds: bool) -> None:
        """A frame goes out: a feed, or something else."""
        if feeds:
            self._row += 1
        else:
            self._row, self._in_vain, self._starved_since = 0, 0, None

    def failed(self) -> None:
        """A feed was not answered in time. Its device may answer late, and so be heard, and fed without end."""
        self._in_vain += 1

    @property
    def presses(self) -> bool:
        """Whether feeds may need more than was admitted."""
        return self.holds or self._in_vain >= _IN_VAIN

    @property
    def yields(self) -> bool:
        """Whether something else has a turn though a device is due."""
        return self._row >= _ROW and (self.holds or self._in_vain >= _IN_VAIN)

    def starved(self, now: float) -> None:
        """Something else had a turn, and did not fit."""
        if self.holds and self._starved_since is None:
            self._starved_since = now

    def ends(self) -> None:
        """Feeds need no more than was admitted."""
        self.holds, self._starved_since = False, None

    def hopeless(self, watches: Iterable[ArmedWatchdog], longest: float, now: float) -> ArmedWatchdog | None:
        """The device that must be given up, lest others trip or nothing else ever goes; None if none must.

        That is the slowest: of those that cannot all be fed in time, or of all if nothing else has a turn. For what was
        only guessed none is given up before it is its turn.

        Args:
            watches: those whose devices answer.
            longest: how long something else may take the wire, in seconds.
            now: the time.
        """
        live = sorted(watches, key=_over)
        if len(live) < 2:
            return None
        if self._starved_since is not None and self._must_make_room(live, longest, now - self._starved_since):
            return _slowest(live)
        ends_at, known = now, list[ArmedWatchdog]()
        for watch in live:
            ends_at += watch.takes
            if not watch.guessed:
                known.append(watch)
            if ends_at > watch.over:
                return watch if now + watch.takes > watch.over else _slowest(known)
        return None

    def _must_make_room(self, live: list[ArmedWatchdog], longest: float, starved: float) -> bool:
        """Whether something else has had no turn for too long."""
        shortest = min(watch.timeout for watch in live)
        slowest = max(watch.takes for watch in live)
        if sum(watch.takes for watch in live) + slowest + longest > shortest:
            return starved > shortest / 2  # it never will
        if starved <= shortest:
            return False
        self._starved_since = None
        return True


def _slowest(watches: list[ArmedWatchdog]) -> ArmedWatchdog | None:
    """The slowest of some; of those that are about as slow the one that must be fed first: most is saved by that."""
    slowest = max((watch.takes for watch in watches), default=0.0)
    return min((watch for watch in watches if watch.takes >= _ABOUT * slowest), key=_over, default=None)
