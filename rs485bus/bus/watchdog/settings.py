"""Reading and setting the watchdog register of one device. Pure: steps of procedures that the owner drives."""

from __future__ import annotations

import math

from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.job import Job, Outcome, Urgency
from rs485bus.bus.stopping.halt import Procedure
from rs485bus.bus.units.adapter import DeviceAdapter, WatchdogRegister
from rs485bus.errors import LimitExceeded, NotSupported
from rs485bus.wire.frames import Request

RETRIES = 3
"""How often setting a watchdog is repeated: one that stays on though it should be off trips in the next program."""
_PATIENCE = 2.0
"""Seconds in which a frame that arms or releases a watchdog must have its turn: only stops and feeds go before it."""


def check_watchdog(attached: DeviceAdapter, timeout: float) -> int:
    """The milliseconds that a device's watchdog is set to for `timeout` seconds.

    Raises:
        NotSupported: it has none.
        LimitExceeded: its register cannot hold the time.
    """
    watchdog = attached.watchdog
    if watchdog is None:
        raise NotSupported(
            f"{attached.family} {attached.address} has no watchdog: it does not notice when the host is gone. "
            "Cut its power by a safety relay that something else watches."
        )
    milliseconds = round(timeout * 1000) if math.isfinite(timeout * 1000) else 0
    if not 1 <= milliseconds <= watchdog.highest:
        raise LimitExceeded(
            f"A watchdog of {timeout:g} s is outside 0.001..{watchdog.highest / 1000:.10g} s for "
            f"{attached.family} {attached.address}."
        )
    return milliseconds


def patient(owner: Owner, request: Request, retries: int | None = None) -> Job:
    """A job of arming or releasing: it goes before what applications ask for, and does not wait for ever."""
    attempts = 1 + (owner.config.retries if retries is None else retries)
    unit = owner.units[request.address]
    budget = owner.pair.line.budget(len(request.adu), unit.reply_timeout, request.length) + owner.pair.silence
    expires_at = owner.now + _PATIENCE + attempts * budget
    return Job(request, urgency=Urgency.FEED, internal=True, retries=retries, expires_at=expires_at)


def look_at(owner: Owner, watchdog: WatchdogRegister) -> Procedure[Job | None]:
    """Read what a watchdog is set to. None where that cannot be read."""
    request = watchdog.read()
    if request is None:
        return None
    job = patient(owner, request)
    yield job
    return job


def set_watchdog(owner: Owner, watchdog: WatchdogRegister, milliseconds: int) -> Procedure[Job]:
    """Set a watchdog, and read it back where that can be done. Returns the job that tells whether it is set."""
    write = patient(owner, watchdog.write(milliseconds), RETRIES)
    yield write
    if write.outcome is not Outcome.REPLY:
        return write
    back = yield from look_at(owner, watchdog)
    if back is None or back.outcome is not Outcome.REPLY:
        return back or write
    if watchdog.decode(back.reply) != milliseconds:
        write.outcome = Outcome.REFUSED  # it said yes and did not do it
    return write
