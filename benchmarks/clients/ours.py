"""rs485bus."""

from __future__ import annotations

from collections.abc import Sequence

from rs485bus import BusConfig, Urgency, open_bus


class Client:
    async def open(self, port: str, baudrate: int, timeout: float) -> None:
        self._bus = await open_bus(port, baudrate=baudrate, config=BusConfig(reply_timeout=timeout))

    async def read(self, unit: int, register: int, count: int) -> Sequence[int]:
        return await self._bus.unit(unit).read_holding_registers(register, count)

    async def write(self, unit: int, register: int, values: Sequence[int]) -> None:
        await self._bus.unit(unit).write_registers(register, values)

    async def stop(self, unit: int, register: int, values: Sequence[int]) -> None:
        await self._bus.unit(unit).write_registers(register, values, urgency=Urgency.STOP)

    async def close(self) -> None:
        await self._bus.aclose()
