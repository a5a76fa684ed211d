"""What came instead of an answer, in words, and what to do about it. Pure.

It is asked only once a request has failed. It knows the bytes that belonged to nothing, from the latest attempt in
which there were any.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from rs485bus.wire.answers import (
    DIAGNOSTICS,
    ENCAPSULATED,
    EVENT_COUNTER,
    EXCEPTION_STATUS,
    MASK_WRITE,
    READ_COILS,
    READ_FIFO,
    READ_INPUT,
    WRITE_COIL,
    WRITE_COILS,
    WRITE_MULTIPLE,
    WRITE_SINGLE,
    sized_as_fifo,
    sized_as_identification,
    sized_by_count,
)
from rs485bus.wire.crc import ends_in_crc
from rs485bus.wire.exceptions import exception, is_a_gateways
from rs485bus.wire.frames import EXCEPTION_LENGTH, MAX_ADDRESS, MAX_FRAME, Request

CHECK = "Check the device's power, address, baud rate and parity, and the wires A and B."
_SECOND_MASTER = "Is there a second master on the pair, or a second program at the port? There may be only one."
_CABLE = "Check the termination, the bias and the shield of the cable, and the ground wire."
_RATE = "Check the baud rate and the parity first, then the wires A and B and the bias of the pair."
_SHOWN = 8
"""Bytes that are shown of what is no frame."""
_REQUEST_LENGTH = 8
"""Of a read, and of a write of one value."""
_FIXED = {WRITE_COIL: 8, WRITE_SINGLE: 8, WRITE_COILS: 8, WRITE_MULTIPLE: 8, MASK_WRITE: 10} | {
    EXCEPTION_STATUS: 5,
    DIAGNOSTICS: 8,
    EVENT_COUNTER: 8,
}
_HIGHEST_FUNCTION = ENCAPSULATED
_NO_CODE = EXCEPTION_LENGTH - 1
"""Bytes of an exception that lacks its code, as some devices send it."""
_MBAP = 6
"""Bytes before the unit in a Modbus TCP frame: transaction, protocol (0), length of what follows."""
_ASCII = re.compile(rb":((?:[0-9A-F]{2}){3,})\r\n")


class Heard(NamedTuple):
    """What came in an attempt that was not answered."""

    rest: bytes
    """The latest bytes that belonged to nothing."""
    echoed: bool = False
    """The request itself came back."""
    in_doubt: bool = False
    """That may have been the answer, which repeats the request."""
    undecided: bytes = b""
    """A refusal that may have belonged to an older request."""


def tell(request: Request, heard: Heard | None) -> str:
    """What came instead of an answer, and what to do; empty if nothing did."""
    if heard is None:
        return ""
    rest, echoed = _without_echo(request, heard)
    if heard.in_doubt:
        return (
            "What came back is the request itself. The adapter may have returned it, or the device may have agreed: no "
            "read was answered that would have shown which. See that the device answers reads, or say "
            "BusConfig(echo=False), or echo=True."
        )
    if heard.undecided:
        return (
            f"{_an_exception(heard.undecided)} came that may belong to an older request, which was not answered "
            "either. Ask again."
        )
    if rest and (told := _frame(request, rest) or _other_protocol(rest) or _damaged(request, rest)):
        return told
    if rest:
        shown = rest[:_SHOWN].hex(" ").upper() + " ..." * (len(rest) > _SHOWN)
        came = "A byte came that is" if len(rest) == 1 else f"{len(rest)} bytes came that are"
        return f"{came} no frame of Modbus ({shown}). {_RATE}"
    if echoed:
        return f"Only the request itself came back: the adapter returns what is sent, and nobody answered. {CHECK}"
    return ""


def is_there(request: Request, heard: Heard) -> bool:
    """Whether the device asked has said something, though it was no answer. What another master may have said to it,
    and what a gateway says of it, is no sign of that."""
    rest, _ = _without_echo(request, heard)
    return any(frame[0] == request.address and _is_only_said_by_devices(frame) for frame in _frames(rest))


def _is_only_said_by_devices(frame: bytes) -> bool:
    function = frame[1]
    if function > 0x80:
        return not is_a_gateways(frame)
    return function in (WRITE_COILS, WRITE_MULTIPLE) or (function <= READ_INPUT and len(frame) != _REQUEST_LENGTH)


def _without_echo(request: Request, heard: Heard) -> tuple[bytes, bool]:
    """What came but for our own bytes; and whether they came back, if only in part."""
    before, mark, behind = heard.rest.partition(request.adu[-4:])
    return (behind, True) if mark and request.adu.endswith(before[-2:] + mark) else (heard.rest, heard.echoed)


# Frames of Modbus RTU


def _frame(request: Request, rest: bytes) -> str:
    """The first whole frame that came, and why it is no answer."""
    frame = next(_frames(rest), b"")
    if not frame:
        return ""
    address, function = frame[0], frame[1]
    shown = frame.hex(" ").upper()
    if _asks(frame):
        return f"Somebody else asks on this pair ({shown}). {_SECOND_MASTER}"
    if address != request.address:
        return (
            f"Instead, address {address} answered ({shown}). Check the address of the device, and that no two devices "
            f"have the same. {_SECOND_MASTER}"
        )
    if len(frame) == _NO_CODE:
        return (
            f"An exception came without its code ({shown}): the device refuses function {function & 0x7F:02}, and does "
            "not say why. It does not keep to Modbus there."
        )
    if function > 0x80:
        return f"{_an_exception(frame)} came to function {function & 0x7F:02}, which was not asked. {_SECOND_MASTER}"
    if function == request.function and len(frame) == request.length:
        return f"An answer came that repeats other values than were sent ({shown}). {_SECOND_MASTER}"
    expected = f"{request.length} were" if request.length else "another was"
    if function != request.function and request.length == len(frame):
        expected = f"function {request.function:02} was"
    return (
        f"Instead came an answer of {len(frame)} bytes by function {function:02} where {expected} expected ({shown}). "
        f"It answers something else, or the device does not keep to Modbus. {_SECOND_MASTER}"
    )


def _frames(rest: bytes) -> Iterator[bytes]:
    """The whole frames in some bytes, replies or requests."""
    for begin in range(len(rest) - _NO_CODE + 1):
        if 1 <= rest[begin + 1] & 0x7F <= _HIGHEST_FUNCTION:
            yield from frames_at_the_beginning(rest[begin : begin + MAX_FRAME])


def frames_at_the_beginning(data: bytes) -> Iterator[bytes]:
    """The whole frames, replies or requests, that two bytes or more may begin with."""
    for length in _lengths(data):
        frame = data[:length]
        if len(frame) == length and ends_in_crc(frame):
            yield frame


def _lengths(data: bytes) -> Iterator[int]:
    """How long a frame may be that begins so."""
    function = data[1]
    if function >= 0x80:
        yield EXCEPTION_LENGTH
        yield _NO_CODE
    elif function in _FIXED:
        yield _FIXED[function]
    elif function == READ_FIFO:
        yield sized_as_fifo(data)
    elif function == ENCAPSULATED:
        yield sized_as_identification(data)
    else:
        yield sized_by_count(data)
        if READ_COILS <= function <= READ_INPUT:
            yield _REQUEST_LENGTH


def _asks(frame: bytes) -> bool:
    """Whether a frame can only be a request: a read's reply of that length would say another count."""
    return (
        READ_COILS <= frame[1] <= READ_INPUT and len(frame) == _REQUEST_LENGTH and sized_by_count(frame) != len(frame)
    )


def _an_exception(frame: bytes) -> str:
    return f"An exception ({frame[2]:02}, {exception(frame[2]).name})"


# Anything else


def _other_protocol(rest: bytes) -> str:
    length = int.from_bytes(rest[4:_MBAP], "big")
    if rest[2:4] == b"\0\0" and length > 2 and len(rest) == _MBAP + length:
        return (
            f"A frame of Modbus TCP came ({rest.hex(' ').upper()}): this gateway speaks Modbus TCP. Open it as "
            "tcp://host:port, or set it to RTU over TCP, which is often called transparent or raw."
        )
    # It is sent with seven data bits; read with eight, the highest may be anything.
    line = _ASCII.search(bytes(byte & 0x7F for byte in rest))
    if line is not None and sum(bytes.fromhex(line[1].decode())) % 256 == 0:
        return "A line of Modbus ASCII came: set the device, or the other master, to Modbus RTU."
    if rest[0] > MAX_ADDRESS and len(rest) > 3 and sum(rest[:-1]) % 256 == rest[-1]:
        return (
            f"A frame of another protocol came, which ends in the sum of its bytes ({rest.hex(' ').upper()}). Set the "
            "device to Modbus RTU."
        )
    return ""


def _damaged(request: Request, rest: bytes) -> str:
    """An answer that begins right, if there is one."""
    at = rest.find(request.prefix)
    if request.length and 0 <= at <= len(rest) - request.length:
        return f"An answer came whose CRC is wrong: bits of it were damaged on the way. {_CABLE}"
    if at < 0 and request.prefix.startswith(rest):
        at = 0
    if at >= 0 and len(rest) - at > 1:
        of = f" of {request.length}" if request.length else ""
        return (
            f"An answer began and broke off after {len(rest) - at}{of} bytes. Allow more time (reply_timeout), if the "
            f"port or the gateway hands bytes on late. {_CABLE}"
        )
    return ""
