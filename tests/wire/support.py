"""Replies as a stream of bytes brings them."""

from __future__ import annotations

from rs485bus.wire.frames import EXCEPTION_LENGTH, Request, crc
from rs485bus.wire.receiver import Pattern, Receiver


def closed(body: bytes) -> bytes:
    """A frame with its CRC."""
    return body + crc(body)


def listening(request: Request) -> Receiver[str]:
    """A receiver that waits for the answer to a request, or an exception."""
    receiver: Receiver[str] = Receiver()
    exception = bytes((request.address, request.function | 0x80))
    receiver.expect(
        [
            Pattern(request.prefix, request.length, "reply", request.sizer, counts=True),
            Pattern(exception, EXCEPTION_LENGTH, "exception"),
        ]
    )
    return receiver
