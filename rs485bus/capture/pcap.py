"""Captures for Wireshark.

The file is a pcap of "exported PDUs" (LINKTYPE_WIRESHARK_UPPER_PDU): each packet names the dissector that it is for,
so that Wireshark shows Modbus RTU without being told anything. As source and destination stand 0.0.0.0 for the master
and 0.0.0.5 for unit 5, and port 502 for the unit: with the preference `mbrtu.tcp.port` set to 502 Wireshark tells
requests from replies also where these are alike (writes of one register).

What its Modbus dissector does not take goes to its dissector of plain data, under the name of Modbus RTU: broadcasts,
frames of four bytes, the writes of MKS drives whose bytes are not twice their registers, and bytes that are no frame.
What these mean is said in words, which Wireshark shows from 4.2 on.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from datetime import datetime
from typing import Final, NamedTuple

from rs485bus.capture.explanation import words_of
from rs485bus.capture.reading import Capture
from rs485bus.wire.answers import WRITE_MULTIPLE
from rs485bus.wire.crc import ends_in_crc
from rs485bus.wire.frames import BROADCAST

_LINKTYPE: Final = 252
_MAGIC: Final = 0xA1B23C4D
"""Of a pcap whose times are in nanoseconds."""
_SNAPLEN: Final = 65535
_DISSECTOR, _SOURCE, _DESTINATION, _PORT_TYPE, _SOURCE_PORT, _DESTINATION_PORT, _PROTOCOL, _INFO = (
    *(12, 20, 21, 24, 25, 26, 33, 36),
)
"""Tags of exported PDUs (wsutil/exported_pdu_tlvs.h of Wireshark)."""
_TCP: Final = 2
_UNIT_PORT, _MASTER_PORT = 502, 49152


class Packet(NamedTuple):
    """A frame, or bytes that are none."""

    at: float
    """When it ended, in seconds since the capture began: a frame is known once it is whole."""
    data: bytes
    address: int
    """The unit's, whoever sent it."""
    from_unit: bool
    said: str


def packets(capture: Capture) -> list[Packet]:
    """All frames of a capture, in the order of the wire."""
    return sorted(_packets(capture), key=lambda packet: packet.at)


def write_pcap(capture: Capture, path: str | os.PathLike[str]) -> int:
    """Write a capture as a pcap file. Returns how many packets it has."""
    started = datetime.fromisoformat(capture.header.started).timestamp()
    found = packets(capture)
    with open(path, "wb") as file:
        file.write(struct.pack("<IHHiIII", _MAGIC, 2, 4, 0, 0, _SNAPLEN, _LINKTYPE))
        for packet in found:
            data = _exported(packet)
            nanoseconds = max(0, round((started + packet.at) * 1_000_000)) * 1000
            file.write(struct.pack("<IIII", *divmod(nanoseconds, 1_000_000_000), len(data), len(data)) + data)
    return len(found)


def _packets(capture: Capture) -> Iterator[Packet]:
    line = capture.header.line
    for exchange in capture.exchanges:
        words = words_of(exchange, capture.families.get(exchange.address))
        if exchange.request:
            sent = exchange.at + line.airtime(len(exchange.request))
            yield Packet(sent, exchange.request, exchange.address, False, words.asked)
        if exchange.reply:
            yield Packet(exchange.ended, exchange.reply, exchange.address, True, words.answered)
    for stray in capture.strays:
        yield Packet(stray.ended, stray.data, BROADCAST, True, f"{len(stray.data)} bytes that are no frame")


def _exported(packet: Packet) -> bytes:
    unit, master = bytes((0, 0, 0, packet.address)), bytes(4)
    ends = (unit, master) if packet.from_unit else (master, unit)
    ports = (_UNIT_PORT, _MASTER_PORT) if packet.from_unit else (_MASTER_PORT, _UNIT_PORT)
    tags = [(_DISSECTOR, b"mbrtu" if _is_dissected(packet.data) else b"data")]
    if tags[0][1] == b"data":
        tags += [(_PROTOCOL, b"Modbus RTU"), (_INFO, packet.said.encode())]
    tags += [(_SOURCE, ends[0]), (_DESTINATION, ends[1]), (_PORT_TYPE, struct.pack(">I", _TCP))]
    tags += [(_SOURCE_PORT, struct.pack(">I", ports[0])), (_DESTINATION_PORT, struct.pack(">I", ports[1]))]
    return b"".join(_tag(*tag) for tag in tags) + _tag(0, b"") + packet.data


def _tag(number: int, value: bytes) -> bytes:
    value += bytes(-len(value) % 4)
    return struct.pack(">HH", number, len(value)) + value


def _is_dissected(frame: bytes) -> bool:
    """Whether Wireshark's dissector of Modbus RTU takes a frame."""
    if len(frame) < 5 or frame[0] == BROADCAST or not ends_in_crc(frame):
        return False
    is_block_write = frame[1] == WRITE_MULTIPLE and len(frame) > 8
    return not is_block_write or frame[6] == 2 * int.from_bytes(frame[4:6], "big") == len(frame) - 9
