"""A driver written for pymodbus' client runs on a shared bus by changing one line."""

import asyncio

import pytest
from pymodbus.client import AsyncModbusSerialClient
from pymodbus.exceptions import ConnectionException, ModbusIOException

from rs485bus import open_bus
from rs485bus.compat import BusClient
from rs485bus.sim import SimMks, SimUnit, VirtualLine
from tests.integration.support import virtual


class ForeignDriver:
    """As somebody wrote it for pymodbus, knowing nothing of this package."""

    def __init__(self, client: "AsyncModbusSerialClient | BusClient", unit: int) -> None:
        self.client = client
        self.unit = unit

    async def setpoint(self, value: int) -> int:
        if not self.client.connected:
            await self.client.connect()
        written = await self.client.write_register(1, value, device_id=self.unit)
        assert not written.isError()
        read = await self.client.read_holding_registers(1, count=2, device_id=self.unit)
        assert not read.isError()
        return read.registers[0]


@virtual
async def test_a_foreign_driver_shares_the_bus_with_others() -> None:
    unit = SimUnit(7, {register: register for register in range(8)})
    async with open_bus(VirtualLine(unit, SimMks(1))) as bus:
        driver = ForeignDriver(BusClient(bus), 7)
        mine, *theirs = await asyncio.gather(
            driver.setpoint(55), *(bus.unit(1).read_input_registers(0x31, 3) for _ in range(5))
        )
        assert mine == 55
        assert theirs == [[0, 0, 0]] * 5


@virtual
async def test_it_answers_in_pymodbus_terms() -> None:
    unit = SimUnit(7, {register: register for register in range(8)})
    async with open_bus(VirtualLine(unit)) as bus:
        async with BusClient(bus) as client:
            assert (await client.read_input_registers(2, count=2, device_id=7)).registers == [2, 3]
            assert (await client.write_registers(4, [9, 8], device_id=7)).count == 2
            refused = await client.read_holding_registers(100, device_id=7)
            assert refused.isError()
            assert refused.exception_code == 2
            unknown = await client.read_coils(0, count=3, device_id=7)
            assert unknown.exception_code == 1
            with pytest.raises(ModbusIOException, match="No reply"):
                await client.read_holding_registers(0, device_id=9)
            await client.write_register(5, 77, device_id=0)
            assert unit.registers[5] == 77
            assert client.convert_from_registers([0x3F80, 0], client.DATATYPE.FLOAT32) == 1.0
        assert bus.connected  # the bus is others' too


@virtual
async def test_a_write_that_is_not_answered_is_not_repeated() -> None:
    class Mute(SimUnit):
        def receive(self, frame: bytes, now: float) -> bytes | None:
            super().receive(frame, now)
            return None

    unit = Mute(7, {0: 0})
    async with open_bus(VirtualLine(unit)) as bus:
        with pytest.raises(ModbusIOException, match="Nobody knows"):
            await BusClient(bus).write_register(0, 1, device_id=7)
        assert len(unit.writes) == 1


@virtual
async def test_after_the_bus_was_closed_it_is_not_connected() -> None:
    async with open_bus(VirtualLine(SimUnit(7, {0: 0}))) as bus:
        client = BusClient(bus)
        assert client.connected
    assert not client.connected
    with pytest.raises(ConnectionException):
        await client.read_holding_registers(0, device_id=7)
