"""Finds the replies that are waited for in a stream of bytes.

It hunts byte by byte: noise, foreign frames, torn frames and frames from the wrong slave are passed over and
counted, and what follows them is still found. It never raises on bytes. It holds no more than one frame of them, and
takes a time that grows with their number alone, whatever they are.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Sequence
from typing import Generic, NamedTuple, TypeVar

from rs485bus.wire.crc import StreamCrc, ends_in_crc
from rs485bus.wire.frames import MAX_FRAME, Sizer

K = TypeVar("K")

_SHORTEST = 4
"""Address, function and CRC."""

_SLICE = 512

_Candidate = tuple[int, int, int, int]
"""What may be a frame: the position at which to look at it, its beginning, its pattern, its end (0: not known yet)."""


class Pattern(NamedTuple, Generic[K]):
    """A frame that is waited for: it starts with `prefix` and is `length` bytes long.

    With a `sizer`, `length` is ignored and the frame tells its own. `key` says what the frame would be.

    `counts` marks the frame that is awaited most: one that begins right and fails its CRC is a CRC error. While one of
    a fixed length has begun, a frame of another kind that lies inside it is taken for a part of it. `holds` marks one
    that comes once, before all others: while it has begun, that is so of every kind.
    """

    prefix: bytes
    length: int
    key: K
    sizer: Sizer | None = None
    counts: bool = False
    holds: bool = False


class Receiver(Generic[K]):
    """Bytes in, frames out.

    Where two frames overlap, the one that ends first is found: so it does not matter in which pieces bytes arrive.

    `skipped` counts the bytes that belonged to no frame waited for, `crc_errors` frames that only their CRC ruled
    out. Both only grow.
    """

    __slots__ = (
        "_begun",
        "_buffer",
        "_crc",
        "_holds",
        "_hunting",
        "_origin",
        "_patterns",
        "crc_errors",
        "passed",
        "skipped",
    )

    def __init__(self) -> None:
        self._patterns: Sequence[Pattern[K]] = ()
        self._holds = True
        """What comes before all others has not come yet."""
        self._hunting = False
        self._buffer = bytearray()
        # Positions count from the first byte after `expect`. The buffer begins at `_origin`.
        self._origin = 0
        self._begun: list[_Candidate] = []
        self._crc = StreamCrc()
        self.skipped = 0
        self.crc_errors = 0
        self.passed = b""
        """What was passed over right before the first frame that `feed` returned last."""

    @property
    def pending(self) -> int:
        """Bytes held that belong to no frame yet."""
        return len(self._buffer)

    @property
    def rest(self) -> bytes:
        """Those bytes."""
        return bytes(self._buffer)

    @property
    def begun(self) -> int:
        """How many of them there are from where a frame may have begun; 0 if none has."""
        begins = (begin for _, begin, _, _ in self._begun if begin >= self._origin)
        return self._origin + len(self._buffer) - min(begins, default=self._origin + len(self._buffer))

    def expect(self, patterns: Sequence[Pattern[K]]) -> None:
        """Wait for these frames from now on. What was received before is given up."""
        self._patterns = patterns
        self._holds = True
        if self._hunting:
            self._hunting = False
            self.skipped += len(self._buffer)
            self._buffer.clear()
            self._begun.clear()
            self._crc.restart()
            self._origin = 0

    def feed(self, data: bytes) -> list[tuple[K, bytes]]:
        """Take `data` in; return the frames it completes, in the order of the wire, each with its key."""
        if not self._buffer:
            key = self._whole(data)
            if key is not None:
                self.passed = b""
                return [(key, data)]
        self._hunting = True
        found: list[tuple[K, bytes]] = []
        if len(data) <= _SLICE:
            self._hunt(data, found)
        else:
            for at in range(0, len(data), _SLICE):
                self._hunt(data[at : at + _SLICE], found)
        return found

    def _whole(self, data: bytes) -> K | None:
        """The key of the frame that `data` is, no more and no less: the usual case, decided without a search."""
        for pattern in self._patterns:
            if data.startswith(pattern.prefix):
                if pattern.length == len(data) and pattern.sizer is None and ends_in_crc(data):
                    if pattern.holds:
                        self._holds = False
                    elif not pattern.counts and self._may_hold_others(data):
                        return None
                    return pattern.key
                return None
        return None

    def _may_hold_others(self, data: bytes) -> bool:
        return any(data.find(pattern.prefix, 1) >= 0 for pattern in self._patterns)

    def _hunt(self, data: bytes, found: list[tuple[K, bytes]]) -> None:
        """Take in `_SLICE` bytes at most."""
        buffer, begun = self._buffer, self._begun
        before = len(buffer) + 1
        buffer += data
        for index, pattern in enumerate(self._patterns):
            # Where its beginning ends among the bytes that are new.
            at = buffer.find(pattern.prefix, max(0, before - len(pattern.prefix)))
            if at >= 0:
                self._begin(index, pattern, at)
        if len(begun) > 1:
            begun.sort()
        reached = self._origin + len(buffer)
        if begun and begun[0][0] <= reached:
            self._crc.extend(buffer)
            self._judge(reached, found)
        surplus = len(buffer) - MAX_FRAME + 1
        if surplus > 0:
            self.skipped += surplus
            self._drop(surplus)

    def _begin(self, index: int, pattern: Pattern[K], at: int) -> None:
        """Frames of a pattern may begin in the buffer at `at`, and wherever its prefix stands behind that."""
        buffer, begun, origin = self._buffer, self._begun, self._origin
        prefix, length, sizer, find = pattern.prefix, pattern.length, pattern.sizer, buffer.find
        data = b"" if sizer is None else bytes(buffer)
        while at >= 0:
            begin = origin + at
            if sizer is None:
                begun.append((begin + length, begin, index, begin + length))
            elif (candidate := _sized(sizer, data[at : at + MAX_FRAME], begin, index)) is not None:
                begun.append(candidate)
            at = find(prefix, at + 1)

    def _judge(self, reached: int, found: list[tuple[K, bytes]]) -> None:
        """Look at what may be a frame, in the order in which they end."""
        buffer, begun, closes = self._buffer, self._begun, self._crc.closes
        at = 0
        while at < len(begun) and begun[at][0] <= reached:
            due, begin, index, end = begun[at]
            at += 1
            start = begin - self._origin
            if start < 0:
                continue  # it overlaps a frame that was found
            pattern = self._patterns[index]
            if not end:
                assert pattern.sizer is not None
                data = bytes(buffer[start : start + MAX_FRAME])
                if (candidate := _sized(pattern.sizer, data, begin, index)) is not None:
                    insort(begun, candidate, at)
            elif not closes(start, end - self._origin):
                self.crc_errors += pattern.counts
            elif due == end and (later := self._enclosed_until(pattern, begin, end)):
                insort(begun, (later, begin, index, end), at)
            else:
                if not found:
                    self.passed = bytes(buffer[:start])
                found.append((pattern.key, bytes(buffer[start : end - self._origin])))
                self.skipped += start
                self._drop(end - self._origin)
                if pattern.holds:
                    self._holds = False
        del begun[:at]

    def _enclosed_until(self, inner: Pattern[K], begin: int, end: int) -> int:
        """Where the last frame ends that holds this one and is not complete yet; 0 if there is none."""
        origin, until = self._origin, 0
        for pattern in self._patterns:
            if pattern.sizer is None and ((pattern.holds and self._holds) or (pattern.counts and not inner.counts)):
                # The last one that began no later, and whose beginning was there when the frame inside was complete.
                at = self._buffer.rfind(pattern.prefix, 0, min(begin + len(pattern.prefix), end) - origin)
                if at >= 0 and origin + at + pattern.length > end:
                    until = max(until, origin + at + pattern.length)
        return until

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self._crc.drop(count)
        self._origin += count


def _sized(sizer: Sizer, data: bytes, begin: int, index: int) -> _Candidate | None:
    """A frame that tells its own length, as far as it is there; None if it can be no frame."""
    try:
        length = sizer(data)
    except (IndexError, ValueError, TypeError):
        length = 0
    if _SHORTEST <= length <= len(data):
        return begin + length, begin, index, begin + length
    if length < 0 or len(data) == MAX_FRAME:
        return None
    # More is known with the next byte, or once as many are there as it must have.
    due = length if len(data) < length <= MAX_FRAME else len(data) + 1
    return begin + due, begin, index, 0
