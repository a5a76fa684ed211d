"""Finds requests and replies in the bytes of a pair that somebody else's master owns. Pure: bytes and times in, entries
out.

A frame is found by its CRC, at the lengths that a request or a reply of its function can have; silence ends what does
not become one. Nothing on the pair says who sends: what fits the last request is its reply, all else is a request, or a
reply that nobody asked for.

A write of one register is answered by the same bytes. So two equal frames are a request and its reply, or a request and
its repetition. Which, their distances tell: a reply comes soon, repetitions come at the master's timeout.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Final, NamedTuple

from rs485bus.bus.capture_lines import Drive, Entry, Exchange, Stray
from rs485bus.capture.pdu import spoken
from rs485bus.capture.vocabulary import family_of
from rs485bus.wire.answers import (
    DIAGNOSTICS,
    ENCAPSULATED,
    EVENT_COUNTER,
    EVENT_LOG,
    EXCEPTION_STATUS,
    MASK_WRITE,
    READ_COILS,
    READ_FIFO,
    READ_FILE,
    READ_INPUT,
    READ_WRITE,
    SERVER_ID,
    WRITE_COIL,
    WRITE_COILS,
    WRITE_FILE,
    WRITE_MULTIPLE,
    WRITE_SINGLE,
    answer_to,
)
from rs485bus.wire.crc import ends_in_crc
from rs485bus.wire.exceptions import is_exception
from rs485bus.wire.frames import BROADCAST, EXCEPTION_LENGTH, MAX_FRAME
from rs485bus.wire.timing import LineSettings

_SILENCE: Final = 0.03
"""Seconds without a byte after which a frame is over, at the least: an adapter hands bytes over late by up to 16 ms."""
_ANSWERS_WITHIN: Final = 1.0
"""Seconds after which a request is not answered any more."""
_SOON, _TIMES = 0.05, 10
"""A repetition without a reply comes later than this, and later than so many times the unit's slowest reply."""
_SHORTEST: Final = 4
_WORDS: Final = 256
"""Different answered requests of a unit that are kept to recognise it."""

_LENGTHS: Final = {
    **dict.fromkeys((*range(READ_COILS, READ_INPUT + 1), WRITE_COIL, WRITE_SINGLE, DIAGNOSTICS), 8),
    **dict.fromkeys((EXCEPTION_STATUS, EVENT_COUNTER, EVENT_LOG, SERVER_ID), 4),
    MASK_WRITE: 10,
    READ_FIFO: 6,
    ENCAPSULATED: 7,
}
"""Of requests that have one length."""
_COUNTED: Final = {
    WRITE_COILS: (6, 9),
    WRITE_MULTIPLE: (6, 9),
    READ_WRITE: (10, 13),
    READ_FILE: (2, 5),
    WRITE_FILE: (2, 5),
}
"""Where in a request its count of bytes stands, and how many bytes it has beside those."""
_COUNTED_REPLIES: Final = (*range(READ_COILS, READ_INPUT + 1), READ_WRITE)


class _Asked(NamedTuple):
    """A request that is not answered yet."""

    frame: bytes
    begin: float
    end: float
    attempt: int


class _Twin(NamedTuple):
    """A request, and the same bytes once more."""

    asked: _Asked
    begin: float
    end: float

    @property
    def gap(self) -> float:
        return self.begin - self.asked.end


class Sniffer:
    """Listens to a pair.

    Args:
        line: how characters travel.
        tell: takes what is found, in the order of the wire. Times are those given to `feed`.
    """

    def __init__(self, line: LineSettings, tell: Callable[[Entry], None]) -> None:
        self._line = line
        self._tell = tell
        self._buffer = bytearray()
        self._chunks: list[tuple[int, float]] = []
        """How many bytes came together, and when the last of them had come."""
        self._stray = bytearray()
        self._stray_since = 0.0
        self._asked: _Asked | None = None
        self._twin: _Twin | None = None
        self._unanswered: dict[bytes, int] = {}
        """How often a request was sent that was not answered."""
        self._slowest: dict[int, float] = {}
        """The longest time that each unit took to begin a reply that is none but a reply."""
        self._words: dict[int, set[bytes]] = {}
        self.families: dict[int, str] = {}
        self.bytes = 0
        self.frames = 0

    @property
    def wakes_at(self) -> float:
        """When to call `tick`, at the latest."""
        silent = self._chunks[-1][1] + self._silence if self._chunks else float("inf")
        last = self._twin or self._asked
        return min(silent, last.end + _ANSWERS_WITHIN if last is not None else float("inf"))

    def feed(self, data: bytes, now: float) -> None:
        """Bytes have come in; the last of them just now."""
        if self._chunks and now - self._line.airtime(len(data)) - self._chunks[-1][1] > self._silence:
            self._parse(silent=True)
        self.bytes += len(data)
        self._buffer += data
        self._chunks.append((len(data), now))
        self._parse(silent=False)

    def tick(self, now: float) -> None:
        """Time has passed."""
        if self._chunks and now - self._chunks[-1][1] >= self._silence:
            self._parse(silent=True)
        last = self._twin or self._asked
        if last is not None and now - last.end >= _ANSWERS_WITHIN:
            self._give_up(now)

    def end(self, now: float) -> None:
        """Nothing more comes."""
        self._parse(silent=True)
        self._give_up(now)

    @property
    def _silence(self) -> float:
        return max(_SILENCE, 2 * self._line.t35)

    # Frames

    def _parse(self, *, silent: bool) -> None:
        while self._buffer:
            data = bytes(self._buffer[:MAX_FRAME])
            lengths = list(self._lengths(data))
            found = _whole(data, lengths)
            if not found and silent and len(data) >= _SHORTEST and len(data) == len(self._buffer) and ends_in_crc(data):
                found = len(data)  # of a function that nobody knows
            if found:
                begin, end = self._take(found)
                self._tell_stray()
                self.frames += 1
                self._frame(data[:found], begin, end)
            elif silent or not _may_grow(lengths, len(data)) or (not lengths and self._holds_frame(data)):
                begin, end = self._take(1)
                if not self._stray:
                    self._stray_since = begin
                self._stray += data[:1]
                self._stray_until = end
            else:
                break
        if silent:
            self._tell_stray()

    def _holds_frame(self, data: bytes) -> bool:
        """Whether a frame of a known function begins behind the first byte: what precedes it is none then."""
        return any(_whole(data[at:], self._lengths(data[at:])) for at in range(1, len(data) - _SHORTEST + 1))

    def _lengths(self, data: bytes) -> Iterator[int]:
        """How long the frame that begins here may be, the likeliest first; more than there is to be waited for."""
        if len(data) < 2:
            yield _SHORTEST
            return
        function = data[1]
        asked = self._asked
        if asked is not None and data[0] == asked.frame[0] and function & 0x7F == asked.frame[1]:
            yield from _reply_lengths(asked.frame, data)
        if function in _LENGTHS:
            yield _LENGTHS[function]
        elif function in _COUNTED:
            at, beside = _COUNTED[function]
            yield beside + data[at] if len(data) > at else beside
        if function & 0x80:
            yield EXCEPTION_LENGTH
        elif function in _COUNTED_REPLIES:
            yield EXCEPTION_LENGTH + data[2] if len(data) > 2 else EXCEPTION_LENGTH

    def _take(self, count: int) -> tuple[float, float]:
        """Remove some bytes; return when the first of them began and the last ended."""
        del self._buffer[:count]
        size, at = self._chunks[0]
        begin = at - self._line.airtime(size)
        while count > size:
            count -= size
            self._chunks.pop(0)
            size, at = self._chunks[0]
        end = at - self._line.airtime(size - count)
        if count == size:
            self._chunks.pop(0)
        else:
            self._chunks[0] = (size - count, at)
        return begin, end

    def _tell_stray(self) -> None:
        if self._stray:
            self._tell(Stray(self._stray_since, self._stray_until, bytes(self._stray)))
            self._stray.clear()

    # What they mean

    def _frame(self, frame: bytes, begin: float, end: float) -> None:
        if self._twin is not None:
            if frame == self._twin.asked.frame:
                self._third(frame, begin, end)
                return
            self._settle_twin()
        asked = self._asked
        if asked is not None and _answers(asked.frame, frame):
            if frame == asked.frame:
                self._twin = _Twin(asked, begin, end)
                self._asked = None
                return
            self._asked = None
            slowest = self._slowest.get(frame[0], 0.0)
            self._slowest[frame[0]] = max(slowest, begin - asked.end)
            self._answered(asked, frame, begin, end)
        elif not _is_request(frame):
            self._tell(Exchange(begin, end, frame[0], b"", frame, "unasked"))
        else:
            self._give_up(begin)
            self._request(frame, begin, end)

    def _request(self, frame: bytes, begin: float, end: float) -> None:
        attempt = self._unanswered.get(frame, 0) + 1
        if frame[0] == BROADCAST:
            self._tell(Exchange(begin, end, BROADCAST, frame, b"", "broadcast"))
        else:
            self._asked = _Asked(frame, begin, end, attempt)

    def _answered(self, asked: _Asked, reply: bytes, begin: float, end: float) -> None:
        outcome = "refused" if is_exception(reply) else "reply"
        if asked.frame[1] in (WRITE_SINGLE, WRITE_MULTIPLE) and reply[:6] != asked.frame[:6]:
            outcome = "refused"  # as MKS drives do
        self._unanswered.clear()
        address = asked.frame[0]
        if outcome == "reply":
            self._recognise(address, asked.frame)
        self._tell(Exchange(asked.begin, end, address, asked.frame, reply, outcome, attempt=asked.attempt, first=begin))

    def _recognise(self, address: int, request: bytes) -> None:
        words = self._words.setdefault(address, set())
        if address in self.families or request in words or len(words) >= _WORDS:
            return
        words.add(request)
        family = family_of(map(spoken, words))
        if family is not None:
            self.families[address] = family
            self._tell(Drive(address, family))

    def _unheard(self, asked: _Asked, until: float) -> None:
        """A request was not answered."""
        if len(self._unanswered) >= _WORDS:
            self._unanswered.clear()
        self._unanswered[asked.frame] = asked.attempt
        self._tell(Exchange(asked.begin, until, asked.frame[0], asked.frame, b"", "no reply", attempt=asked.attempt))

    def _give_up(self, now: float) -> None:
        """What is open will not be answered."""
        if self._twin is not None:
            self._settle_twin()
        asked, self._asked = self._asked, None
        if asked is not None:
            self._unheard(asked, now)

    # Two equal frames

    def _third(self, frame: bytes, begin: float, end: float) -> None:
        """The same bytes for the third time."""
        twin, self._twin = self._twin, None
        assert twin is not None
        if twin.gap <= 2 * (begin - twin.end):
            # The second came about as late after the first as the third does, or sooner: a reply, and a new request;
            # or all are repetitions, where a reply would have come sooner.
            if self._is_late(twin):
                self._unheard(twin.asked, twin.begin)
                self._twin = _Twin(_Asked(frame, twin.begin, twin.end, twin.asked.attempt + 1), begin, end)
                return
            self._answered(twin.asked, frame, twin.begin, twin.end)
            self._request(frame, begin, end)
            return
        self._unheard(twin.asked, twin.begin)
        self._answered(_Asked(frame, twin.begin, twin.end, twin.asked.attempt + 1), frame, begin, end)

    def _settle_twin(self) -> None:
        """Something else comes, or nothing: the second was the reply, unless it came far too late for that."""
        twin, self._twin = self._twin, None
        assert twin is not None
        if self._is_late(twin):
            self._unheard(twin.asked, twin.begin)
            self._asked = _Asked(twin.asked.frame, twin.begin, twin.end, twin.asked.attempt + 1)
        else:
            self._answered(twin.asked, twin.asked.frame, twin.begin, twin.end)

    def _is_late(self, twin: _Twin) -> bool:
        return twin.gap > max(_SOON, _TIMES * self._slowest.get(twin.asked.frame[0], 0.0))


def _whole(data: bytes, lengths: Iterable[int]) -> int:
    """Which of some lengths the frame has that begins here; 0 if none is there as a whole."""
    return next((n for n in lengths if _SHORTEST <= n <= len(data) and ends_in_crc(data[:n])), 0)


def _may_grow(lengths: list[int], there: int) -> bool:
    """Whether what is there may become a frame: one of these lengths, or one that silence ends."""
    return any(there < length <= MAX_FRAME for length in lengths) if lengths else there < MAX_FRAME


def _reply_lengths(request: bytes, data: bytes) -> Iterator[int]:
    """How long a reply to a request may be that begins like this."""
    if data[1] & 0x80:
        yield EXCEPTION_LENGTH
        return
    answer = answer_to(request)
    if answer is None:
        return
    length = answer.length
    if answer.sizer is not None:
        length = answer.sizer(data) or len(data) + 1
    if length > 0:
        yield length


def _answers(request: bytes, frame: bytes) -> bool:
    """Whether a frame may be the reply to a request."""
    if frame[0] != request[0] or frame[1] & 0x7F != request[1]:
        return False
    if is_exception(frame):
        return True
    if frame[1] in (WRITE_SINGLE, WRITE_MULTIPLE):
        # A refusal of an MKS drive has other data behind the register.
        return len(frame) == 8 and frame[2:4] == request[2:4] and (frame[4:6] == request[4:6] or _refuses(frame))
    answer = answer_to(request)
    if answer is None:
        return True  # a function that nobody knows
    return frame.startswith(answer.prefix) and (not answer.length or len(frame) == answer.length)


def _refuses(frame: bytes) -> bool:
    return frame[4:6] == (b"\xff\xff" if frame[1] == WRITE_SINGLE else b"\0\0")


def _is_request(frame: bytes) -> bool:
    """Whether a frame that answers nothing is a request, by its length."""
    function = frame[1]
    if function & 0x80:
        return False
    if function in _COUNTED:
        at, beside = _COUNTED[function]
        return len(frame) > at and len(frame) == beside + frame[at]
    return len(frame) == _LENGTHS.get(function, len(frame))
