"""Which frame answers a request, told from the bytes of the request. Pure.

Source: Modbus Application Protocol V1.1b3, chapter 6, where a comment names a section. pymodbus' own frame sizes are
not used: they are short for FIFO queues.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT = 1, 2, 3, 4
WRITE_COIL, WRITE_SINGLE, WRITE_COILS, WRITE_MULTIPLE, MASK_WRITE, READ_WRITE = 5, 6, 15, 16, 22, 23
EXCEPTION_STATUS, DIAGNOSTICS, EVENT_COUNTER, EVENT_LOG, SERVER_ID = 7, 8, 11, 12, 17
READ_FILE, WRITE_FILE, READ_FIFO, ENCAPSULATED = 20, 21, 24, 43
IDENTIFICATION: Final = 14
"""The type of encapsulated interface (function 43) that reads the device's identification."""

LISTEN_ONLY: Final = 4
"""The diagnostic subfunction after which the device keeps silent, this request included."""
MODBUS_PLUS: Final = 21
"""A diagnostic subfunction of Modicon's own, which some libraries offer; it is not in the specification."""
_GET_STATISTICS = 3
_STATISTICS_LENGTH = 118
# 6.8.1; what is not named here clears or sets something.
_HARMLESS_DIAGNOSTICS: Final = frozenset({0, 2, *range(11, 20)})

_READS: Final = frozenset({READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT}) | frozenset(
    {EXCEPTION_STATUS, EVENT_COUNTER, EVENT_LOG, SERVER_ID, READ_FILE, READ_FIFO}
)

Sizer = Callable[[bytes], int]
"""Tells the length of a reply from its first bytes. -1: they make no sense. Where they are too few: how long it is at
least, which is more than they are; or 0."""

_MAX_FRAME = 256
_MORE_FOLLOWS: Final = b"\x00\xff"
"""No and yes."""


class Answer(NamedTuple):
    """A reply begins with `prefix` and is `length` bytes long in all; 0 with a `sizer` where only the reply tells.

    Nobody answers where `length` is 0 and there is no `sizer`.
    """

    prefix: bytes
    length: int
    sizer: Sizer | None = None


def answer_to(adu: bytes) -> Answer | None:
    """The answer to a request of one unit. None for functions that are not public ones."""
    function = adu[1]
    if function in (READ_COILS, READ_DISCRETE):
        return counted(adu, (_word(adu, 4) + 7) // 8)
    if function in (READ_HOLDING, READ_INPUT, READ_WRITE):
        return counted(adu, 2 * _word(adu, 4))
    if function in (WRITE_COIL, WRITE_SINGLE, WRITE_COILS, WRITE_MULTIPLE):
        return Answer(adu[:6], 8)
    if function in (MASK_WRITE, WRITE_FILE):
        return Answer(adu[:-2], len(adu))
    if function == DIAGNOSTICS:
        return _diagnostics(adu)
    if function == EXCEPTION_STATUS:
        return Answer(adu[:2], 5)
    if function == EVENT_COUNTER:
        return Answer(adu[:2], 8)
    if function in (EVENT_LOG, SERVER_ID, READ_FILE):
        return Answer(adu[:2], 0, sized_by_count)
    if function == READ_FIFO:
        return Answer(adu[:2], 0, sized_as_fifo)
    if function == ENCAPSULATED and adu[2] == IDENTIFICATION:
        return Answer(adu[:3], 0, sized_as_identification)
    return None


def changes(adu: bytes) -> bool:
    """Whether a request may change something in the device. It may where that is not known."""
    function = adu[1]
    if function == DIAGNOSTICS:
        return _word(adu, 2) not in _HARMLESS_DIAGNOSTICS
    if function == ENCAPSULATED:
        return adu[2] != IDENTIFICATION
    return function not in _READS


def counted(adu: bytes, size: int) -> Answer:
    """A reply whose third byte tells that `size` data bytes follow."""
    return Answer(bytes((adu[0], adu[1], size & 0xFF)), 5 + size)


def sized_by_count(reply: bytes) -> int:
    """The third byte tells how many bytes follow."""
    return 0 if len(reply) < 3 else _possible(5 + reply[2])


def sized_as_fifo(reply: bytes) -> int:
    """Two bytes tell how many bytes follow: the count of registers and the registers (6.18)."""
    if len(reply) < 4:
        return 0
    count = _word(reply, 2)
    return _possible(6 + count) if count >= 2 and count % 2 == 0 else -1


def sized_as_identification(reply: bytes) -> int:
    """The eighth byte tells how many objects follow, and the second byte of each how long it is (6.21)."""
    if len(reply) < 8:
        return 0
    if reply[5] not in _MORE_FOLLOWS:
        return -1
    at = 8
    try:
        for _ in range(reply[7]):
            at += 2 + reply[at + 1]
    except IndexError:
        at += 2  # the next object is not there yet; it may be empty
    return _possible(at + 2)


def _diagnostics(adu: bytes) -> Answer:
    subfunction = _word(adu, 2)
    if subfunction == LISTEN_ONLY:
        return Answer(adu[:4], 0)
    if subfunction == 0:
        return Answer(adu[:-2], len(adu))
    if subfunction == MODBUS_PLUS and _word(adu, 4) == _GET_STATISTICS:
        return Answer(adu[:6], _STATISTICS_LENGTH)
    return Answer(adu[:4], len(adu))


def _possible(length: int) -> int:
    return length if length <= _MAX_FRAME else -1


def _word(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 2], "big")
