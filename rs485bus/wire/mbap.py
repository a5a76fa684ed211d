"""Modbus TCP: RTU frames to its frames and back. Pure.

A transaction number tells which request a frame answers. It is the number that the *gateway* was given: whether the
slave behind it answered that request, or an earlier one late, it does not tell.

Source: Modbus Messaging on TCP/IP V1.0b, 3.1.3 (the MBAP header).
"""

from __future__ import annotations

import struct
from collections import OrderedDict
from typing import NamedTuple

from rs485bus.wire.crc import crc, ends_in_crc

_HEADER = struct.Struct(">HHH")
"""Transaction number, protocol (0), and how many bytes follow: unit and PDU."""
_LONGEST = 254
_CRC = 2
_SHOWN = 8
_REMEMBERED = 64
"""How many of the latest requests are remembered."""


class Answer(NamedTuple):
    """What a gateway answered, as an RTU frame."""

    frame: bytes
    asked: object
    """What it answers; None if nobody waits for that, or it is not known any more."""


class Mbap:
    """Both directions of one connection.

    Args:
        before: the connection before this one, whose numbers go on: what the other end kept of it answers nothing here.
    """

    __slots__ = ("_asked", "_buffer", "_lost", "_number", "_odd", "_unasked", "answers", "answers_in_rtu", "skipped")

    def __init__(self, before: Mbap | None = None) -> None:
        self.answers = 0
        """Frames that came."""
        self.skipped = 0
        """Bytes that were no Modbus TCP."""
        self.answers_in_rtu = False
        """Something that came was an RTU frame."""
        self._buffer = bytearray()
        self._lost = False
        """Where the next frame begins is not known."""
        self._number: int = 0 if before is None else before._number
        self._odd = b""
        """What came last that is no Modbus TCP, since something was answered."""
        self._unasked: int | None = None
        """A number that was answered and not asked under, since something was answered."""
        self._asked: OrderedDict[int, object] = OrderedDict()

    def wrap(self, adu: bytes, asked: object) -> bytes:
        """The frame that asks what an RTU frame asks.

        Args:
            adu: the RTU frame.
            asked: what it belongs to, the same for all attempts of one request. None where nobody waits for an answer.
        """
        self._number = self._number % 0xFFFF + 1
        self._asked[self._number] = asked
        if len(self._asked) > _REMEMBERED:
            self._asked.popitem(last=False)
        content = adu[:-_CRC]
        return _HEADER.pack(self._number, 0, len(content)) + content

    @property
    def complaint(self) -> str:
        """What is wrong with what comes, in words; empty if nothing is."""
        if len(self._buffer) > _HEADER.size:
            announced = _HEADER.unpack_from(self._buffer)[2]
            return (
                f"an answer says that {announced} bytes follow its header, and {len(self._buffer) - _HEADER.size} did"
            )
        if self._odd:
            return (
                f"what comes has no header of Modbus TCP ({self._odd[:_SHOWN].hex(' ').upper()} ...), which is a "
                f"transaction number, 00 00, and how many bytes follow, 2..{_LONGEST}"
            )
        if self._unasked is not None:
            return f"answers come under transaction numbers that were not asked under ({self._unasked} was the latest)"
        return ""

    def unwrap(self, data: bytes) -> list[Answer]:
        """Bytes came in; return the answers they complete."""
        buffer, answers, at = self._buffer, [], 0
        buffer += data
        if not self.answers_in_rtu and _is_rtu(buffer):
            self.answers_in_rtu = True
        while len(buffer) - at >= _HEADER.size:
            number, protocol, length = _HEADER.unpack_from(buffer, at)
            # What follows something else is believed to be an answer if it was asked for.
            if protocol or not 2 <= length <= _LONGEST or (self._lost and number not in self._asked):
                if not self._lost:
                    self._odd = bytes(buffer[at:])
                self._lost = True
                self.skipped += 1
                at += 1
                continue
            end = at + _HEADER.size + length
            if end > len(buffer):
                break
            content = bytes(buffer[at + _HEADER.size : end])
            answers.append(Answer(content + crc(content), self._asked.get(number)))
            self.answers += 1
            if number in self._asked:
                self._odd, self._unasked = b"", None
            else:
                self._unasked = number
            self._lost = False
            at = end
        del buffer[:at]
        return answers


def _is_rtu(data: bytearray) -> bool:
    """Whether bytes are one whole RTU frame, which a header of Modbus TCP is not."""
    return 5 <= len(data) <= _LONGEST + _CRC and data[2:4] != b"\0\0" and ends_in_crc(bytes(data))


def looks_like_mbap(data: bytes) -> bool:
    """Whether bytes are one whole frame of Modbus TCP."""
    if len(data) < _HEADER.size + 2:
        return False
    protocol: int
    length: int
    _, protocol, length = _HEADER.unpack_from(data)
    return protocol == 0 and length <= _LONGEST and len(data) == _HEADER.size + length
