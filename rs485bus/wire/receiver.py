"""Finds the replies that are waited for in a stream of bytes.

It hunts byte by byte: noise, foreign frames, torn frames and frames from the wrong slave are passed over and
counted, and what follows them is still found. It never raises on bytes, and holds no more than one frame of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, NamedTuple, TypeVar

from rs485bus.wire.frames import MAX_FRAME, Sizer, crc

K = TypeVar("K")


class Pattern(NamedTuple, Generic[K]):
    """A frame that is waited for: it starts with `prefix` and is `length` bytes long.

    With a `sizer`, `length` is ignored and the frame tells its own. `key` says what the frame would be. Only
    patterns with `counts` set make a CRC error of a frame that begins right and fails its CRC.
    """

    prefix: bytes
    length: int
    key: K
    sizer: Sizer | None = None
    counts: bool = False


class Receiver(Generic[K]):
    """Bytes in, frames out.

    `skipped` counts the bytes that belonged to no frame waited for, `crc_errors` frames that only their CRC ruled
    out. Both only grow.
    """

    __slots__ = ("_buffer", "_patterns", "_searched", "crc_errors", "skipped")

    def __init__(self) -> None:
        self._patterns: Sequence[Pattern[K]] = ()
        self._searched: list[int] = []
        self._buffer = bytearray()
        self.skipped = 0
        self.crc_errors = 0

    @property
    def pending(self) -> int:
        """Bytes held that belong to no frame yet."""
        return len(self._buffer)

    def expect(self, patterns: Sequence[Pattern[K]]) -> None:
        """Wait for these frames from now on. What was received before is given up."""
        self.skipped += len(self._buffer)
        self._buffer.clear()
        self._patterns = patterns
        self._searched = [0] * len(patterns)

    def feed(self, data: bytes) -> list[tuple[K, bytes]]:
        """Take `data` in; return the frames it completes, in the order of the wire, each with its key."""
        buffer = self._buffer
        if not buffer:
            frame = self._whole(data)
            if frame is not None:
                return [(frame, data)]
        buffer += data
        found = []
        while buffer and (first := self._first()) is not None:
            start, end, key = first
            found.append((key, bytes(buffer[start:end])))
            self.skipped += start
            self._drop(end)
        return found

    def _whole(self, data: bytes) -> K | None:
        """The key of the frame that `data` is, no more and no less: the usual case, decided without a search."""
        for pattern in self._patterns:
            if data.startswith(pattern.prefix):
                if pattern.length == len(data) and pattern.sizer is None and crc(data[:-2]) == data[-2:]:
                    return pattern.key
                return None
        return None

    def _first(self) -> tuple[int, int, K] | None:
        """The frame that begins first among those that are complete; what can begin none is dropped."""
        best: tuple[int, int, K] | None = None
        size = len(self._buffer)
        keep = size
        for index, pattern in enumerate(self._patterns):
            begin, end = self._search(index, pattern)
            if end and (best is None or begin < best[0]):
                best = (begin, end, pattern.key)
            elif not end:
                keep = min(keep, begin)
        if best is None and keep:
            self.skipped += keep
            self._drop(keep)
        return best

    def _search(self, index: int, pattern: Pattern[K]) -> tuple[int, int]:
        """Where the pattern's first frame lies, or where one could still begin (end 0)."""
        buffer, prefix = self._buffer, pattern.prefix
        size = len(buffer)
        begun = -1
        at = buffer.find(prefix, self._searched[index])
        while at >= 0:
            length = pattern.length if pattern.sizer is None else _told(pattern.sizer, buffer[at:])
            if length == 0 or at + length > size:
                if begun < 0:
                    begun = at
                if pattern.sizer is None:
                    break  # one of the same length that begins later ends later
            elif length > 0:
                frame = bytes(buffer[at : at + length])
                if crc(frame[:-2]) == frame[-2:]:
                    self._searched[index] = at
                    return at, at + length
                self.crc_errors += pattern.counts
            at = buffer.find(prefix, at + 1)
        if begun < 0:
            begun = max(self._searched[index], size - len(prefix) + 1)
        self._searched[index] = begun
        return begun, 0

    def _drop(self, count: int) -> None:
        del self._buffer[:count]
        self._searched = [max(0, at - count) for at in self._searched]


def _told(sizer: Sizer, data: bytearray) -> int:
    """The length a reply claims: 0 if it cannot be told yet, -1 if it makes no sense."""
    try:
        length = sizer(bytes(data))
    except (IndexError, ValueError, TypeError):
        return 0 if len(data) < MAX_FRAME else -1
    return length if length == 0 or length >= 4 else -1
