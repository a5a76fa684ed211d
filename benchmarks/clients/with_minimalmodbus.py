"""minimalmodbus, which blocks."""

from __future__ import annotations

from collections.abc import Sequence

import minimalmodbus


class Client:
    def open(self, port: str, baudrate: int, timeout: float) -> None:
        self._units: dict[int, minimalmodbus.Instrument] = {}
        self._port = port
        serial = self._unit(1).serial
        serial.baudrate = baudrate
        serial.timeout = timeout

    def read(self, unit: int, register: int, count: int) -> Sequence[int]:
        values: list[int] = self._unit(unit).read_registers(register, count)
        return values

    def write(self, unit: int, register: int, values: Sequence[int]) -> None:
        self._unit(unit).write_registers(register, list(values))

    def close(self) -> None:
        self._unit(1).serial.close()

    def _unit(self, address: int) -> minimalmodbus.Instrument:
        unit = self._units.get(address)
        if unit is None:
            # Instruments on one port share it.
            unit = self._units[address] = minimalmodbus.Instrument(self._port, address)
        return unit
