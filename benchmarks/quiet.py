"""Whether the machine has anything else to do: what was disturbed is measured again (on Linux; believed elsewhere)."""

from __future__ import annotations

import os
import time
from pathlib import Path

_STAT = Path("/proc/stat")
_BUSY = (1, 2, 3, 6, 7, 8)
"""The columns of user, nice, system, irq, softirq and steal."""


def busy() -> float:
    """Seconds that all cores together have been busy, or were taken by a host."""
    if not _STAT.exists():
        return 0.0
    columns = _STAT.read_text().split("\n", 1)[0].split()
    return sum(int(columns[column]) for column in _BUSY) / os.sysconf("SC_CLK_TCK")


def spent(pid: int) -> float:
    """Seconds of core that a process has taken."""
    try:
        columns = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return 0.0
    return (int(columns[11]) + int(columns[12])) / os.sysconf("SC_CLK_TCK")


def wait_for_quiet(patience: float, known: tuple[int, ...], enough: float = 0.05) -> None:
    """Wait until others take no more than `enough` of a core, but no longer than `patience` seconds."""
    until = time.monotonic() + patience
    while time.monotonic() < until:
        others = Others(known)
        time.sleep(0.25)
        if others.share() <= enough:
            return


class Others:
    """How much of a core is taken from now on by others than us, our children that end, and the `known` processes."""

    def __init__(self, known: tuple[int, ...]) -> None:
        self._known = known
        self._begun = time.monotonic()
        self._busy = busy() - self._ours()

    def share(self) -> float:
        """Their part of one core since then."""
        return max(0.0, busy() - self._ours() - self._busy) / (time.monotonic() - self._begun)

    def _ours(self) -> float:
        times = os.times()
        own = times.user + times.system + times.children_user + times.children_system
        return own + sum(spent(pid) for pid in self._known)
