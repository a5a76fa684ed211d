"""tmodbus on asyncio."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import tmodbus


class Client:
    async def open(self, port: str, baudrate: int, timeout: float) -> None:
        self._first = tmodbus.create_async_rtu_client(port, unit_id=1, timeout=timeout, baudrate=baudrate)
        await self._first.connect()
        self._units: dict[int, Any] = {1: self._first}

    async def read(self, unit: int, register: int, count: int) -> Sequence[int]:
        values: list[int] = await self._unit(unit).read_holding_registers(register, count)
        return values

    async def write(self, unit: int, register: int, values: Sequence[int]) -> None:
        await self._unit(unit).write_multiple_registers(register, list(values))

    stop = write

    async def close(self) -> None:
        await self._first.disconnect()

    def _unit(self, address: int) -> Any:
        unit = self._units.get(address)
        if unit is None:
            unit = self._units[address] = self._first.for_unit_id(address)
        return unit
