"""What an exception reply says of the request that it answers. Pure.

Source: Modbus Application Protocol V1.1b3, 7. Only some codes promise that nothing was done; the others leave it open,
or come from a gateway that the device did not answer.
"""

from __future__ import annotations

import enum
from typing import Final, NamedTuple

from rs485bus.wire.answers import MASK_WRITE, WRITE_COIL, WRITE_COILS, WRITE_MULTIPLE, WRITE_SINGLE
from rs485bus.wire.frames import EXCEPTION_LENGTH, Request


class Meaning(enum.Enum):
    """What an exception says of a write."""

    REFUSED = enum.auto()
    """It was not begun. Of a block, what comes before the place that does not suit may have been written."""
    BUSY = enum.auto()
    """It was not begun. It may be asked for again in a while."""
    OPEN = enum.auto()
    """It was begun, or nobody says that it was not."""
    UNANSWERED = enum.auto()
    """A gateway says that the device gave no answer."""


class ModbusException(NamedTuple):
    """One exception code: its name, and its meaning."""

    name: str
    meaning: Meaning


ACCEPTED: Final = 5
BUSY: Final = 6
_OTHER: Final = ModbusException("a code of the device's own", Meaning.OPEN)
_EXCEPTIONS: Final = {
    1: ModbusException("illegal function", Meaning.REFUSED),
    2: ModbusException("illegal register address", Meaning.REFUSED),
    3: ModbusException("illegal value", Meaning.REFUSED),
    4: ModbusException("failed while it was carried out", Meaning.OPEN),
    ACCEPTED: ModbusException("accepted, and still being carried out", Meaning.OPEN),
    BUSY: ModbusException("busy", Meaning.BUSY),
    # Some devices say 07 before, some after they have tried; for the functions in use no document promises either.
    7: ModbusException("negative acknowledge", Meaning.OPEN),
    8: ModbusException("memory parity error", Meaning.OPEN),
    10: ModbusException("the gateway has no path to the device", Meaning.UNANSWERED),
    11: ModbusException("the device did not answer the gateway", Meaning.UNANSWERED),
}
_ONE_VALUE = (WRITE_COIL, WRITE_SINGLE, MASK_WRITE)


def exception(code: int) -> ModbusException:
    """What an exception code says."""
    return _EXCEPTIONS.get(code, _OTHER)


def is_exception(frame: bytes) -> bool:
    """Whether a reply is an exception."""
    return len(frame) == EXCEPTION_LENGTH and frame[1] >= 0x80


def is_a_gateways(frame: bytes) -> bool:
    """Whether a reply is an exception that a gateway made: the unit did not answer it, and may yet."""
    return is_exception(frame) and exception(frame[2]).meaning is Meaning.UNANSWERED


def is_all_or_nothing(request: Request) -> bool:
    """Whether a device can do nothing but the whole request or none of it: it writes one value at most."""
    if request.function in (WRITE_COILS, WRITE_MULTIPLE):
        return request.adu[4:6] == b"\0\1"
    return not request.writes or request.function in _ONE_VALUE


def is_busy(code: int | None) -> bool:
    """Whether an exception says that nothing was done, and that it may be asked again soon."""
    return code is not None and exception(code).meaning is Meaning.BUSY
