"""Which exception a job's end is, and what it says. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

from rs485bus.bus.record import Record
from rs485bus.bus.schedule.job import Job, Outcome, Reason
from rs485bus.errors import (
    BusClosed,
    DeviceOffline,
    DeviceRefused,
    EmergencyStopped,
    NoReply,
    NotSent,
    OutcomeUnknown,
    QueueFull,
    RequestFailed,
)

_NOT_SENT: dict[Reason, tuple[type[NotSent], str]] = {
    Reason.CANCELLED: (NotSent, "its caller was cancelled before it could be sent"),
    Reason.EXPIRED: (NotSent, "its time was over before it could be sent. Ask less often, or allow more time"),
    Reason.STOPPED: (NotSent, "the axis was stopped first"),
    Reason.EMERGENCY: (
        EmergencyStopped,
        "an emergency stop was made. Look at the machine, then clear_emergency_stop()",
    ),
    Reason.LATCHED: (EmergencyStopped, "the bus is latched by an emergency stop: clear_emergency_stop() first"),
    Reason.OFFLINE: (
        DeviceOffline,
        "the device has stopped answering. Check its power, its address and the cable; the bus looks for it by itself",
    ),
    Reason.LOCKED: (NotSent, "the axis was stopped for safety: enable() it first"),
    Reason.DISRUPTIVE: (
        NotSent,
        "a watchdog on this bus is armed, and the device would be too slow to answer, or not answer for a while "
        "afterwards. Leave the watchdog block first",
    ),
    Reason.TOO_LONG: (NotSent, "it would take the pair for so long that an armed watchdog could trip"),
    Reason.BURST_TOO_LONG: (
        NotSent,
        "the frames that start this group would take the pair for so long that an armed watchdog could trip. Put fewer "
        "axes of one pair into a group, or use longer watchdogs or a faster line",
    ),
    Reason.BROKEN_OFF: (NotSent, "what was to start with it did not"),
    Reason.UNPLUGGED: (NotSent, "the port is gone. Plug it in again; the bus reopens it by itself"),
    Reason.QUEUE_FULL: (QueueFull, "too many requests wait already. Ask for less at once"),
    Reason.CLOSED: (BusClosed, "the bus is closed"),
}
_EXCEPTIONS = {
    1: "illegal function",
    2: "illegal register address",
    3: "illegal value",
    4: "execution failed or denied",
    5: "acknowledged, still working",
    6: "busy",
    8: "memory parity error",
    10: "gateway path unavailable",
    11: "gateway target did not respond",
}


_UNKNOWN_TO_IT = (1, 2)


class _Details(TypedDict):
    address: int
    request: bytes
    attempts: int


def failure(job: Job, records: Sequence[Record], family: str | None = None) -> RequestFailed:
    """The exception that says how the job ended, for every end but a reply.

    Args:
        job: what has ended.
        records: the latest transactions on the bus.
        family: what the device is taken for; None where it has no facade.
    """
    details = _Details(address=job.address, request=job.request.adu, attempts=job.attempts)
    what = str(job.request)
    if job.outcome is Outcome.REFUSED:
        named = (
            "in its reply" if job.code is None else f"{_EXCEPTIONS.get(job.code, 'unknown')} (exception {job.code:02})"
        )
        stranger = ""
        if family is not None and job.code in _UNKNOWN_TO_IT:
            stranger = f" It may be another drive than the {family} that the facade at its address is for."
        return DeviceRefused(f"Refused, {named}: {what}. Nothing was done.{stranger}", code=job.code, **details)
    if job.outcome is Outcome.NOT_SENT:
        error, why = _NOT_SENT[job.reason]
        return error(f"Not sent, {why}: {what}.", **details)
    lost = " The port was lost meanwhile." if job.reason is Reason.UNPLUGGED else ""
    sent = f"sent {job.attempts} time{'s' * (job.attempts > 1)}"
    if job.outcome is Outcome.NO_REPLY:
        return NoReply(
            f"No reply, {sent}: {what}.{lost} Check the device's power, address, baud rate and parity, and the wires "
            "A and B. The request may be repeated safely.",
            **details,
        )
    return OutcomeUnknown(
        f"Nobody knows whether it was done, {sent} without an answer: {what}.{lost} "
        "Read back what the device did before you repeat it.",
        records=records,
        **details,
    )
