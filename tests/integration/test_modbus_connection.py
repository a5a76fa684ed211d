"""A device library written for modbus-connection runs on a shared bus. Needs that package (Python 3.12 or later)."""

import asyncio
from typing import Any

import pytest

from rs485bus import BusConfig, MksServo, open_bus
from rs485bus.sim import ModbusData, SimMks, SimModbus, VirtualLine
from tests.integration.support import virtual

library: Any = pytest.importorskip("modbus_connection", reason="modbus-connection needs Python 3.12 or later")
model: Any = pytest.importorskip("modbus_connection.model")
backend: Any = pytest.importorskip("rs485bus.compat.modbus_connection")


class Meter(model.Component):  # type: ignore[misc] # it may not be there
    """As somebody wrote it for modbus-connection, knowing nothing of this package."""

    voltage = model.gauge(0, 0.1, unit="V")
    current = model.gauge(1, 0.1, unit="A")
    energy = model.uint32(2, unit="Wh")
    relay = model.coil(0, writable=True)


def device(address: int = 7) -> SimModbus:
    registers = {0: 2305, 1: 42, 2: 1, 3: 2, **{at: at for at in range(4, 32)}}
    coils = dict.fromkeys(range(16), False)
    data = ModbusData(coils, coils, registers, registers, {30: [440, 4740]}, {4: {1: 0x0DFE, 2: 0x20}}, {0: b"ACME"})
    return SimModbus(address, data)


@virtual
async def test_a_typed_device_is_read_and_written_beside_a_moving_axis() -> None:
    async with open_bus(VirtualLine(sim := device(), SimMks(1))) as bus:
        x = MksServo(bus, 1)
        await x.enable()
        move = x.move_by(2.0, rpm=600)
        meter = Meter(backend.BusConnection(bus).for_unit(7))
        for _ in range(5):
            await meter.async_update()
            assert (meter.voltage, meter.current, meter.energy) == (pytest.approx(230.5), pytest.approx(4.2), 65538)
        await meter.write("relay", True)
        assert sim.data.coils[0]
        assert await move == pytest.approx(2.0, abs=0.01)


@virtual
async def test_a_unit_has_the_whole_protocol() -> None:
    async with open_bus(VirtualLine(sim := device())) as bus:
        connection = backend.BusConnection(bus)
        unit = connection.for_unit(7)
        assert isinstance(unit, library.ModbusUnit)
        assert isinstance(connection, library.ModbusConnection)
        assert connection.for_unit(7) is unit
        assert await unit.read_holding_registers(0, 2) == [2305, 42]
        assert await unit.read_input_registers(0, 2) == [2305, 42]
        await unit.write_register(4, 9)
        await unit.write_registers(5, [8, 7])
        await unit.mask_write_register(4, 0, 3)
        assert await unit.read_write_registers(4, 3, 6, [1]) == [3, 8, 1]
        await unit.write_coil(1, True)
        await unit.write_coils(2, [True, False])
        assert await unit.read_coils(0, 4) == [False, True, True, False]
        assert await unit.read_discrete_inputs(0, 2) == [False, True]
        assert await unit.read_fifo_queue(30) == [440, 4740]
        assert await unit.read_file_record(4, 1, 2) == [0x0DFE, 0x20]
        await unit.write_file_record(4, 1, [1, 2])
        assert sim.data.files[4] == {1: 1, 2: 2}
        assert await unit.read_exception_status() == 0
        assert await unit.report_server_id() == b"\x01\xff"
        assert await unit.read_device_identification() == {0: b"ACME"}
        assert await unit.diagnostics(0, 0x1234) == 0x1234
        assert await unit.diagnostics(11) == sim.messages
        assert (await unit.get_comm_event_counter())[0] is True
        assert await unit.get_comm_event_log() == b"\x20\0"


@virtual
async def test_what_went_wrong_is_told_by_its_own_exceptions() -> None:
    async with open_bus(line := VirtualLine(device()), config=BusConfig(retries=0, reply_timeout=0.02)) as bus:
        connection = backend.BusConnection(bus)
        unit = connection.for_unit(7)
        with pytest.raises(library.IllegalDataAddressError, match=r"read_coils\(100, 1\): Refused"):
            await unit.read_coils(100, 1)
        with pytest.raises(library.ModbusTimeoutError):
            await connection.for_unit(9).read_coils(0, 1)
        with pytest.raises(library.ModbusTimeoutError):
            await connection.for_unit(9).write_coil(0, True)
        with pytest.raises(ValueError, match="count 3000"):
            await unit.read_coils(0, 3000)
        lost: list[int] = []
        end = connection.on_connection_lost(lambda: lost.append(1))
        line.unplug()
        await asyncio.sleep(0.01)
        assert lost == [1]
        assert not connection.connected
        with pytest.raises(library.ModbusConnectionError):
            await connection.connect()
        with pytest.raises(library.ModbusConnectionError):
            await unit.write_register(0, 1)
        line.plug()
        assert await unit.read_coils(0, 1) == [False]  # a read waits for the port
        end()
        await connection.close()
        with pytest.raises(library.ClientClosedError):
            await unit.read_coils(0, 1)
        with pytest.raises(library.ClientClosedError):
            await connection.connect()
        assert bus.connected
    other = backend.BusConnection(bus)
    with pytest.raises(library.ClientClosedError):
        await other.for_unit(8).read_coils(0, 1)


@virtual
async def test_spacing_and_timeout_are_the_unit_s_own() -> None:
    async with open_bus(VirtualLine(device())) as bus:
        unit = backend.BusConnection(bus).for_unit(7)
        unit.set_message_spacing(0.05)
        unit.require_timeout(2.0)
        state = bus.owner.units[7]
        assert (state.pause, state.reply_timeout) == (0.05, 2.0)
        began = bus.now()
        for _ in range(5):
            await unit.read_coils(0, 1)
        assert bus.now() - began >= 0.2
        unit.set_message_spacing(0)
        unit.require_timeout(None)
        unit.require_connect_delay(1.0)
        assert (state.pause, state.reply_timeout) == (0.0, bus.config.reply_timeout)
        assert bus.owner.units[8].reply_timeout == bus.config.reply_timeout
        for wrong in (unit.set_message_spacing, unit.require_timeout, unit.require_connect_delay):
            with pytest.raises(ValueError, match="must be non-negative"):
                wrong(-1)
