"""How often whatever moves can be looked at, and what came of that: looks leave most of the wire to others."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable

from rs485bus.bus.line.serial_line import SerialLine
from rs485bus.bus.schedule.burst import takes
from rs485bus.bus.units.reachability import share_lost
from rs485bus.bus.units.reply_times import ReplyTimes
from rs485bus.errors import LimitExceeded
from rs485bus.motion.standstill import NEVER
from rs485bus.wire.frames import Request

_log = logging.getLogger("rs485bus")

SHARE = 0.4
"""The part of the wire that looks may take."""
LONGEST = 1.0
"""Seconds to which the interval is stretched at most."""
SILENT = 4
"""Intervals without a usable answer after which an axis that may move is stopped."""
_LOOKS = 1 + 1 / SILENT
"""Looks in an interval: the telling one, and now and then another."""
_NOTICEABLY = 1.02
"""How many times as long as it should be an interval is that is told: it reads differently, too."""
_LONGER = 1.25
"""How many times as long as when that was told last it must be to be told again: it comes and goes as axes do."""
_FOREVER = float("inf")
_TURNAROUND = 0.002
"""Seconds that a drive takes to answer that was never asked."""
_GAIN = 1 / 8
_IN_VAIN = 4
"""How many looks must have been in vain then, at least, however long the drive may take for one."""
_UNLIKELY = math.log(1e-6)
"""How unlikely it must be that the line has lost them all."""
_PAUSE = 0.05
"""The longest pause, in seconds, before a drive is asked again that does not tell what it is asked."""


class LookTime:
    """For how long one look at a drive takes the wire: by how soon it has answered so far, then as measured.

    Args:
        pair: the pair it is on.
        times: how long it takes to answer.
        requests: what it is asked.
    """

    __slots__ = ("_measured", "_pair", "_requests", "_times")

    def __init__(self, pair: SerialLine, times: ReplyTimes, requests: Iterable[Request]) -> None:
        self._pair = pair
        self._times = times
        self._requests = tuple(requests)
        self._measured = 0.0

    @property
    def seconds(self) -> float:
        """Seconds from the begin of a look to that of the next frame."""
        pair = self._pair
        if self._measured:
            return self._measured
        turnaround = self._times.usual or _TURNAROUND
        return pair.latency + max(takes(pair.line, pair.silence, request, turnaround) for request in self._requests)

    def took(self, seconds: float) -> None:
        """A look was answered after so many seconds."""
        self._measured = self.seconds + _GAIN * (seconds + self._pair.silence - self.seconds)


class LookBudget:
    """How often the drives of one bus can be looked at.

    Args:
        supervision: seconds between two looks at an axis that may move, where there is room for them.
    """

    def __init__(self, supervision: float) -> None:
        self._supervision = supervision
        self._takes: dict[object, float] = {}
        self._told = 0.0
        """The interval that was told last."""

    def enter(self, looks: object, takes: float) -> None:
        """A drive may move; one look at it takes the wire for so many seconds, as far as is known by now."""
        self._takes[looks] = takes
        if self.interval > max(_NOTICEABLY * self._supervision, _LONGER * self._told):
            self._told = self.interval
            _log.warning(
                "%d moving drives are looked at every %.2f s only, instead of every %g s: there is no more room on "
                "the wire",
                len(self._takes),
                self.interval,
                self._supervision,
            )

    def check(self, looks: object, takes: float, name: str) -> None:
        """Raise `LimitExceeded` where a further drive may not move, for it could not be looked at often enough."""
        others = {other: its for other, its in self._takes.items() if other is not looks}
        needed = _LOOKS * (sum(others.values()) + takes) / SHARE
        longest = max(LONGEST, self._supervision)
        if needed > longest:
            raise LimitExceeded(
                f"{name}: {len(others)} drives move already, and all together could be looked at every {needed:.1f} s "
                f"only: nothing was sent. Move fewer at once, use a faster line, or open the bus with "
                f"BusConfig(supervision={min(5.0, math.ceil(10 * needed) / 10):g})."
            )

    def leave(self, looks: object) -> None:
        """It stands."""
        self._takes.pop(looks, None)

    @property
    def shortest(self) -> float:
        """The shortest interval for which there is room, in seconds."""
        return _LOOKS * sum(self._takes.values()) / SHARE

    @property
    def interval(self) -> float:
        """Seconds between two telling looks at each axis that may move."""
        return min(max(self._supervision, self.shortest), max(LONGEST, self._supervision))

    @property
    def rotation(self) -> float:
        """Seconds between two of the other looks at each drive."""
        all_looks = sum(self._takes.values())
        spare = SHARE - all_looks / self.interval
        return max(self.interval, min(all_looks / spare if spare > 0 else _FOREVER, SILENT * self.interval))


class LookOutcomes:
    """What came of the looks at one drive."""

    __slots__ = ("_misses", "_untold", "not_before")

    def __init__(self) -> None:
        self.not_before = NEVER
        """When it is looked at again, at the soonest."""
        self._misses = 0
        """Looks that were not answered since one was."""
        self._untold = 0
        """Looks for where an axis is that did not tell it, answered or not, since any look did."""

    def answered(self, at: float, took: float, *, told: bool, telling: bool, where: bool) -> None:
        """A look was answered in so many seconds.

        Args:
            at: when.
            took: how long that took.
            told: the answer told what the look was for.
            telling: the look was for where an axis is.
            where: the answer told that, whatever the look was for.
        """
        self._misses = 0
        self._untold = 0 if where else self._untold + telling
        if not told:
            self._pause(at, took)

    def missed(self, at: float, took: float, *, telling: bool) -> None:
        """It was not answered in so many seconds. `telling`: it was for where an axis is."""
        self._misses += 1
        self._untold += telling
        # The first repetition goes at once; later ones leave the wire to others.
        self._pause(at, 0.0 if self._misses == 1 else took)

    def in_vain(self, counts: tuple[float, float]) -> tuple[bool, bool]:
        """Whether too many looks in a row were not answered; and whether too many did not tell where an axis is, of a
        drive that answers. `counts`: how many answers the line has lost, and how many came."""
        if self._misses < _IN_VAIN and self._untold < _IN_VAIN:
            return False, False
        looks = max(_IN_VAIN, math.ceil(_UNLIKELY / math.log(share_lost(*counts))))
        return self._misses >= looks, self._untold >= looks and not self._misses

    def _pause(self, at: float, took: float) -> None:
        self.not_before = at + min(took * (1 / SHARE - 1), _PAUSE)
