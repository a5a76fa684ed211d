"""What is on the wire now: the frame sent, what may come back, and whether the adapter returns our own bytes. Pure."""

from __future__ import annotations

import enum
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import NamedTuple

from rs485bus.bus.line.pending import PendingReplies
from rs485bus.wire.frames import EXCEPTION_LENGTH, Request
from rs485bus.wire.receiver import Pattern, Receiver


class Kind(enum.Enum):
    """What a frame received is."""

    ECHO = enum.auto()
    """Our own frame, as an adapter returns it."""
    NORMAL = enum.auto()
    EXCEPTION = enum.auto()
    REFUSAL = enum.auto()
    """A refusal inside a normal reply."""
    LATE = enum.auto()
    LATE_EXCEPTION = enum.auto()


class Received(NamedTuple):
    kind: Kind
    request: Request
    """The request it belongs to: the current one, or an older one."""
    frame: bytes


_Key = tuple[Kind, Request]


class Transaction:
    """One frame out, frames in.

    `echo` is None until it is settled whether the adapter returns what is sent. That is settled by a read: nobody
    answers a read with its own bytes, so they come back before the answer exactly if the adapter echoes.
    """

    __slots__ = ("_auto", "_crc_errors", "_echoed", "_mirrors", "_receiver", "_request", "_skipped", "echo")

    def __init__(self, echo: bool | None) -> None:
        self.echo = echo
        self._auto = echo is None
        self._receiver: Receiver[_Key] = Receiver()
        self._request: Request | None = None
        self._echoed = False
        self._mirrors = False
        self._skipped = 0
        self._crc_errors = 0

    def begin(self, request: Request, late: Iterable[PendingReplies]) -> None:
        """`request` is being sent; listen for what may answer it, and for what older requests are owed."""
        self._request = request
        self._echoed = False
        # A reply that repeats its request cannot be told from an echo; where there is none, it is the reply.
        self._mirrors = len(request.adu) == request.length and request.adu.startswith(request.prefix)
        self._listen(_wanted(request, not self._mirrors or self.echo is not False), late)

    def idle(self, late: Iterable[PendingReplies]) -> None:
        """Nothing is on the wire; listen for what older requests are owed."""
        self._request = None
        self._listen((), late)

    def feed(self, data: bytes) -> list[Received]:
        """Take bytes in; return the frames they complete."""
        received = []
        for (kind, request), frame in self._receiver.feed(data):
            if kind is Kind.ECHO and self._mirrors and self._echoed:
                kind = Kind.NORMAL  # the second of two equal frames is the reply
            elif kind is Kind.ECHO:
                self._echoed = True
                if self._auto and not self._mirrors:
                    self.echo = True
            received.append(Received(kind, request, frame))
        return received

    def settle(self) -> None:
        """The current exchange is over. A read before which nothing came back tells that the adapter does not echo."""
        if self.echo is None and self._request is not None and not self._request.writes and self.counts()[0] == 0:
            self.echo = False

    def unsettle(self) -> None:
        """Another adapter may be there now."""
        if self._auto:
            self.echo = None

    @property
    def pending(self) -> int:
        """Bytes held that may be the begin of a frame that is waited for."""
        return self._receiver.pending

    def counts(self) -> tuple[int, int]:
        """Bytes skipped and CRC errors since the exchange began."""
        receiver = self._receiver
        return receiver.skipped + receiver.pending - self._skipped, receiver.crc_errors - self._crc_errors

    def _listen(self, patterns: Sequence[Pattern[_Key]], late: Iterable[PendingReplies]) -> None:
        for replies in late:
            for owed in replies:
                patterns = [*patterns, *_answers(owed.request, Kind.LATE, Kind.LATE_EXCEPTION, Kind.LATE)]
        self._receiver.expect(patterns)
        self._skipped = self._receiver.skipped
        self._crc_errors = self._receiver.crc_errors


@lru_cache(maxsize=256)
def _wanted(request: Request, echo: bool) -> Sequence[Pattern[_Key]]:
    """What may come back of a request that is sent; with `echo` the request itself."""
    patterns: list[Pattern[_Key]] = []
    if echo:
        patterns.append(Pattern(request.adu, len(request.adu), (Kind.ECHO, request)))
    if request.length or request.sizer:
        patterns += _answers(request, Kind.NORMAL, Kind.EXCEPTION, Kind.REFUSAL, counts=True)
    return patterns


def _answers(
    request: Request, normal: Kind, exception: Kind, refusal: Kind, counts: bool = False
) -> list[Pattern[_Key]]:
    head = bytes((request.address, request.function | 0x80))
    patterns = [
        Pattern(request.prefix, request.length, (normal, request), request.sizer, counts),
        Pattern(head, EXCEPTION_LENGTH, (exception, request)),
    ]
    if request.refusal is not None:
        patterns.append(Pattern(request.refusal, request.length, (refusal, request)))
    return patterns
