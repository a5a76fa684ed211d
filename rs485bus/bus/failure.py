"""Which exception a job's end is, and what it says. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TypedDict

from rs485bus.bus.line.diagnosis import CHECK, tell
from rs485bus.bus.record import Record
from rs485bus.bus.schedule.job import Job, Outcome, Reason
from rs485bus.bus.schedule.waiting import WHAT_TO_LOOK_FOR
from rs485bus.errors import (
    BusClosed,
    DeviceOffline,
    DeviceRefused,
    EmergencyStopped,
    LineBusy,
    NoReply,
    NotSent,
    OutcomeUnknown,
    QueueFull,
    RequestFailed,
)
from rs485bus.wire.exceptions import Meaning, exception, is_all_or_nothing
from rs485bus.wire.frames import Request

_NOT_SENT: dict[Reason, tuple[type[NotSent], str]] = {
    Reason.CANCELLED: (NotSent, "its caller was cancelled before it could be sent"),
    Reason.EXPIRED: (NotSent, "its time was over before it could be sent. Ask less often, or allow more time"),
    Reason.LINE_BUSY: (
        LineBusy,
        f"the line was never quiet: bytes kept coming that belong to no answer. Look for {WHAT_TO_LOOK_FOR}",
    ),
    Reason.ECHO: (
        NotSent,
        "its time was over before it was known whether the adapter returns what is sent, which would look like an "
        "answer: no read has been answered yet. Check the power, the address, the baud rate and the wires of the "
        "devices; or say BusConfig(echo=False), or echo=True",
    ),
    Reason.OWED: (
        NotSent,
        "all its time a late reply could still arrive that would have been taken for its answer. Its device leaves "
        "requests unanswered, or answers too late: allow more time (timeout, reply_timeout), and look for what the "
        "line loses",
    ),
    Reason.STOPPING: (
        NotSent,
        "its time was over while the axis was being stopped. Await its stop() first; if that is not confirmed, look at "
        "the machine",
    ),
    Reason.UNCONFIRMED: (
        NotSent,
        "a stop before it was said three times and could not be confirmed. Look at the machine, use the hard-wired "
        "stop; then await stop() or enable() first",
    ),
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
_MEANWHILE = {
    Reason.UNPLUGGED: " The port was lost meanwhile.",
    Reason.UNAWAITED: " Its time was over before the device had to answer: allow more time.",
}
_AWAY = (Reason.UNPLUGGED, Reason.EXPIRED)
"""What keeps a job from being sent while the port is away, or comes for moments only."""
_ILLEGAL_FUNCTION = 1
_UNKNOWN_TO_IT = (_ILLEGAL_FUNCTION, 2)


class _Details(TypedDict):
    address: int
    request: bytes
    attempts: int
    code: int | None


def failure(
    job: Job,
    records: Sequence[Record],
    family: str | None = None,
    port: str = "",
    advice: str = "",
    explain: Callable[[bytes], str] = lambda heard: "",
    refusals: Mapping[int, str] | None = None,
) -> RequestFailed:
    """The exception that says how the job ended, for every end but a reply.

    Args:
        job: what has ended.
        records: the latest transactions on the bus.
        family: what the device is taken for; None where it has no facade.
        port: why the port is away, and what to do about it; empty where it is there.
        advice: what explains that answers do not come; empty where nothing is known.
        explain: what some bytes mean that are no answer, or that there are none, in view of the device asked; empty
            where that is nothing special.
        refusals: what exception codes mean to the device, where it gives them a meaning of its own.
    """
    details = _Details(address=job.address, request=job.request.adu, attempts=job.attempts, code=job.code)
    what = str(job.request)
    if job.outcome is Outcome.REFUSED:
        return DeviceRefused(_refused(job, family, refusals or {}), **details)
    if job.outcome is Outcome.NOT_SENT:
        error, why = _NOT_SENT[job.reason]
        if port and job.reason in _AWAY:
            why = f"the port is away, and is opened again by itself. {port.rstrip('.')}"
        elif advice and job.reason is Reason.LINE_BUSY:
            why = f"{why}. {advice.rstrip('.')}"
        return error(f"Not sent, {why}: {what}.", **details)
    again = f" It was not sent again, {_NOT_SENT[job.reason][1]}." if job.reason in _NOT_SENT else ""
    again = _MEANWHILE.get(job.reason, again) + (advice and f" {advice}")
    if port and job.reason is Reason.UNPLUGGED:
        again = f"{_MEANWHILE[job.reason]} {port.rstrip('.')}."
    if job.outcome is Outcome.NO_REPLY:
        return NoReply(
            f"No reply, {_sent(job)}: {what}.{again} {_check(job, explain)} The request may be repeated safely.",
            **details,
        )
    came = _came(job, explain)
    return OutcomeUnknown(
        f"Nobody knows whether it was done, {_sent(job)}: {what}.{_seen(job)}{again} "
        f"{came and came + ' '}Read back what the device did before you repeat it.",
        records=records,
        **details,
    )


def _refused(job: Job, family: str | None, refusals: Mapping[int, str]) -> str:
    """What a refusal says, and whether a part of it may have been done all the same."""
    if job.code is not None and job.code in refusals:
        said = f"{family} {job.address} refuses, {refusals[job.code]} (exception {job.code:02})"
        return f"{said}: {job.request}. {what_was_done(job.request, job.code)}"
    named = "in its reply" if job.code is None else named_exception(job.code)
    return f"Refused, {named}: {job.request}. {what_was_done(job.request, job.code)}{_stranger(job.code, family)}"


def named_exception(code: int) -> str:
    """An exception code with its meaning."""
    return f"{exception(code).name} (exception {code:02})"


def what_was_done(request: Request, code: int | None) -> str:
    """What a device has done of a request that it refused."""
    if exception(code or 0).meaning is Meaning.BUSY:
        return "Nothing was done. Ask again later."
    if code in (None, _ILLEGAL_FUNCTION) or is_all_or_nothing(request):
        return "Nothing was done."
    return "A part of the block may have been written: read it back."


def _stranger(code: int | None, family: str | None) -> str:
    if family is None or code not in _UNKNOWN_TO_IT:
        return ""
    return f" It may be another drive than the {family} that the facade at its address is for."


def _sent(job: Job) -> str:
    """How often it was sent, and what came of that."""
    times = f"sent {job.attempts} time{'s' * (job.attempts > 1)}"
    if job.code is None:
        return f"{times} without an answer" if job.outcome is Outcome.UNKNOWN else times
    if exception(job.code).meaning is Meaning.UNANSWERED:
        return f"{times}; the gateway says: {named_exception(job.code)}"
    return f"{times}; the device says: {named_exception(job.code)}"


def _seen(job: Job) -> str:
    """What came of reading it back."""
    times = f"{job.read_backs} time{'s' * (job.read_backs > 1)}"
    return f" Reading it back, {times}, did not show it." if job.read_backs else ""


def _came(job: Job, explain: Callable[[bytes], str]) -> str:
    """What came instead of an answer."""
    rest = b"" if job.heard is None else job.heard.rest
    return (rest and explain(rest)) or tell(job.request, job.heard)


def _check(job: Job, explain: Callable[[bytes], str]) -> str:
    """What came instead of an answer, and what to look at where nobody answers."""
    if job.code is not None:
        return (
            "The gateway answers: check the device's power and address, and the gateway's wires A and B, baud rate and "
            "parity, and its timeout."
        )
    return _came(job, explain) or " ".join(filter(None, (CHECK, explain(b""))))
