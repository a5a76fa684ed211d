"""Watchdogs that another program has left armed: turned off if that was asked for, and else named as a possible cause.

A program that was killed releases nothing. The drive then stops its motor whenever it is not asked for a while, in
every program after it; and an MKS does not tell that it has a watchdog armed.
"""

from __future__ import annotations

import itertools
import logging

from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.bus.stopping.halt import Procedure
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.bus.watchdog.settings import set_watchdog

_log = logging.getLogger("rs485bus")

_SHORTEST = 0.1
"""Seconds: nobody sets a watchdog to less."""
OPTION = 'BusConfig(foreign_watchdog="off")'


def turn_off(owner: Owner, device: DeviceAdapter) -> None:
    """Turn a device's watchdog off, whoever armed it. It is tried for some seconds, and logged if it is in vain."""

    def ended(job: Job | None) -> None:
        if job is not None and job.outcome is not Outcome.REPLY:
            _log.warning(
                "%s %d: its watchdog could not be turned off: %s. If another program has left it armed, it stops the "
                "motor whenever the drive is not asked for a while",
                device.family,
                device.address,
                "refused" if job.outcome is Outcome.REFUSED else "no answer",
            )

    owner.start(_turn_off(owner, device), ended)


def _turn_off(owner: Owner, device: DeviceAdapter) -> Procedure[Job | None]:
    unit, watchdog = owner.units[device.address], device.watchdog
    if watchdog is None or unit.guarded or unit.may_be_armed:
        return None
    job = yield from set_watchdog(owner, watchdog, watchdog.off)
    if job.outcome is Outcome.REPLY and not unit.guarded:
        owner.feeding.disarm(device.address)
    return job


def possible_cause(owner: Owner, device: DeviceAdapter) -> str:
    """Why a motor may have stopped that nobody stopped, as far as a watchdog can have done it; empty if none can.

    For messages: a sentence that says what to do.
    """
    unit, watchdog = owner.units[device.address], device.watchdog
    if watchdog is None or owner.feeding.get(device.address) is not None:
        return ""
    if unit.watchdog_ms == watchdog.off:
        return ""  # this program has turned it off
    unheard = _longest_unheard(owner, device)
    if unheard < _SHORTEST:
        return ""
    if unit.watchdog_ms is not None or unit.may_be_armed:
        return (
            f"Its own watchdog, which this program has set, may have stopped it: it was not asked for {unheard:.2f} s."
        )
    return (
        f"Its own watchdog may have stopped it: it was not asked for {unheard:.2f} s, and another program that was "
        f"killed may have left it armed. {OPTION} turns it off; a watchdog block sets it."
    )


def _longest_unheard(owner: Owner, device: DeviceAdapter) -> float:
    """The longest time for which the device acknowledged nothing since it was told to move, in seconds; 0 where nothing
    is known of that any more."""
    since = device.motion.commanded_at
    sent = [
        record.sent_at
        for record in owner.journal.flight
        if record.address == device.address and record.outcome == "reply" and record.sent_at >= since
    ]
    return max((after - before for before, after in itertools.pairwise(sent)), default=0.0)
