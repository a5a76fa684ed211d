"""What may be on the wire, whoever asked for it: held against what was last said of the port and the drives. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from rs485bus.wire.frames import BROADCAST

STOP_SOON = 0.15
"""Seconds within which the first frame of a stop is on the wire, whatever the line does."""
_WRITES = (6, 16)


class WireJudge:
    """Judges each frame by what stands before it on the wire.

    Args:
        turnaround: seconds of silence after a broadcast.
        character: seconds that a character takes.
        drives: the addresses of the drives that are stopped.
    """

    def __init__(self, turnaround: float, character: float, drives: Iterable[int]) -> None:
        self.is_away = False
        """The port is lost."""
        self.is_latched = False
        """An emergency stop was asked for, and is not cleared."""
        self._turnaround = turnaround
        self._character = character
        self._drives = set(drives)
        self._broadcast_over = float("-inf")
        self._stopping: dict[int, float] = {}
        """Since when drives are to be stopped of whose stop no frame has gone out."""

    def stop(self, address: int, now: float) -> None:
        """A drive is to be stopped."""
        self._stopping.setdefault(address, now)

    def stop_all(self, now: float) -> None:
        """All drives are to be stopped, and nothing is to move until that is cleared."""
        self.is_latched = True
        for address in self._drives:
            self.stop(address, now)

    def port_is_back(self, now: float) -> None:
        """Stops can go out from now on."""
        self.is_away = False
        self._stopping = dict.fromkeys(self._stopping, now)

    def sent(self, frame: bytes, now: float, *, moves: bool, bidden: bool) -> str:
        """What is wrong with a frame that goes out; nothing if it may.

        Args:
            frame: the frame.
            now: when it goes out.
            moves: it could set something in motion.
            bidden: it is of a request that somebody waits for.
        """
        address = frame[0]
        stops = address in self._drives and frame[1] in _WRITES and not bidden
        fault = self._fault(frame, now, moves=moves, stops=stops)
        if address == BROADCAST:
            self._broadcast_over = now + len(frame) * self._character + self._turnaround
        return fault

    def _fault(self, frame: bytes, now: float, *, moves: bool, stops: bool) -> str:
        if self.is_away:
            return "sent while the port is away"
        if moves and self.is_latched:
            return "could move something, and was sent while an emergency stop holds"
        if stops:
            asked_at = self._stopping.pop(frame[0], now)
            return f"a stop on the wire {now - asked_at:.3f} s after it was asked for" * (now > asked_at + STOP_SOON)
        return "sent in the turnaround of a broadcast" * (now < self._broadcast_over - 1e-9)
