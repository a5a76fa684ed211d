"""The capture file: what happened on a pair, as lines of JSON. Pure.

Each line is one object, in UTF-8. All times are seconds since the capture began. Bytes are hexadecimal digits. Readers
pass over keys and kinds of lines that they do not know. Version 1 has these lines:

The header, which is the first line of each file:

    {"capture": "rs485bus", "version": 1, "by": "bus", "started": "2026-05-04T10:11:12.131415+00:00",
     "port": "/dev/ttyUSB0", "baudrate": 115200, "parity": "N", "stopbits": 1}

`by` is "bus" where the program that owned the pair recorded it, and "sniffer" where somebody listened to it. `started`
is the time of day at which the capture began. A file that continues another one has the same `started`.

A drive that is known by now. A line of the kind stands before the first exchange with the drive, in each file:

    {"unit": 5, "family": "MKS"}

An exchange: a request and what answered it.

    {"at": 0.0123, "unit": 5, "for": "poll", "attempt": 1, "request": "050400310003e2e0", "first": 0.0161,
     "reply": "0504060000000012344d2f", "ended": 0.0178, "outcome": "reply", "queued": 0.0101, "skipped": 0}

`at` is when the request began and `ended` when it was over; `first` is when its first byte came back, if one did. `for`
is what it was sent for: "stop", "start", "feed", "confirm", "command" or "poll"; it is missing where that is not known.
`attempt` counts from 1. `outcome` is "reply", "refused", "no reply", "cut", "lost", "broadcast" or "sent", as in a
`Record`; or "unasked" for a frame without a request. `skipped` counts bytes that belonged to nothing. `attempt` 1,
`skipped` 0, empty frames, and `queued` and `first` where they are not known, may be missing.

Bytes that belong to no frame; only a sniffer knows them:

    {"at": 1.5, "stray": "00ff13", "ended": 1.5003}

Records that were lost because the disk was too slow:

    {"at": 2.5, "dropped": 17}
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final, Literal, NamedTuple

from rs485bus.bus.record import Record
from rs485bus.wire.timing import LineSettings

VERSION: Final = 1
FORMAT: Final = "rs485bus"


class Exchange(NamedTuple):
    """A request and what answered it. All times are seconds since the capture began."""

    at: float
    """When the request began."""
    ended: float
    address: int
    request: bytes
    """Empty for a frame that nobody had asked for."""
    reply: bytes
    outcome: str
    urgency: str = ""
    """What it was sent for, in lower case; empty where that is not known."""
    attempt: int = 1
    first: float | None = None
    """When its first byte came back."""
    queued: float | None = None
    skipped: int = 0
    """Bytes that came meanwhile and belonged to nothing."""

    @property
    def latency(self) -> float:
        """Seconds from the start of sending to the end."""
        return self.ended - self.at

    @property
    def repeated(self) -> bool:
        """Whether the same request had been sent before. What confirms a stop asks again until it knows."""
        return self.attempt > 1 and self.urgency != "confirm"

    @property
    def failed(self) -> bool:
        """Whether it was not answered as it was meant to be."""
        return self.outcome not in ("reply", "broadcast", "sent")


class Stray(NamedTuple):
    """Bytes that belong to no frame."""

    at: float
    ended: float
    data: bytes


class Drive(NamedTuple):
    """A drive is known to be of a family."""

    address: int
    family: str


class Dropped(NamedTuple):
    """So many records were lost by then."""

    at: float
    lost: int


Entry = Exchange | Stray | Drive | Dropped


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """What holds for a whole capture."""

    port: str
    line: LineSettings
    started: str
    """The time of day at which it began, in UTC, by ISO 8601."""
    by: Literal["bus", "sniffer"] = "bus"
    version: int = field(default=VERSION)

    @classmethod
    def now(cls, port: str, line: LineSettings) -> Header:
        """That of a capture which begins now."""
        return cls(port=port, line=line, started=datetime.now(UTC).isoformat())


def exchange_of(record: Record, since: float) -> Exchange:
    """A record of the bus, in a capture that began at a time on the bus' clock."""
    first = record.first_byte_at
    return Exchange(
        record.sent_at - since,
        record.ended_at - since,
        record.address,
        record.request,
        record.reply,
        record.outcome,
        record.urgency.name.lower(),
        record.attempt,
        None if first is None else first - since,
        record.queued_at - since,
        record.skipped,
    )


def header_line(header: Header) -> str:
    """The first line of a file."""
    line = header.line
    return _line(
        capture=FORMAT,
        version=header.version,
        by=header.by,
        started=header.started,
        port=header.port,
        baudrate=line.baudrate,
        parity=line.parity,
        stopbits=line.stopbits,
    )


def entry_line(entry: Entry) -> str:
    """The line of an entry."""
    if isinstance(entry, Drive):
        return _line(unit=entry.address, family=entry.family)
    if isinstance(entry, Stray):
        return _line(at=_time(entry.at), stray=entry.data.hex(), ended=_time(entry.ended))
    if isinstance(entry, Dropped):
        return _line(at=_time(entry.at), dropped=entry.lost)
    told: dict[str, Any] = {"at": _time(entry.at), "unit": entry.address}
    if entry.urgency:
        told["for"] = entry.urgency
    told["attempt"] = entry.attempt
    if entry.request:
        told["request"] = entry.request.hex()
    if entry.first is not None:
        told["first"] = _time(entry.first)
    if entry.reply:
        told["reply"] = entry.reply.hex()
    told |= {"ended": _time(entry.ended), "outcome": entry.outcome}
    if entry.queued is not None:
        told["queued"] = _time(entry.queued)
    if entry.skipped:
        told["skipped"] = entry.skipped
    return _line(**told)


def read_header(line: str) -> Header:
    """What the first line says.

    Raises:
        ValueError: it is not the first line of a capture, or of a version that is not known.
    """
    told = _object(line)
    if told.get("capture") != FORMAT:
        raise ValueError('it does not begin with {"capture": "rs485bus", ...}')
    version = told.get("version")
    if version != VERSION:
        raise ValueError(f"it has version {version} of the format, and this rs485bus knows {VERSION}: update rs485bus")
    try:
        return Header(
            port=str(told["port"]),
            line=LineSettings(
                baudrate=told["baudrate"], parity=told.get("parity", "N"), stopbits=told.get("stopbits", 1)
            ),
            started=datetime.fromisoformat(told["started"]).isoformat(),
            by="sniffer" if told.get("by") == "sniffer" else "bus",
        )
    except KeyError as missing:
        raise ValueError(f"its header says no {missing.args[0]}") from None
    except (TypeError, ValueError) as error:
        raise ValueError(f"its header is wrong: {error}") from None


def read_entry(line: str) -> Entry | None:
    """What another line says; None for a kind of line that is not known.

    Raises:
        ValueError: it is broken.
    """
    told = _object(line)
    try:
        if "family" in told:
            return Drive(_whole(told["unit"]), str(told["family"]))
        if "stray" in told:
            at = _seconds(told["at"])
            return Stray(at, _seconds(told.get("ended", at)), bytes.fromhex(told["stray"]))
        if "dropped" in told:
            return Dropped(_seconds(told["at"]), _whole(told["dropped"]))
        if "outcome" not in told:
            return None
        first, queued = told.get("first"), told.get("queued")
        return Exchange(
            _seconds(told["at"]),
            _seconds(told["ended"]),
            _whole(told["unit"]),
            bytes.fromhex(told.get("request", "")),
            bytes.fromhex(told.get("reply", "")),
            str(told["outcome"]),
            str(told.get("for", "")),
            _whole(told.get("attempt", 1)),
            None if first is None else _seconds(first),
            None if queued is None else _seconds(queued),
            _whole(told.get("skipped", 0)),
        )
    except KeyError as missing:
        raise ValueError(f"it has no {missing.args[0]!r}") from None
    except TypeError as error:
        raise ValueError(str(error)) from None


def _object(line: str) -> dict[str, Any]:
    try:
        told = json.loads(line)
    except ValueError as error:
        raise ValueError(f"it is no JSON ({getattr(error, 'msg', error)})") from None
    if not isinstance(told, dict):
        raise ValueError("it is no JSON object")
    return told


def _whole(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise ValueError(f"{value!r} is no whole number")
    return value


def _seconds(value: Any) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        raise ValueError(f"{value!r} is no time in seconds")
    return float(value)


def _time(seconds: float) -> float:
    """To the microsecond: less than a bit takes at 921600 bit/s."""
    return round(seconds, 6)


def _line(**told: Any) -> str:
    return json.dumps(told, separators=(", ", ": "), ensure_ascii=False) + "\n"
