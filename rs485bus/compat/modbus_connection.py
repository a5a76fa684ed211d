"""A backend for modbus-connection: device libraries written for that run beside the drives on one pair.

    async with open_bus("/dev/ttyUSB0", baudrate=38400) as bus:
        meter = Meter(BusConnection(bus).for_unit(7))
        await meter.async_update()

Needs the extra: `pip install "rs485bus[modbus-connection]"` (Python 3.12 or later).
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

try:
    from modbus_connection import (
        ClientClosedError,
        ModbusConnection,
        ModbusConnectionError,
        ModbusError,
        ModbusExceptionError,
        ModbusSerialParams,
        ModbusTimeoutError,
    )
except ImportError as error:
    raise ImportError(
        'modbus-connection is missing: pip install "rs485bus[modbus-connection]" (it needs Python 3.12 or later)'
    ) from error

from rs485bus.bus.bus import Bus
from rs485bus.bus.unit import Unit
from rs485bus.errors import BusClosed, DeviceOffline, DeviceRefused, NoReply, NotSent, OutcomeUnknown, RequestFailed
from rs485bus.wire.diagnostics import Diagnostic, diagnostic, diagnostic_data

_LONGEST = 10.0
"""Seconds: the longest a bus waits for one device."""


class BusConnection(ModbusConnection):
    """A shared bus, as modbus-connection knows a connection.

    Its connection is the bus' own: it is there while the bus is open, opens its port anew by itself, and is not closed
    by those who share it. Requests of many units take turns with everything else on the pair.

    Args:
        bus: an open bus. It stays open when the connection is closed.
        allow_reserved_address: units may have an address in 248..255, which the specification reserves.
    """

    def __init__(self, bus: Bus, *, allow_reserved_address: bool = False) -> None:
        line = bus.owner.pair.line
        params = ModbusSerialParams(device=bus.port, baudrate=line.baudrate, parity=line.parity, stopbits=line.stopbits)
        super().__init__(params, timeout=bus.config.reply_timeout)
        self._bus = bus
        self._allow_reserved_address = allow_reserved_address
        self._units: dict[int, BusUnit] = {}
        self._client = bus
        bus.on_lost(self._lost)

    @property
    def connected(self) -> bool:
        """Whether the bus has its port, and the connection was not closed."""
        return self._bus.connected and not self._closed

    async def connect(self) -> None:
        """The bus is open already; without its port it opens it by itself.

        Raises:
            ClientClosedError: the connection was closed, or the bus was.
            ModbusConnectionError: the port is gone.
        """
        if self._closed or self._bus.closed:
            raise ClientClosedError("the connection is closed")
        if not self._bus.connected:
            raise ModbusConnectionError(f"{self._target} is gone; the bus opens it again by itself")

    def for_unit(self, unit_id: int) -> BusUnit:
        """The unit at an address."""
        unit = self._units.get(unit_id)
        if unit is None:
            plain = self._bus.unit(unit_id, allow_reserved_address=self._allow_reserved_address)
            unit = self._units[unit_id] = BusUnit(self, plain, self._bus)
        return unit

    async def disconnect(self) -> None:
        """Nothing: the bus is others' too, and looks after its port by itself."""

    async def close(self) -> None:
        """Send nothing from now on. The bus stays open."""
        self._closed = True

    async def _connect_client(self) -> Any:
        return self._bus

    async def _close_client(self, client: Any) -> None:
        """Nothing to close."""

    def _lost(self) -> None:
        if not self._closed:
            self._lost_callbacks.fire()


class BusUnit:
    """One unit, with modbus-connection's method names. It raises its exceptions.

    Reads are repeated as the bus is set to; writes are not.
    """

    def __init__(self, connection: BusConnection, unit: Unit, bus: Bus) -> None:
        self._connection = connection
        self._unit = unit
        self._bus = bus

    @property
    def connected(self) -> bool:
        """Whether the bus has its port."""
        return self._connection.connected

    # Registers

    async def read_holding_registers(self, address: int, count: int) -> list[int]:
        with self._told("read_holding_registers", address, count):
            return await self._unit.read_holding_registers(address, count)

    async def read_input_registers(self, address: int, count: int) -> list[int]:
        with self._told("read_input_registers", address, count):
            return await self._unit.read_input_registers(address, count)

    async def write_register(self, address: int, value: int) -> None:
        with self._told("write_register", address, value):
            await self._unit.write_register(address, value)

    async def write_registers(self, address: int, values: list[int]) -> None:
        with self._told("write_registers", address, values):
            await self._unit.write_registers(address, values)

    async def mask_write_register(self, address: int, and_mask: int, or_mask: int) -> None:
        with self._told("mask_write_register", address, and_mask, or_mask):
            await self._unit.mask_write_register(address, and_mask, or_mask)

    async def read_write_registers(
        self, read_address: int, read_count: int, write_address: int, write_values: list[int]
    ) -> list[int]:
        with self._told("read_write_registers", read_address, read_count, write_address, write_values):
            return await self._unit.readwrite_registers(read_address, read_count, write_address, write_values)

    # Coils and discrete inputs

    async def read_coils(self, address: int, count: int) -> list[bool]:
        with self._told("read_coils", address, count):
            return await self._unit.read_coils(address, count)

    async def read_discrete_inputs(self, address: int, count: int) -> list[bool]:
        with self._told("read_discrete_inputs", address, count):
            return await self._unit.read_discrete_inputs(address, count)

    async def write_coil(self, address: int, value: bool) -> None:
        with self._told("write_coil", address, value):
            await self._unit.write_coil(address, value)

    async def write_coils(self, address: int, values: list[bool]) -> None:
        with self._told("write_coils", address, values):
            await self._unit.write_coils(address, values)

    # Queues, files, and what the device tells of itself

    async def read_fifo_queue(self, address: int) -> list[int]:
        with self._told("read_fifo_queue", address):
            return await self._unit.read_fifo_queue(address)

    async def read_file_record(self, file: int, record: int, length: int) -> list[int]:
        with self._told("read_file_record", file, record, length):
            return (await self._unit.read_file_record([(file, record, length)]))[0]

    async def write_file_record(self, file: int, record: int, values: list[int]) -> None:
        with self._told("write_file_record", file, record, values):
            await self._unit.write_file_record([(file, record, values)])

    async def read_exception_status(self) -> int:
        with self._told("read_exception_status"):
            return await self._unit.read_exception_status()

    async def report_server_id(self) -> bytes:
        with self._told("report_server_id"):
            return await self._unit.report_device_id()

    async def read_device_identification(self) -> dict[int, bytes]:
        with self._told("read_device_identification"):
            return (await self._unit.read_device_information()).information

    async def diagnostics(self, sub_function: int, data: int = 0) -> int:
        with self._told("diagnostics", sub_function, data):
            request = diagnostic(self._unit.address, Diagnostic(sub_function), data, highest=self._unit.highest)
            return int.from_bytes(diagnostic_data(await self._unit.ask(request, {}))[:2], "big")

    async def get_comm_event_counter(self) -> tuple[bool, int]:
        """Whether the device is ready, and how many messages it has completed."""
        with self._told("get_comm_event_counter"):
            counter = await self._unit.diag_get_comm_event_counter()
            return not counter.busy, counter.events

    async def get_comm_event_log(self) -> bytes:
        with self._told("get_comm_event_log"):
            return (await self._unit.diag_get_comm_event_log()).log

    # How

    def set_message_spacing(self, seconds: float) -> None:
        """Keep the pair quiet for so many seconds (1 at most) before each request to this unit."""
        if seconds < 0:
            raise ValueError("message_spacing must be non-negative")
        self._bus.unit(self._unit.address, pause=min(seconds, 1.0), allow_reserved_address=True)

    def require_timeout(self, seconds: float | None) -> None:
        """Wait for this unit's answers for so many seconds (10 at most); None for what the bus is set to.

        Other units are not waited for any longer than before.
        """
        if seconds is not None and seconds < 0:
            raise ValueError("timeout must be non-negative")
        usual = self._bus.config.reply_timeout
        wanted = usual if seconds is None else min(max(seconds, usual), _LONGEST)
        self._bus.unit(self._unit.address, reply_timeout=wanted, allow_reserved_address=True)

    def require_connect_delay(self, seconds: float | None) -> None:
        """Nothing: the bus is open already."""
        if seconds is not None and seconds < 0:
            raise ValueError("connect_delay must be non-negative")

    def on_connection_lost(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Have `callback` called when the port is lost. Returns a function that ends that."""
        end: Callable[[], None] = self._connection.on_connection_lost(callback)
        return end

    async def disconnect(self) -> None:
        """Nothing: the bus is others' too."""

    @contextlib.contextmanager
    def _told(self, name: str, *args: object) -> Iterator[None]:
        """Raise modbus-connection's exceptions in the place of the bus'."""
        if self._connection._closed:
            raise ClientClosedError("the connection is closed")
        try:
            yield
        except RequestFailed as error:
            shown = ", ".join(map(repr, args))
            raise _translated(error, f"{name}({shown}): {error}") from error


def _translated(error: RequestFailed, message: str) -> ModbusError:
    if error.code is not None:
        return ModbusExceptionError.from_code(error.code, message)
    if isinstance(error, DeviceRefused):
        return ModbusExceptionError(None, message)
    if isinstance(error, BusClosed):
        return ClientClosedError(message)
    if isinstance(error, NoReply | OutcomeUnknown | DeviceOffline):
        return ModbusTimeoutError(message)
    return ModbusConnectionError(message) if isinstance(error, NotSent) else ModbusError(message)
