"""Frames that nobody here asked for: another master asks on the pair, or another client of the gateway. Pure.

Replies of Modbus RTU do not say which request they answer. So an answer to somebody else may be taken for one to us,
and nobody notices until positions and states contradict each other. Those that come unasked give it away.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from rs485bus.bus.line.diagnosis import frames_at_the_beginning
from rs485bus.wire.frames import BROADCAST, MAX_ADDRESS, MAX_FRAME

MANY = 3
"""How many unasked frames are told of: one or two may be what a device or a gateway says twice."""
WITHIN = 10.0
"""Seconds in which so many come."""
_MAY_BE_LATE = 30.0
"""Seconds for which a frame may be the late reply to a request that was not answered."""
_REMEMBERED = 64
"""How many of our latest frames are remembered: echoes of them, and what comes twice, are no stranger's."""


class Strangers:
    """Notices frames that belong to nothing that was asked here."""

    __slots__ = ("_data", "_ours", "_times", "_unanswered", "found", "latest")

    def __init__(self) -> None:
        self.latest = b""
        """The latest such frame."""
        self.found: Callable[[], None] = lambda: None
        """Called where there have been many, again with each one more."""
        self._times: deque[float] = deque(maxlen=MANY)
        self._data = b""
        self._ours: deque[bytes] = deque(maxlen=_REMEMBERED)
        self._unanswered: dict[tuple[int, int], float] = {}

    def sent_or_answered(self, frame: bytes) -> None:
        """A frame went out, or came in and was expected."""
        self._ours.append(frame)

    def unanswered(self, request: bytes, now: float) -> None:
        """A request was not answered, or is for all devices: some answer those."""
        self._unanswered[request[0], request[1]] = now

    def heard(self, data: bytes, now: float, *, follows_silence: bool) -> None:
        """Bytes came that were not waited for."""
        self._data = data if follows_silence or len(self._data) > MAX_FRAME else self._data + data
        while frame := self._first():
            self._data = self._data[len(frame) :]
            if frame not in self._ours and not self._may_be_late(frame, now):
                self._times.append(now)
                self.latest = frame
                if self.were_many(now):
                    self.found()

    def were_many(self, now: float) -> bool:
        """Whether there have been many of late."""
        return len(self._times) == MANY and self._times[0] > now - WITHIN

    def _first(self) -> bytes:
        """The frame that the bytes begin with."""
        data = self._data
        if len(data) < 2 or data[0] > MAX_ADDRESS:
            return b""
        return next(frames_at_the_beginning(data), b"")

    def _may_be_late(self, frame: bytes, now: float) -> bool:
        function = frame[1] & 0x7F
        asked = max(self._unanswered.get((address, function), float("-inf")) for address in (frame[0], BROADCAST))
        return asked > now - _MAY_BE_LATE
