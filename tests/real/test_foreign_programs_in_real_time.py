"""Masters and slaves that others wrote, on the other side of a real pseudo-terminal or socket, in real time."""

import asyncio
import contextlib
import re
import sys
from pathlib import Path

import pytest

from rs485bus import Bus, BusConfig, open_bus
from rs485bus.compat import BusClient
from rs485bus.errors import DeviceRefused, NoReply, PortNotFound
from rs485bus.sim import SimMks, SimUnit, VirtualLine
from rs485bus.wire.registers import Repeat
from tests.real.support import free_port, in_real_time, needs, null_modem, posix, run, running

pytestmark = posix

PYMODBUS_SLAVE = """
import asyncio, sys
from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.server import StartAsyncSerialServer

block = ModbusSequentialDataBlock(1, [700 + at for at in range(50)])
coils, inputs = (ModbusSequentialDataBlock(1, [0] * 50) for _ in range(2))
context = ModbusServerContext(devices={7: ModbusDeviceContext(hr=block, co=coils, di=inputs)}, single=False)

async def main():
    server = asyncio.create_task(StartAsyncSerialServer(context, port=sys.argv[1], baudrate=115200))
    await asyncio.sleep(0.3)
    print("ready", flush=True)
    await server

asyncio.run(main())
"""


@needs("mbpoll")
def test_mbpoll_reads_and_writes_a_virtual_line() -> None:
    async def main() -> None:
        unit = SimUnit(3, {register: 100 + register for register in range(8)})
        line = VirtualLine(unit, SimMks(1), baudrate=38400)
        async with await line.serve_pty() as port:
            common = ("mbpoll", "-m", "rtu", "-b", "38400", "-P", "none", "-0", "-1")
            read = await run(*common, "-a", "3", "-t", "4", "-r", "2", "-c", "3", port.path)
            assert re.findall(r"\[\d+\]:\s+(\d+)", read) == ["102", "103", "104"]
            await run(*common, "-a", "3", "-t", "4", "-r", "5", port.path, "4242")
            assert unit.registers[5] == 4242
            status = await run(*common, "-a", "1", "-t", "3", "-r", str(0xF1), port.path)
            assert re.findall(r"\[\d+\]:\s+(\d+)", status) == ["1"]

    in_real_time(main)


@needs("socat")
def test_a_pymodbus_slave_behind_our_bus(tmp_path: Path) -> None:
    async def main() -> None:
        async with (
            null_modem(tmp_path) as (ours, theirs),
            running(sys.executable, "-c", PYMODBUS_SLAVE, theirs, ready="ready"),
            open_bus(ours, baudrate=115200, config=BusConfig(reply_timeout=0.5)) as bus,
        ):
            unit = bus.unit(7)
            assert await unit.read_holding_registers(0, 3) == [700, 701, 702]
            await unit.write_registers(10, [1, 2, 3])
            await unit.write_register(13, 4, repeat=Repeat.VERIFY)
            assert await unit.read_holding_registers(10, 4) == [1, 2, 3, 4]
            await every_function_of_pymodbus(BusClient(bus))

    in_real_time(main)


async def every_function_of_pymodbus(client: BusClient) -> None:
    """Replies of all shapes: counted, fixed, variable, echoed."""
    assert (await client.read_coils(0, count=9, device_id=7)).bits[:9] == [False] * 9
    assert (await client.read_discrete_inputs(0, count=3, device_id=7)).bits[:3] == [False] * 3
    await client.write_coil(1, True, device_id=7)
    await client.write_coils(2, [True, False, True], device_id=7)
    assert (await client.read_coils(0, count=5, device_id=7)).bits[:5] == [False, True, True, False, True]
    await client.mask_write_register(address=0, and_mask=0xFF00, or_mask=0x0042, device_id=7)
    both = await client.readwrite_registers(read_address=0, read_count=2, write_address=20, values=[5], device_id=7)
    assert both.registers == [(700 & 0xFF00) | 0x42, 701]
    assert (await client.diag_query_data(b"\x12\x34", device_id=7)).message in (b"\x12\x34", [0x1234], [b"\x12\x34"])
    assert not (await client.report_device_id(device_id=7)).isError()
    assert not (await client.read_device_information(device_id=7)).isError()
    assert not (await client.diag_read_bus_message_count(device_id=7)).isError()


@needs("socat", "gcc")
def test_a_libmodbus_slave_behind_our_bus(tmp_path: Path) -> None:
    async def main() -> None:
        slave = tmp_path / "slave"
        source = Path(__file__).with_name("slave.c")
        flags = ("-I/usr/include/modbus", "-lmodbus")
        try:
            await run("gcc", "-o", str(slave), str(source), *flags)
        except AssertionError as error:
            pytest.skip(f"libmodbus is missing: sudo apt-get install libmodbus-dev ({error})"[:200])
        async with (
            null_modem(tmp_path) as (ours, theirs),
            running(str(slave), theirs, "115200", ready="ready"),
            open_bus(ours, baudrate=115200, config=BusConfig(reply_timeout=0.5)) as bus,
        ):
            unit = bus.unit(5)
            assert await unit.read_holding_registers(0, 3) == [500, 501, 502]
            await unit.write_register(1, 9)
            await unit.write_registers(2, [8, 7])
            assert await unit.read_holding_registers(0, 4) == [500, 9, 8, 7]
            with pytest.raises(DeviceRefused):
                await unit.read_holding_registers(15, 2)
            with pytest.raises(NoReply):
                await bus.unit(6).read_holding_registers(0, timeout=0.2)
            polls = [await unit.read_holding_registers(0, 4) for _ in range(50)]
            assert polls == [[500, 9, 8, 7]] * 50

    in_real_time(main)


async def connected(port: int) -> Bus:
    """A bus through a gateway that is coming up."""
    for _ in range(200):
        try:
            return await open_bus(f"socket://127.0.0.1:{port}", baudrate=38400)
        except PortNotFound:
            await asyncio.sleep(0.05)
    raise AssertionError("the gateway did not come up")


@pytest.mark.parametrize(
    "gateway", [pytest.param("socat", marks=needs("socat")), pytest.param("ser2net", marks=needs("ser2net"))]
)
def test_rtu_over_tcp_through_a_gateway(gateway: str, tmp_path: Path) -> None:
    async def main() -> None:
        unit = SimUnit(3, {register: 100 + register for register in range(8)})
        line = VirtualLine(unit, baudrate=38400)
        port = free_port()
        async with await line.serve_pty() as pty:
            if gateway == "socat":
                ends = (f"tcp-listen:{port},bind=127.0.0.1,reuseaddr,fork", f"{pty.path},rawer,b38400")
                command = ("socat", *ends)
            else:
                config = tmp_path / "ser2net.yaml"
                config.write_text(
                    f"connection: &c\n  accepter: tcp,127.0.0.1,{port}\n"
                    f"  connector: serialdev,{pty.path},38400n81,local\n  options:\n    kickolduser: true\n"
                )
                command = ("ser2net", "-n", "-c", str(config))
            async with running(*command):
                bus = await connected(port)
                assert await bus.unit(3).read_holding_registers(2, 2) == [102, 103]
                await bus.unit(3).write_register(5, 55)
                values = await asyncio.gather(*(bus.unit(3).read_holding_registers(at) for at in range(6)))
                assert values == [[100], [101], [102], [103], [104], [55]]
                await bus.aclose()

    in_real_time(main)


def test_a_gateway_that_closes_the_connection_is_an_unplugged_port() -> None:
    async def main() -> None:
        connections: list[asyncio.StreamWriter] = []
        unit = SimUnit(3, {0: 42})

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            connections.append(writer)
            try:
                while frame := await reader.read(256):
                    reply = unit.receive(frame, 0.0)
                    if reply is not None:
                        writer.write(reply)
            finally:
                writer.close()

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        config = BusConfig(reopen_min=0.05, tcp_gap=0.001)
        async with open_bus(f"socket://127.0.0.1:{port}", config=config) as bus:
            assert await bus.unit(3).read_holding_registers(0) == [42]
            connections[0].close()
            await asyncio.sleep(0.02)
            assert not bus.connected
            assert await asyncio.wait_for(bus.unit(3).read_holding_registers(0), 5) == [42]
            assert len(connections) == 2
        await asyncio.sleep(0.05)
        server.close()

    in_real_time(main)


def test_a_request_that_could_not_be_sent_in_its_time_does_not_arrive_later() -> None:
    async def main() -> None:
        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            with contextlib.suppress(OSError):
                while await reader.read(1000):
                    pass
            writer.close()

        server = await asyncio.start_server(serve, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        config = BusConfig(retries=0, reply_timeout=0.05, reopen_min=5.0, echo=False)
        bus = await open_bus(f"socket://127.0.0.1:{port}", config=config)
        unsent = type(bus._transport).unsent
        type(bus._transport).unsent = property(lambda self: 8)  # type: ignore[method-assign,assignment] # not acknowledged
        try:
            with pytest.raises(Exception, match="unit 3"):
                await bus.unit(3).write_register(0, 1)
            await asyncio.sleep(0.05)
            assert not bus.connected
        finally:
            type(bus._transport).unsent = unsent  # type: ignore[method-assign]
        await bus.aclose()
        await asyncio.sleep(0.05)
        server.close()

    in_real_time(main)


def test_no_gateway_is_told_at_once() -> None:
    async def main() -> None:
        with pytest.raises(Exception, match="refused the connection"):
            await open_bus(f"socket://127.0.0.1:{free_port()}")

    in_real_time(main)
