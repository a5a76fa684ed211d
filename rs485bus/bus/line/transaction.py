"""What is on the wire now: the frame sent, and what may come back. Pure."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

from rs485bus.bus.line.diagnosis import Heard
from rs485bus.bus.line.echo import EchoQuestion
from rs485bus.bus.line.pending import PendingReplies
from rs485bus.wire.frames import EXCEPTION_LENGTH, Request
from rs485bus.wire.receiver import Pattern, Receiver

_ECHO_BEGINS = 8
"""Bytes by which the echo of a request is known from an answer that begins alike: the shortest of those has so many."""


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


ECHO, NORMAL = Kind.ECHO, Kind.NORMAL
"""Asked for at every reply; see `job.NO_REASON`."""


class Received(NamedTuple):
    kind: Kind
    request: Request
    """The request it belongs to: the current one, or an older one."""
    frame: bytes


_Key = tuple[Kind, Request]

_UNMISTAKABLE = 4
"""Bytes at the end of a request that nobody else says: two of its data, and the CRC of all of it."""


class Transaction:
    """One frame out, frames in.

    Args:
        echo: whether the adapter returns what is sent; None to find out.
    """

    __slots__ = (
        "_crc_errors",
        "_echoed",
        "_mirrors",
        "_receiver",
        "_request",
        "_skipped",
        "_tells",
        "_undecided",
        "question",
    )

    def __init__(self, echo: bool | None) -> None:
        self.question = EchoQuestion(echo)
        """Whether the adapter echoes."""
        self._receiver: Receiver[_Key] = Receiver()
        self._request: Request | None = None
        self._echoed = False
        self._undecided = b""
        self._mirrors = False
        self._tells = False
        self._skipped = 0
        self._crc_errors = 0

    @property
    def echo(self) -> bool | None:
        """Whether the adapter returns what is sent; None while that is not known."""
        return self.question.verdict

    @echo.setter
    def echo(self, verdict: bool | None) -> None:
        self.question.verdict = verdict

    def begin(self, request: Request, late: Sequence[PendingReplies]) -> None:
        """`request` is being sent; listen for what may answer it, and for what older requests are owed."""
        self._request = request
        self._echoed = False
        self._undecided = b""
        patterns, self._mirrors, self._tells = _wanted(request, self.question.verdict is not False)
        self._listen(patterns, late)

    def idle(self, late: Sequence[PendingReplies]) -> None:
        """Nothing is on the wire; listen for what older requests are owed."""
        self._request = None
        self._listen((), late)

    def feed(self, data: bytes) -> list[Received]:
        """Take bytes in; return the frames they complete."""
        received = []
        for (kind, request), frame in self._receiver.feed(data):
            if kind is ECHO and frame != request.adu:
                continue  # somebody else's, that begins alike
            if kind is ECHO and self._mirrors and (self._echoed or self._has_passed(request)):
                kind = NORMAL  # the second of two equal frames is the reply, also where the first was damaged
            elif kind is ECHO:
                self._echoed = True
            received.append(Received(kind, request, frame))
        return received

    @property
    def is_in_doubt(self) -> bool:
        """What came back may be the answer, or the request itself."""
        return self._mirrors and self._echoed and self.question.is_open

    def judge(self) -> bool:
        """The request was answered, by nothing older. Whether that tells if the adapter echoes."""
        if self._tells:
            question, passed = self.question, self._receiver.passed
            echoed = self._echoed or (passed != b"" and self._has_passed(self._request))
            if echoed is not question.verdict or question.is_in_doubt:
                question.judge(echoed, clean=self._receiver.skipped == self._skipped)
        return self._tells

    def _has_passed(self, request: Request | None) -> bool:
        """Whether the end of the request stood before the first of the frames received last."""
        return request is not None and request.adu[-_UNMISTAKABLE:] in self._receiver.passed

    @property
    def pending(self) -> int:
        """Bytes held that may be the begin of a frame that is waited for."""
        return self._receiver.begun

    @property
    def passed(self) -> bytes:
        """The bytes right before what `feed` returned last."""
        return self._receiver.passed

    def heard(self) -> Heard | None:
        """What has come that was no answer; None if nothing has."""
        rest = self._receiver.rest
        if not (rest or self._echoed or self._undecided):
            return None
        return Heard(rest, self._echoed, self.is_in_doubt, self._undecided)

    def pass_over(self, refusal: bytes) -> None:
        """A refusal that fits the request decides nothing."""
        self._undecided = refusal

    def counts(self) -> tuple[int, int]:
        """Bytes skipped and CRC errors since the exchange began."""
        receiver = self._receiver
        return receiver.skipped + receiver.pending - self._skipped, receiver.crc_errors - self._crc_errors

    def _listen(self, patterns: Sequence[Pattern[_Key]], late: Sequence[PendingReplies]) -> None:
        if late:
            patterns = [*patterns]
            seen = set()
            requests = dict.fromkeys(owed.request for replies in late for owed in replies)  # many attempts are alike
            for request in requests:
                for pattern in _late_answers(request):
                    looks = (pattern.prefix, pattern.length)
                    if looks not in seen:  # and many requests are answered alike
                        seen.add(looks)
                        patterns.append(pattern)
        self._receiver.expect(patterns)
        self._skipped = self._receiver.skipped
        self._crc_errors = self._receiver.crc_errors


class _Wanted(NamedTuple):
    """What may come back of a request that is sent."""

    patterns: Sequence[Pattern[_Key]]
    mirrors: bool
    """Its own bytes would pass for its reply. Where the adapter does not echo, they are the reply."""
    tells: bool
    """Its answer tells whether the adapter echoes."""


@lru_cache(maxsize=256)
def _wanted(request: Request, may_echo: bool) -> _Wanted:
    mirrors = request.answered_by(request.adu) and _length(request) == len(request.adu)
    patterns: list[Pattern[_Key]] = []
    if may_echo:
        # Whatever is written may look like an answer: so an echo is known by its first bytes, and holds the others.
        patterns.append(Pattern(request.adu[:_ECHO_BEGINS], len(request.adu), (Kind.ECHO, request), holds=True))
    elif not mirrors:
        patterns.append(Pattern(request.adu, len(request.adu), (Kind.ECHO, request)))
    if request.length or request.sizer:
        patterns += _answers(request, Kind.NORMAL, Kind.EXCEPTION, Kind.REFUSAL, counts=True)
    return _Wanted(patterns, mirrors, tells=not (mirrors or request.writes))


def _length(request: Request) -> int:
    """How long a reply to the request is that begins like the request itself."""
    if request.sizer is None:
        return request.length
    try:
        return request.sizer(request.adu)
    except (IndexError, ValueError, TypeError):
        return 0


@lru_cache(maxsize=256)
def _late_answers(request: Request) -> Sequence[Pattern[_Key]]:
    return _answers(request, Kind.LATE, Kind.LATE_EXCEPTION, Kind.LATE)


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
