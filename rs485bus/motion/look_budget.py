"""How often whatever moves can be looked at: looks leave most of the wire to others."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable

from rs485bus.bus.line.serial_line import SerialLine
from rs485bus.bus.schedule.burst import takes
from rs485bus.bus.units.reply_times import ReplyTimes
from rs485bus.errors import LimitExceeded
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
_FOREVER = float("inf")
_TURNAROUND = 0.002
"""Seconds that a drive takes to answer that was never asked."""
_GAIN = 1 / 8


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
        self._told = False

    def enter(self, looks: object, takes: float) -> None:
        """A drive may move; one look at it takes the wire for so many seconds, as far as is known by now."""
        self._takes[looks] = takes
        if self.interval > _NOTICEABLY * self._supervision and not self._told:
            self._told = True
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
        self._told = self._told and self.interval > _NOTICEABLY * self._supervision

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
