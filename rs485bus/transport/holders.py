"""Which programs have a serial port open. Linux tells, of one's own programs or of all to root."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path

_PTMX = os.makedev(5, 2) if hasattr(os, "makedev") else -1
_PTS_MAJOR = 136


def holders(port: str) -> dict[int, str]:
    """The processes that have a port open: their names by their numbers. It takes some time.

    Another process that holds the other end of a pseudo-terminal is none of them.
    """
    try:
        device = os.stat(port).st_rdev
    except OSError:
        return {}
    found = {}
    for process in _processes():
        if not any(_device(descriptor) == device for descriptor in _descriptors(process)):
            continue
        number = int(process.name)
        if number == os.getpid() or not _is_other_end(number, device):
            with contextlib.suppress(OSError):  # it has ended
                found[number] = (process / "comm").read_text().strip()
    return found


def others(port: str) -> list[str]:
    """The other programs that have a port open, such as "cat (process 123)". As `holders`."""
    return [f"{name} (process {number})" for number, name in sorted(holders(port).items()) if number != os.getpid()]


def _is_other_end(process: int, device: int) -> bool:
    if os.major(device) != _PTS_MAJOR:
        return False
    index = f"tty-index:\t{os.minor(device)}\n"
    for descriptor in _descriptors(Path("/proc", str(process))):
        if _device(descriptor) == _PTMX:
            try:
                if index in (descriptor.parents[1] / "fdinfo" / descriptor.name).read_text():
                    return True
            except OSError:
                continue
    return False


def _processes() -> Iterator[Path]:
    return Path("/proc").glob("[0-9]*")


def _descriptors(process: Path) -> list[Path]:
    try:
        return list((process / "fd").iterdir())
    except OSError:  # somebody else's, or it has ended
        return []


def _device(descriptor: Path) -> int | None:
    """The device that a file descriptor is open on."""
    try:
        status = descriptor.stat()
    except OSError:
        return None
    return status.st_rdev if stat.S_ISCHR(status.st_mode) else None
