"""Frames that go out as one: right behind each other on one pair, at the same moment on several. Pure.

The frames that start a group are made so. A burst begins when all of them wait for the wire and may go; from then on
only stops come between. Where one of them is not sent, or is refused, those behind it are not sent either: what was to
start with others does not start without them. What is not answered ends none: its sender settles what became of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from rs485bus.wire.frames import Request
from rs485bus.wire.timing import LineSettings

USUAL_TURNAROUND = 0.005
"""Seconds that a device usually takes to answer; what it may take is its reply timeout."""


class Part(Protocol):
    """One pair's part in bursts."""

    poke: Callable[[], None]
    """Called where something may go out on the pair that had to wait."""

    def must_wait(self, burst: Burst, now: float) -> float:
        """Until when what waits here must wait, at most now if it need not. What may not go at all ends the burst."""

    def is_free(self, now: float) -> bool:
        """Whether a frame could go out now."""

    def drop(self, burst: Burst) -> None:
        """Send none of those that wait here."""


class Burst:
    """So many frames that go out as one.

    Args:
        size: how many.
    """

    def __init__(self, size: int) -> None:
        self.began_at: float | None = None
        """When the first of them went out."""
        self.broken = False
        """One of them was not sent, or was refused: no other will be."""
        self._missing = size
        self._parts: list[Part] = []

    def join(self, part: Part) -> None:
        """One more of them waits, on a pair."""
        self._missing -= 1
        if part not in self._parts:
            self._parts.append(part)

    def may_begin(self, now: float) -> float:
        """Until when it must wait, at most now if it need not; infinity while that is not known."""
        if self._missing:
            return float("inf")
        until = max(part.must_wait(self, now) for part in self._parts)
        return float("inf") if self.broken else until

    def begin(self, now: float) -> bool:
        """Begin, if the wires are free that it needs."""
        if not all(part.is_free(now) for part in self._parts):
            return False
        self.began_at = now
        self._poke()
        return True

    def break_off(self) -> None:
        """Send none of those that wait still."""
        if not self.broken:
            self.broken = True
            for part in self._parts:
                part.drop(self)
            self._poke()

    def _poke(self) -> None:
        for part in self._parts:
            part.poke()


@dataclass(frozen=True, slots=True)
class BurstSlot:
    """The place of one frame in a burst. Lower places go first on their pair."""

    burst: Burst
    place: int


def takes(line: LineSettings, silence: float, request: Request, turnaround: float | None = None) -> float:
    """Seconds from the begin of a frame to that of the next one, if the device begins to answer after so many."""
    turnaround = USUAL_TURNAROUND if turnaround is None else turnaround
    return line.budget(len(request.adu), turnaround, request.length) + silence
