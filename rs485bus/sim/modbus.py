"""A simulated device with all public functions of Modbus: a relay, a meter, a controller. Pure."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from rs485bus.sim.device import ILLEGAL_ADDRESS, ILLEGAL_FUNCTION, ILLEGAL_VALUE, Refusal, SimDevice, remember

_MAX_PDU = 253
_LISTEN_ONLY, _RESTART = 4, 1
_COUNTERS = range(11, 20)


@dataclass
class ModbusData:
    """What the device holds. Any address that is not named is refused with exception 02."""

    coils: dict[int, bool] = field(default_factory=dict)
    inputs: dict[int, bool] = field(default_factory=dict)
    registers: dict[int, int] = field(default_factory=dict)
    input_registers: dict[int, int] = field(default_factory=dict)
    queues: dict[int, list[int]] = field(default_factory=dict)
    """Queues of registers, by the address of their pointer."""
    files: dict[int, dict[int, int]] = field(default_factory=dict)
    """Files, by their number: registers by the number of their record."""
    identification: dict[int, bytes] = field(default_factory=dict)
    server_id: bytes = b"\x01\xff"
    exception_status: int = 0
    largest_block: int = 125
    """How many registers it lets be read at once."""


class SimModbus(SimDevice):
    """A device with all public functions (Modbus Application Protocol V1.1b3, chapter 6).

    Args:
        address: 1..247.
        data: what it holds.
    """

    def __init__(self, address: int, data: ModbusData) -> None:
        super().__init__(address)
        self.data = data
        self.listens_only = False
        self.messages = 0
        """Messages it has seen."""
        self.asked: list[bytes] = []
        """The latest requests that it has seen, without address and CRC."""
        self._functions: dict[int, Callable[[bytes], bytes]] = {
            1: lambda pdu: self._read_bits(pdu, self.data.coils),
            2: lambda pdu: self._read_bits(pdu, self.data.inputs),
            3: lambda pdu: self._read_registers(pdu, self.data.registers),
            4: lambda pdu: self._read_registers(pdu, self.data.input_registers),
            5: self._write_coil,
            6: lambda pdu: self._write(self.data.registers, pdu[1:3], [_word(pdu, 3)], pdu),
            7: lambda pdu: bytes((7, self.data.exception_status)),
            8: self._diagnose,
            11: lambda pdu: struct.pack(">BHH", 11, 0, self.messages & 0xFFFF),
            12: lambda pdu: struct.pack(">BBHHH", 12, 8, 0, self.messages & 0xFFFF, self.messages & 0xFFFF) + b"\x20\0",
            15: self._write_coils,
            16: self._write_registers,
            17: lambda pdu: bytes((17, len(self.data.server_id))) + self.data.server_id,
            20: self._read_files,
            21: self._write_files,
            22: self._mask_write,
            23: self._read_write,
            24: self._read_queue,
            43: self._identify,
        }

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        self.messages += 1
        remember(self.asked, pdu)
        subfunction = _word(pdu, 1) if pdu[0] == 8 else 0
        if self.listens_only:
            self.listens_only = subfunction != _RESTART
            return None
        if subfunction == _LISTEN_ONLY:
            self.listens_only = True
            return None
        function = self._functions.get(pdu[0])
        if function is None:
            raise Refusal(ILLEGAL_FUNCTION)
        try:
            return function(pdu)
        except (struct.error, IndexError):
            raise Refusal(ILLEGAL_VALUE) from None

    def _read_bits(self, pdu: bytes, bits: dict[int, bool]) -> bytes:
        first, count = struct.unpack(">HH", pdu[1:])
        values = _taken(bits, first, count, 2000)
        number = sum(bool(value) << at for at, value in enumerate(values))
        size = (count + 7) // 8
        return bytes((pdu[0], size)) + number.to_bytes(size, "little")

    def _read_registers(self, pdu: bytes, registers: dict[int, int]) -> bytes:
        first, count = struct.unpack(">HH", pdu[1:])
        return bytes((pdu[0], 2 * count)) + _packed(_taken(registers, first, count, self.data.largest_block))

    def _write(self, held: dict[int, Any], at: bytes, values: Sequence[int], reply: bytes) -> bytes:
        first = int.from_bytes(at, "big")
        _taken(held, first, len(values), 2000)
        held.update(zip(range(first, first + len(values)), values, strict=True))
        return reply

    def _write_coil(self, pdu: bytes) -> bytes:
        value = _word(pdu, 3)
        if value not in (0, 0xFF00):
            raise Refusal(ILLEGAL_VALUE)
        return self._write(self.data.coils, pdu[1:3], [value > 0], pdu)

    def _write_coils(self, pdu: bytes) -> bytes:
        count, size = struct.unpack(">HB", pdu[3:6])
        if not 1 <= count <= 1968 or size != (count + 7) // 8 or len(pdu) != 6 + size:
            raise Refusal(ILLEGAL_VALUE)
        number = int.from_bytes(pdu[6:], "little")
        return self._write(self.data.coils, pdu[1:3], [bool(number >> at & 1) for at in range(count)], pdu[:5])

    def _write_registers(self, pdu: bytes) -> bytes:
        count, size = struct.unpack(">HB", pdu[3:6])
        if not 1 <= count <= 123 or size != 2 * count or len(pdu) != 6 + size:
            raise Refusal(ILLEGAL_VALUE)
        return self._write(self.data.registers, pdu[1:3], _unpacked(pdu[6:]), pdu[:5])

    def _mask_write(self, pdu: bytes) -> bytes:
        at, and_mask, or_mask = struct.unpack(">HHH", pdu[1:])
        (old,) = _taken(self.data.registers, at, 1, 1)
        return self._write(self.data.registers, pdu[1:3], [old & and_mask | or_mask & ~and_mask], pdu)

    def _read_write(self, pdu: bytes) -> bytes:
        first, count, _, written, size = struct.unpack(">HHHHB", pdu[1:10])
        if not 1 <= written <= 121 or size != 2 * written or len(pdu) != 10 + size:
            raise Refusal(ILLEGAL_VALUE)
        self._write(self.data.registers, pdu[5:7], _unpacked(pdu[10:]), b"")
        return bytes((23, 2 * count)) + _packed(_taken(self.data.registers, first, count, 125))

    def _read_queue(self, pdu: bytes) -> bytes:
        queue = self.data.queues.get(_word(pdu, 1))
        if queue is None:
            raise Refusal(ILLEGAL_ADDRESS)
        if len(queue) > 31:
            raise Refusal(ILLEGAL_VALUE)
        return struct.pack(">BHH", 24, 2 + 2 * len(queue), len(queue)) + _packed(queue)

    def _read_files(self, pdu: bytes) -> bytes:
        groups = [struct.unpack(">BHHH", pdu[at : at + 7]) for at in range(2, 2 + pdu[1], 7)]
        data = b""
        for kind, file, record, count in groups:
            values = _packed(_taken(self._file(kind, file), record, count, 121))
            data += bytes((1 + len(values), 6)) + values
        if len(data) > 245:
            raise Refusal(ILLEGAL_VALUE)
        return bytes((20, len(data))) + data

    def _write_files(self, pdu: bytes) -> bytes:
        at = 2
        while at < 2 + pdu[1]:
            kind, file, _, count = struct.unpack(">BHHH", pdu[at : at + 7])
            self._write(self._file(kind, file), pdu[at + 3 : at + 5], _unpacked(pdu[at + 7 : at + 7 + 2 * count]), b"")
            at += 7 + 2 * count
        return pdu

    def _file(self, kind: int, number: int) -> dict[int, int]:
        if kind != 6 or number not in self.data.files:
            raise Refusal(ILLEGAL_ADDRESS)
        return self.data.files[number]

    def _diagnose(self, pdu: bytes) -> bytes:
        subfunction = _word(pdu, 1)
        if subfunction in (0, 1, 3, 10, 20):
            return pdu
        if subfunction == 2 or subfunction in _COUNTERS:
            return pdu[:3] + struct.pack(">H", self.messages & 0xFFFF)
        raise Refusal(ILLEGAL_FUNCTION)

    def _identify(self, pdu: bytes) -> bytes:
        kind, code, first = struct.unpack(">BBB", pdu[1:])
        if kind != 14:
            raise Refusal(ILLEGAL_FUNCTION)
        last = {1: 2, 2: 0x7F, 3: 0xFF, 4: first}.get(code)
        if last is None:
            raise Refusal(ILLEGAL_VALUE)
        known = self.data.identification
        if code == 4 and first not in known:
            raise Refusal(ILLEGAL_ADDRESS)
        wanted = [number for number in sorted(known) if (first if first in known else 0) <= number <= last]
        data, told = b"", 0
        for number in wanted:
            value = bytes((number, len(known[number]))) + known[number]
            if 7 + len(data) + len(value) > _MAX_PDU:
                break
            data += value
            told += 1
        more = wanted[told:]
        return bytes((43, 14, code, 0x83, 0xFF if more else 0, more[0] if more else 0, told)) + data


def _taken(held: dict[int, Any], first: int, count: int, most: int) -> list[int]:
    if not 1 <= count <= most:
        raise Refusal(ILLEGAL_VALUE)
    try:
        return [held[at] for at in range(first, first + count)]
    except KeyError:
        raise Refusal(ILLEGAL_ADDRESS) from None


def _word(pdu: bytes, at: int) -> int:
    return int.from_bytes(pdu[at : at + 2], "big")


def _packed(values: Sequence[int]) -> bytes:
    return struct.pack(f">{len(values)}H", *values)


def _unpacked(data: bytes) -> list[int]:
    return list(struct.unpack(f">{len(data) // 2}H", data))
