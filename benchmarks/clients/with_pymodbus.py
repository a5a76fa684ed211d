"""pymodbus, its asyncio client."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from pymodbus.client import AsyncModbusSerialClient
from pymodbus.exceptions import ModbusException


class Client:
    async def open(self, port: str, baudrate: int, timeout: float) -> None:
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        self._client = AsyncModbusSerialClient(port, baudrate=baudrate, timeout=timeout)
        await self._client.connect()

    async def read(self, unit: int, register: int, count: int) -> Sequence[int]:
        reply = await self._client.read_holding_registers(register, count=count, device_id=unit)
        if reply.isError():
            raise ModbusException(str(reply))
        return reply.registers

    async def write(self, unit: int, register: int, values: Sequence[int]) -> None:
        reply = await self._client.write_registers(register, list(values), device_id=unit)
        if reply.isError():
            raise ModbusException(str(reply))

    stop = write

    async def close(self) -> None:
        self._client.close()
