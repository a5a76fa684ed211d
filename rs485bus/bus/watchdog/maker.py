"""Makes an armed watchdog from what is known of its device: how long a feed takes, answered or not. Pure."""

from __future__ import annotations

from rs485bus.bus.record import Journal
from rs485bus.bus.schedule.burst import USUAL_TURNAROUND
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.watchdog.armed import ArmedWatchdog, Ledger
from rs485bus.wire.timing import LineSettings


class WatchdogMaker:
    """Makes the armed watchdogs of one bus.

    Args:
        line: how characters travel.
        silence: seconds that must stand between two frames.
        journal: the latest transactions.
    """

    __slots__ = ("_journal", "_line", "_silence")

    def __init__(self, line: LineSettings, silence: float, journal: Journal) -> None:
        self._line = line
        self._silence = silence
        self._journal = journal

    def make(self, unit: UnitState, timeout: float, since: float, turnaround: float | None = None) -> ArmedWatchdog:
        """The watchdog of a device.

        Args:
            unit: the device.
            timeout: the time of its watchdog, in seconds.
            since: since when it was heard, on the owner's clock.
            turnaround: seconds that it takes before it answers; None for what its latest answer took.
        """
        device = unit.attached
        assert device is not None
        line, quiet, feed = self._line, self._silence + unit.pause, device.reads()[0]
        if turnaround is None:
            turnaround = self._latest_turnaround(unit.address)
        return ArmedWatchdog(
            unit.address,
            timeout,
            line.budget(len(feed.adu), turnaround, feed.length) + quiet,
            heard_at=since,
            armed_at=since,
            attempt=line.budget(len(feed.adu), unit.reply_timeout, feed.length) + quiet,
            occupies=line.budget(device.longest, unit.reply_timeout, 0) + quiet,
            ledger=unit.ledger or Ledger(),
        )

    def _latest_turnaround(self, address: int) -> float:
        answers = (record for record in reversed(self._journal.flight) if record.address == address and record.reply)
        latest = next(answers, None)
        return USUAL_TURNAROUND if latest is None else latest.turnaround(self._line)
