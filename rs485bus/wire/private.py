"""Requests by functions that are not in the specification. Pure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from rs485bus.arguments import flag, whole
from rs485bus.wire.answers import Answer, Sizer, sized_by_count
from rs485bus.wire.frames import MAX_ADDRESS, MAX_FRAME, Request, private

Reply = int | Literal["counted", "echo"] | Callable[[bytes], int] | None
"""How an answer ends: see `unit.request`."""

_AROUND = 4
"""Bytes of a frame that are no data: address, function, CRC."""
_EXPECTED = (
    "reply must be a number of bytes, 'counted', 'echo', a function from the first bytes to their number, or None"
)


def private_request(
    address: int, function: int, data: bytes, reply: Reply, *, writes: bool, highest: int = MAX_ADDRESS
) -> Request:
    """A request by any function (1..127), answered as `reply` says.

    Raises:
        ValueError: something of it fits no frame.
        TypeError: something is of a wrong type.
    """
    function = whole("function", function, 1, 0x7F)
    if not isinstance(data, bytes | bytearray):
        raise TypeError(f"data must be bytes, not {data!r}")
    head = bytes((whole("address", address, 1, highest), function))
    answer = _answer(head, bytes(data), reply)
    return private(address, function, bytes(data), answer, writes=flag("writes", writes), highest=highest)


def reply_data(reply: bytes) -> bytes:
    """The data in an answer: what follows its function code."""
    return reply[2:-2]


def _answer(head: bytes, data: bytes, reply: Reply) -> Answer:
    if reply is None:
        return Answer(head, 0)
    if reply == "echo":
        return Answer(head + data, _AROUND + len(data))
    if reply == "counted":
        return Answer(head, 0, sized_by_count)
    if callable(reply):
        return Answer(head, 0, _sizer(reply))
    try:
        size = whole("reply", reply, 0, MAX_FRAME - _AROUND)
    except TypeError:
        raise TypeError(f"{_EXPECTED}, not {reply!r}") from None
    return Answer(head, _AROUND + size)


def _sizer(count: Callable[[bytes], int]) -> Sizer:
    def size(reply: bytes) -> int:
        try:
            number = int(count(reply[2:]))
        except Exception:  # of too few bytes, say
            return 0
        return 0 if number == 0 else _AROUND + number if 0 < number <= MAX_FRAME - _AROUND else -1

    return size
