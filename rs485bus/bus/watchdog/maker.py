"""Makes an armed watchdog from what is known of its device: how long a feed takes, answered or not. Pure."""

from __future__ import annotations

from rs485bus.bus.line.serial_line import SerialLine
from rs485bus.bus.record import Journal
from rs485bus.bus.schedule.burst import USUAL_TURNAROUND
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.watchdog.armed import ArmedWatchdog, Ledger


class WatchdogMaker:
    """Makes the armed watchdogs of one bus.

    Args:
        pair: the pair.
        journal: the latest transactions.
    """

    __slots__ = ("_journal", "_pair")

    def __init__(self, pair: SerialLine, journal: Journal) -> None:
        self._pair = pair
        self._journal = journal

    def make(self, unit: UnitState, timeout: float, since: float, turnaround: float | None = None) -> ArmedWatchdog:
        """The watchdog of a device.

        Args:
            unit: the device.
            timeout: the time of its watchdog, in seconds.
            since: since when it was heard, on the owner's clock.
            turnaround: seconds that it takes before it answers; None for what its latest answer took.
        """
        device, reads, pair = unit.attached, unit.reads(), self._pair
        assert device is not None
        line, quiet = pair.line, pair.silence + unit.pause
        longest = unit.reply_timeout + pair.latency
        overhead = line.airtime(len(reads[0].adu) + reads[0].length) + quiet
        if turnaround is None:
            turnaround = self._latest_turnaround(unit.address)
        return ArmedWatchdog(
            unit.address,
            timeout,
            overhead + turnaround,
            heard_at=since,
            armed_at=since,
            overhead=overhead,
            attempt=max(line.budget(len(read.adu), longest, read.length) for read in reads) + quiet,
            occupies=line.budget(device.longest, longest, 0) + quiet,
            ledger=unit.ledger or Ledger(),
        )

    def _latest_turnaround(self, address: int) -> float:
        answers = (record for record in reversed(self._journal.flight) if record.address == address and record.reply)
        latest = next(answers, None)
        return USUAL_TURNAROUND if latest is None else latest.turnaround(self._pair.line)
