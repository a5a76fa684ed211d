"""What a device tells of itself: status, counters, log, identification. Requests, and what their replies hold. Pure.

Source: Modbus Application Protocol V1.1b3, 6.7 to 6.10, 6.13 and 6.21. `highest` is as for `write_single`.
"""

from __future__ import annotations

import enum
import struct
from dataclasses import dataclass
from typing import NamedTuple

from rs485bus.arguments import choice, whole
from rs485bus.wire.answers import (
    DIAGNOSTICS,
    ENCAPSULATED,
    EVENT_COUNTER,
    EVENT_LOG,
    EXCEPTION_STATUS,
    IDENTIFICATION,
    SERVER_ID,
)
from rs485bus.wire.frames import MAX_ADDRESS, Request, public

_BUSY = 0xFFFF
_MORE_FOLLOWS = 0xFF
_MAX_QUERY = 250


class Diagnostic(enum.IntEnum):
    """The subfunctions of function 08 (6.8.1). The last but one and the last are not in the specification."""

    QUERY_DATA = 0
    RESTART_COMMUNICATION = 1
    DIAGNOSTIC_REGISTER = 2
    CHANGE_ASCII_DELIMITER = 3
    FORCE_LISTEN_ONLY = 4
    CLEAR_COUNTERS = 10
    BUS_MESSAGE_COUNT = 11
    BUS_COMM_ERROR_COUNT = 12
    BUS_EXCEPTION_ERROR_COUNT = 13
    DEVICE_MESSAGE_COUNT = 14
    DEVICE_NO_RESPONSE_COUNT = 15
    DEVICE_NAK_COUNT = 16
    DEVICE_BUSY_COUNT = 17
    BUS_CHAR_OVERRUN_COUNT = 18
    CLEAR_OVERRUN_COUNTER = 20
    IOP_OVERRUN_COUNT = 19
    """Of the Modicon 884 (reserved today)."""
    MODBUS_PLUS = 21
    """Of Modicon controllers (reserved today)."""


class ReadCode(enum.IntEnum):
    """Which part of a device's identification to read (6.21)."""

    BASIC = 1
    """Vendor, product code and revision: objects 0 to 2."""
    REGULAR = 2
    """Objects 0 to 0x7F."""
    EXTENDED = 3
    """All objects."""
    SPECIFIC = 4
    """One object."""


class EventCounter(NamedTuple):
    """A reply to function 11."""

    busy: bool
    """The device is still at an earlier program command."""
    events: int
    """Messages it has completed."""


class EventLog(NamedTuple):
    """A reply to function 12."""

    busy: bool
    events: int
    """Messages it has completed."""
    messages: int
    """Messages it has seen since it was started."""
    log: bytes
    """One byte an event, the latest first, as 6.10 says."""


@dataclass(frozen=True, slots=True)
class DeviceInformation:
    """What a device says that it is.

    `conformity` is what it can be asked: 1 the basic objects, 2 the regular ones, 3 the extended ones, and 0x80 more
    if each can be asked for alone. `information` has the objects by their number.
    """

    conformity: int
    information: dict[int, bytes]

    def __getitem__(self, number: int) -> bytes:
        return self.information[number]

    @property
    def vendor_name(self) -> str:
        return self._text(0)

    @property
    def product_code(self) -> str:
        return self._text(1)

    @property
    def revision(self) -> str:
        return self._text(2)

    def _text(self, number: int) -> str:
        return self.information.get(number, b"").decode("utf-8", "replace")


class IdentificationPart(NamedTuple):
    """One reply to a request for the identification, which may take several."""

    conformity: int
    follows: int | None
    """The object to go on with; None at the end."""
    objects: dict[int, bytes]


def exception_status(address: int, *, highest: int = MAX_ADDRESS) -> Request:
    """Read the eight exception status outputs, function 07."""
    return public(address, EXCEPTION_STATUS, b"", highest=highest)


def diagnostic(address: int, subfunction: Diagnostic, data: int | bytes = 0, *, highest: int = MAX_ADDRESS) -> Request:
    """Ask or do what a subfunction says, function 08. `data` is a number (0..65535) or, for QUERY_DATA, bytes."""
    subfunction = choice("subfunction", subfunction, Diagnostic)
    if isinstance(data, bytes | bytearray):
        if not 1 <= len(data) <= _MAX_QUERY:
            raise ValueError(f"{len(data)} data bytes in one query; 1..{_MAX_QUERY} fit a frame")
        sent = bytes(data)
    else:
        sent = whole("diagnostic data", data, 0, 0xFFFF).to_bytes(2, "big")
    return public(address, DIAGNOSTICS, struct.pack(">H", subfunction) + sent, highest=highest)


def ascii_delimiter(character: int) -> int:
    """The data that says which character (0..255) ends a message in ASCII mode (6.8.1: it is the high byte)."""
    return whole("delimiter", character, 0, 0xFF) << 8


def diagnostic_data(reply: bytes) -> bytes:
    """The data in a reply to function 08."""
    return reply[4:-2]


def event_counter(address: int, *, highest: int = MAX_ADDRESS) -> Request:
    """Read the counter of completed messages, function 11."""
    return public(address, EVENT_COUNTER, b"", highest=highest)


def counted_events(reply: bytes) -> EventCounter:
    """What a reply to function 11 says."""
    status, events = struct.unpack_from(">HH", reply, 2)
    return EventCounter(status == _BUSY, events)


def event_log(address: int, *, highest: int = MAX_ADDRESS) -> Request:
    """Read the counters and the latest events, function 12."""
    return public(address, EVENT_LOG, b"", highest=highest)


def logged_events(reply: bytes) -> EventLog:
    """What a reply to function 12 says."""
    status, events, messages = struct.unpack_from(">HHH", reply.ljust(9, b"\0"), 3)
    return EventLog(status == _BUSY, events, messages, reply[9:-2])


def server_id(address: int, *, highest: int = MAX_ADDRESS) -> Request:
    """Read what the device is, in its own format, function 17."""
    return public(address, SERVER_ID, b"", highest=highest)


def identification(
    address: int, code: ReadCode = ReadCode.BASIC, number: int = 0, *, highest: int = MAX_ADDRESS
) -> Request:
    """Read a part of the identification from object `number` (0..255) on, function 43, type 14."""
    code, number = choice("read_code", code, ReadCode), whole("object_id", number, 0, 0xFF)
    return public(address, ENCAPSULATED, bytes((IDENTIFICATION, code, number)), highest=highest)


def identified(reply: bytes) -> IdentificationPart:
    """What a reply to such a request says."""
    conformity, more, following, count = reply[4:8]
    objects, at = {}, 8
    for _ in range(count):
        number, size = reply[at : at + 2]
        objects[number] = reply[at + 2 : at + 2 + size]
        at += 2 + size
    return IdentificationPart(conformity, following if more == _MORE_FOLLOWS else None, objects)
