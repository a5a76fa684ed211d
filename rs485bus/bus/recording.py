"""Writes a capture file while a bus goes on. The disk is waited for in a thread of its own.

The bus hands each record over and goes on at once. A file that has grown to its size is renamed to `name.1`, the former
`name.1` to `name.2`, and so on; the oldest is deleted. Each file has its own header, and can be read by itself.
"""

from __future__ import annotations

import logging
import os
import queue
import threading
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TextIO

from rs485bus.arguments import whole
from rs485bus.bus.capture_lines import FORMAT, Drive, Dropped, Entry, Header, entry_line, exchange_of, header_line
from rs485bus.bus.record import Record

_log = logging.getLogger("rs485bus")

MAX_BYTES = 20_000_000
KEEP = 4
_BACKLOG = 100_000
"""Entries that wait for the disk; of more, the newest are dropped."""
_END_TAKES = 5.0
"""Seconds for which closing waits for the disk."""


class Recording:
    """A capture that is being written; a context manager.

    Args:
        path: the file. A capture that is there already is kept, as `name.1`.
        header: what holds for all of it.
        max_bytes: how long one file may become: 10,000 bytes at the least.
        keep: how many older files are kept, 0..1000.

    Raises:
        ValueError: there is a file that is no capture, or an argument is out of its range.
        OSError: the file cannot be written.
    """

    def __init__(
        self, path: str | os.PathLike[str], header: Header, *, max_bytes: int = MAX_BYTES, keep: int = KEEP
    ) -> None:
        self.path = Path(path)
        self.error: OSError | None = None
        """Why nothing is written any more."""
        self.count = 0
        """Entries taken."""
        self.dropped = 0
        """Entries that were lost because the disk was too slow."""
        self._header = header
        self._max_bytes = whole("max_bytes", max_bytes, 10_000)
        self._keep = whole("keep", keep, 0, 1000)
        self._drives: dict[int, Drive] = {}
        self._told_dropped = 0
        self._size = 0
        _check_capture(self.path)
        self._file = self._begin()
        self._waiting: queue.SimpleQueue[Entry | None] = queue.SimpleQueue()
        self._at_end: list[Callable[[], None]] = []
        self._thread = threading.Thread(target=self._write, name=f"rs485bus recording {self.path.name}", daemon=True)
        self._thread.start()

    def put(self, entry: Entry) -> None:
        """Take an entry. It returns at once."""
        if self._waiting.qsize() >= _BACKLOG:
            self.dropped += 1
            return
        self.count += 1
        self._waiting.put(entry)

    def on_close(self, callback: Callable[[], None]) -> None:
        """Have `callback` called when it ends: what hands it entries is to end that."""
        self._at_end.append(callback)

    def close(self) -> None:
        """End it. What was taken is written first. More often than once does no harm."""
        while self._at_end:
            self._at_end.pop()()
        self._waiting.put(None)
        self._thread.join(_END_TAKES)
        if self._thread.is_alive():
            _log.error("%s: the disk is too slow: the end of the capture may be missing", self.path)

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # In the thread

    def _write(self) -> None:
        while True:
            entry = self._waiting.get()
            if entry is None:
                break
            if self.error is not None:
                continue
            try:
                self._add(entry)
                if self._waiting.empty():
                    self._file.flush()
            except OSError as error:
                self.error = error
                _log.error("%s: nothing is recorded any more: %s", self.path, error)
        try:
            self._file.close()
        except OSError as error:
            self.error = self.error or error

    def _add(self, entry: Entry) -> None:
        if isinstance(entry, Drive):
            self._drives[entry.address] = entry
        elif self.dropped > self._told_dropped:
            lost, self._told_dropped = self.dropped - self._told_dropped, self.dropped
            self._put_line(self._file, entry_line(Dropped(entry.at, lost)))
        if self._size >= self._max_bytes:
            self._file.close()
            self._file = self._begin()
        self._put_line(self._file, entry_line(entry))

    def _begin(self) -> TextIO:
        """Begin a new file. The one that is there becomes an older one."""
        if self.path.exists():
            self._put_away()
        file = open(self.path, "w", encoding="utf-8")  # noqa: SIM115 - closed by the thread
        self._size = 0
        self._put_line(file, header_line(self._header))
        for drive in self._drives.values():
            self._put_line(file, entry_line(drive))
        file.flush()
        return file

    def _put_line(self, file: TextIO, line: str) -> None:
        file.write(line)
        self._size += len(line)

    def _put_away(self) -> None:
        names = [self.path, *(self.path.with_name(f"{self.path.name}.{age}") for age in range(1, self._keep + 1))]
        for older, newer in zip(names[:0:-1], names[-2::-1], strict=True):
            if newer.exists():
                newer.replace(older)


class BusRecorder:
    """Hands the records of a bus to a recording.

    Args:
        recording: what takes them.
        since: when it began, on the bus' clock.
        family: tells the family of the drive at an address, if that is known.
    """

    def __init__(self, recording: Recording, since: float, family: Callable[[int], str | None]) -> None:
        self._recording = recording
        self._since = since
        self._family = family
        self._known: dict[int, str] = {}

    def __call__(self, record: Record) -> None:
        address = record.address
        family = self._family(address)
        if family is not None and self._known.get(address) != family:
            self._known[address] = family
            self._recording.put(Drive(address, family))
        self._recording.put(exchange_of(record, self._since))


def _check_capture(path: Path) -> None:
    """Refuse to put away a file that is no capture."""
    if not path.exists():
        return
    with open(path, "rb") as file:
        begin = file.read(64)
    if begin and not begin.startswith(b'{"capture": "' + FORMAT.encode()):
        raise ValueError(f"{path} is there, and is no capture: name another file to record to")
