"""anymodbus on asyncio."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import anymodbus


class Client:
    async def open(self, port: str, baudrate: int, timeout: float) -> None:
        config = anymodbus.BusConfig(request_timeout=timeout)
        self._bus = await anymodbus.open_modbus_rtu(port, baudrate=baudrate, parity="none", config=config)
        self._units: dict[int, Any] = {}

    async def read(self, unit: int, register: int, count: int) -> Sequence[int]:
        values: tuple[int, ...] = await self._unit(unit).read_holding_registers(register, count=count)
        return values

    async def write(self, unit: int, register: int, values: Sequence[int]) -> None:
        await self._unit(unit).write_registers(register, list(values))

    stop = write

    async def close(self) -> None:
        await self._bus.aclose()

    def _unit(self, address: int) -> Any:
        unit = self._units.get(address)
        if unit is None:
            unit = self._units[address] = self._bus.slave(address)
        return unit
