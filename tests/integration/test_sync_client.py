"""A synchronous driver on a bus in another thread."""

import asyncio
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import anyio.to_thread
import pytest
from anyio.from_thread import start_blocking_portal
from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ConnectionException, ModbusIOException

from rs485bus import Bus, BusConfig, MksServo, open_bus
from rs485bus.compat import SyncBusClient
from rs485bus.errors import WrongThread
from rs485bus.sim import SimMks, SimUnit, VirtualLine


class ForeignDriver:
    """As somebody wrote it for pymodbus' synchronous client."""

    def __init__(self, client: Any, unit: int) -> None:
        self.client = client
        self.unit = unit

    def setpoint(self, value: int) -> int:
        if not self.client.is_socket_open():
            self.client.connect()
        with self.client as client:
            assert not client.write_register(1, value, device_id=self.unit).isError()
            read = client.read_holding_registers(1, count=2, device_id=self.unit)
            assert not read.isError()
            return int(read.registers[0])


@contextmanager
def bus_in_a_thread(*devices: Any, **config: Any) -> Iterator[Bus]:
    with (
        start_blocking_portal() as portal,
        portal.wrap_async_context_manager(open_bus(VirtualLine(*devices), config=BusConfig(**config))) as bus,
    ):
        yield bus


def unit(address: int = 7) -> SimUnit:
    return SimUnit(address, {register: register for register in range(8)})


def test_a_synchronous_driver_shares_the_bus_with_other_threads() -> None:
    with bus_in_a_thread(*(unit(address) for address in range(1, 5))) as bus:
        client = SyncBusClient(bus)
        drivers = [ForeignDriver(client, address) for address in range(1, 5)]
        with ThreadPoolExecutor(4) as threads:
            for value in range(10):
                assert list(threads.map(lambda driver, value=value: driver.setpoint(value), drivers)) == [value] * 4  # type: ignore[misc]
        assert bus.stats.transactions >= 80


def test_it_answers_in_pymodbus_terms() -> None:
    with bus_in_a_thread(unit(), reply_timeout=0.02, retries=0) as bus:
        client: Any = SyncBusClient(bus)
        assert client.connect()
        assert client.connected
        assert client.socket is not None
        assert client.read_input_registers(2, count=2, device_id=7).registers == [2, 3]
        assert 0 <= client.idle_time() < 5
        assert client.read_holding_registers(100, device_id=7).exception_code == 2
        with pytest.raises(ModbusIOException, match="No reply"):
            client.read_holding_registers(0, device_id=9)
        with pytest.warns(DeprecationWarning, match="slave= is called device_id="):
            assert client.read_holding_registers(2, count=2, slave=7).registers == [2, 3]
        client.close()
        assert not client.connected
        assert client.read_holding_registers(2, device_id=7).registers == [2]  # it connects by itself, as pymodbus does
        theirs = set(dir(ModbusSerialClient)) | set(vars(ModbusSerialClient("/dev/ttyS0")))
        assert {name for name in theirs if not name.startswith("_")} <= set(dir(client))
        for refused in (lambda: client.send(b"1"), lambda: client.recv(1)):
            with pytest.raises(NotImplementedError, match=r"execute\(\)"):
                refused()


def test_a_driver_in_a_worker_thread_beside_a_moving_axis() -> None:
    async def main() -> None:
        async with open_bus(VirtualLine(unit(), SimMks(1))) as bus:
            x = MksServo(bus, 1)
            await x.enable()
            move = x.move_by(0.5, rpm=600)
            driver = ForeignDriver(SyncBusClient(bus), 7)
            assert await anyio.to_thread.run_sync(driver.setpoint, 55) == 55
            assert await move == pytest.approx(0.5, abs=0.01)

    asyncio.run(main())


def test_in_the_thread_of_the_bus_it_says_what_to_do() -> None:
    async def main() -> None:
        async with open_bus(VirtualLine(unit())) as bus:
            with pytest.raises(WrongThread, match=r"anyio\.to_thread\.run_sync\(driver\.poll\)"):
                SyncBusClient(bus).read_holding_registers(0, device_id=7)

    asyncio.run(main())


def test_a_call_ends_when_the_bus_or_its_loop_does() -> None:
    with bus_in_a_thread(unit(), reply_timeout=5.0) as bus:
        client = SyncBusClient(bus)
        ended: list[BaseException] = []

        def wait() -> None:
            try:
                client.read_holding_registers(0, device_id=9)
            except Exception as error:
                ended.append(error)

        thread = threading.Thread(target=wait)
        thread.start()
        time.sleep(0.1)
    thread.join(5)
    assert not thread.is_alive()
    assert isinstance(ended[0], ConnectionException | ModbusIOException)
    with pytest.raises(ConnectionException):
        client.read_holding_registers(0, device_id=7)
    assert not client.connected


def test_who_is_interrupted_takes_back_what_was_not_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    import concurrent.futures

    with bus_in_a_thread(unit(), reply_timeout=0.3, retries=0) as bus:
        client = SyncBusClient(bus)
        first = threading.Thread(target=lambda: client.execute(True, _request(9)))
        first.start()
        time.sleep(0.1)

        def interrupt(self: Any, timeout: float | None = None) -> None:
            raise KeyboardInterrupt

        with monkeypatch.context() as patch:
            patch.setattr(concurrent.futures.Future, "result", interrupt)
            with pytest.raises(KeyboardInterrupt):
                client.write_register(1, 5, device_id=7)
        first.join(5)
        assert client.read_holding_registers(1, device_id=7).registers == [1]


def _request(device_id: int) -> Any:
    from pymodbus.pdu.register_message import ReadHoldingRegistersRequest

    return ReadHoldingRegistersRequest(address=0, count=1, dev_id=device_id)
