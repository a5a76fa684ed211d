"""Faces of other libraries over a shared bus: drivers written for those run beside everything else on the pair.

`BusClient` stands for pymodbus' `AsyncModbusSerialClient`, `SyncBusClient` for its `ModbusSerialClient`.
`rs485bus.compat.modbus_connection` is a backend for modbus-connection.
"""

from rs485bus.compat.client import BusClient
from rs485bus.compat.context import BusContext
from rs485bus.compat.exchange import BroadcastRefused, RequestRefused
from rs485bus.compat.sync import SyncBusClient

__all__ = ["BroadcastRefused", "BusClient", "BusContext", "RequestRefused", "SyncBusClient"]
