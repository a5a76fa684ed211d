"""Answers alike, counted: more of them than older requests can have given show that one is new. Pure.

Where replies may overtake each other, an answer may be the late reply to any equal request before it. But each comes
once, and one of them perhaps twice. So of k + 2 equal answers to one request, asked for one after the other while k
replies were owed, one at least was asked for then.
"""

from __future__ import annotations

from collections import deque

from rs485bus.bus.units.motion import NEVER
from rs485bus.wire.frames import Request

_COPIES = 1
"""How many of some equal late replies may come a second time."""
_KEPT = 64
"""Answers that are remembered."""


class AnswersAlike:
    """The latest answers to one request, while replies were owed that look like them."""

    __slots__ = ("_alike", "_asked", "_frame", "request")

    def __init__(self, request: Request) -> None:
        self.request = request
        self._frame = b""
        self._alike: deque[tuple[float, int]] = deque(maxlen=_KEPT)
        """When what was answered by that frame was asked, one after the other, and how many replies were owed then."""
        self._asked: deque[float] = deque(maxlen=_KEPT)
        """When what was answered was asked, by whatever frame."""

    def came(self, frame: bytes, sent_at: float, owed: int) -> None:
        """An answer came to what was sent at a time, when so many replies were owed that look like it."""
        if frame != self._frame:
            self._frame = frame
            self._alike.clear()
        self._alike.append((sent_at, owed))
        self._asked.append(sent_at)

    @property
    def is_news(self) -> bool:
        """Whether the latest answer differs from the one before."""
        return len(self._alike) == 1

    @staticmethod
    def needed(owed: int) -> int:
        """How many answers alike show that one was asked for last, where so many replies are owed."""
        return owed + _COPIES + 1 if owed else 1

    def since(self) -> float:
        """Since when, or later, the latest answer must have been asked for at least once; NEVER if that is not
        known."""
        for count, (sent_at, owed) in enumerate(reversed(self._alike), 1):
            if count >= self.needed(owed):
                return sent_at
        return NEVER

    def in_turn(self, owed: int) -> float:
        """When the latest answer was asked for, if no reply has overtaken another and so many were owed; NEVER if that
        is too long ago."""
        return self._asked[-1 - owed] if owed < len(self._asked) else NEVER
