"""What the watchdog registers of the devices on one bus hold, as far as this bus wrote it, for whomever. Pure.

A device whose register is made shorter behind the back of what feeds it would trip. So every write to such a register
is seen when it is sent, and again when it is acknowledged.
"""

from __future__ import annotations

from collections.abc import Callable

from rs485bus.bus.schedule.job import Job
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.watchdog.feeding import ArmedWatchdog, Feeding
from rs485bus.bus.watchdog.report import warn_of_off


class RegisterWrites:
    """Sees the writes to watchdog registers.

    Args:
        feeding: the armed watchdogs.
        hearing: the attached devices that would act on a job.
        make: makes the watchdog of a device that is on from now on, from its time and since when it was heard.
    """

    __slots__ = ("_feeding", "_hearing", "_make")

    def __init__(
        self,
        feeding: Feeding,
        hearing: Callable[[Job], list[UnitState]],
        make: Callable[[UnitState, float, float], ArmedWatchdog],
    ) -> None:
        self._feeding = feeding
        self._hearing = hearing
        self._make = make

    def sent(self, job: Job) -> None:
        """A write goes out. A shorter time may hold from now on, whether it is acknowledged or not."""
        for unit in self._hearing(job):
            milliseconds = _set_by(unit, job)
            if milliseconds is None:
                continue
            unit.watchdog_ms = None
            watch = self._feeding.get(unit.address)
            if watch is not None and 0 < milliseconds < 1000 * watch.timeout:
                self._feeding.set_timeout(watch, milliseconds / 1000)

    def acknowledged(self, job: Job, unit: UnitState) -> None:
        """The device took the write."""
        milliseconds = _set_by(unit, job)
        if milliseconds is None:
            return
        unit.watchdog_ms = milliseconds
        if job.internal or unit.attached is None or unit.attached.watchdog is None:
            return  # who arms and releases keeps the books
        watch = self._feeding.get(unit.address)
        if milliseconds == unit.attached.watchdog.off:
            if unit.guarded:
                warn_of_off(unit.address)
            else:
                self._feeding.disarm(unit.address)
        elif watch is not None:
            self._feeding.set_timeout(watch, milliseconds / 1000)
        elif unit.attached.watchdog.read() is not None and not unit.guarded:
            # What can be read is fed whenever it is on.
            self._feeding.arm(self._make(unit, milliseconds / 1000, job.sent_at))


def _set_by(unit: UnitState, job: Job) -> int | None:
    attached = unit.attached
    if attached is None or attached.watchdog is None:
        return None
    return attached.watchdog.set_by(job.request)
