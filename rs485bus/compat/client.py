"""A pymodbus client over a shared bus.

A driver written for `AsyncModbusSerialClient` runs on a bus that others use too, by changing the line that makes it:

    client = BusClient(bus)    # was: AsyncModbusSerialClient("/dev/ttyUSB0", baudrate=38400)

What pymodbus does and this does not: a write that is not answered is not repeated, and `device_id=0` is for writes that
no family on the bus takes for its own but the one they are meant for. Others raise `BroadcastRefused`.
"""

from __future__ import annotations

from collections.abc import Awaitable
from types import TracebackType

from pymodbus.client.mixin import ModbusClientMixin
from pymodbus.exceptions import ConnectionException
from pymodbus.pdu import ModbusPDU

from rs485bus.bus.bus import Bus
from rs485bus.compat.context import BusContext
from rs485bus.compat.exchange import exchange
from rs485bus.compat.older import takes_older_calls


@takes_older_calls
class BusClient(ModbusClientMixin[Awaitable[ModbusPDU]]):
    """pymodbus' client methods, sent over a bus.

    They return pymodbus' PDUs, and raise its exceptions. A device that refuses gives a PDU whose `isError()` is true.
    Arguments as older versions name them (`slave=`, `unit=`, a count by its place) do, with a `DeprecationWarning`.

    Args:
        bus: an open bus. It stays open when the client is closed.
        reply_timeout: seconds a device may take to begin its answer; None for what its unit or the bus is set to.
        allow_reserved_address: devices may have an address in 248..255, which the specification reserves.
    """

    def __init__(self, bus: Bus, *, reply_timeout: float | None = None, allow_reserved_address: bool = False) -> None:
        super().__init__()  # type: ignore[no-untyped-call] # pymodbus leaves it untyped
        self._bus = bus
        self._reply_timeout = reply_timeout
        self._allow_reserved_address = allow_reserved_address
        self.ctx = BusContext(bus, self.execute)
        self.comm_params = self.ctx.comm_params

    def __str__(self) -> str:
        return f"{type(self).__name__} {self.comm_params.host}"

    @property
    def connected(self) -> bool:
        """Whether the bus has its port, and the client was not closed."""
        return self.ctx.is_active()

    async def connect(self) -> bool:
        """The bus is open already. True where it has its port."""
        return self.ctx.open()

    def close(self) -> None:
        """Send nothing from now on, until `connect()`. The bus stays open: it is others' too."""
        self.ctx.close()

    async def __aenter__(self) -> BusClient:
        await self.connect()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def register(self, custom_response_class: type[ModbusPDU]) -> None:
        """Know the replies of a function that pymodbus does not: their class, as pymodbus' page on it makes one."""
        self.ctx.framer.decoder.register(custom_response_class)

    def set_max_no_responses(self, max_count: int) -> None:
        """Nothing but to be remembered: the bus never gives its port up because a device does not answer."""
        self.ctx.max_until_disconnect = max_count

    def execute(self, no_response_expected: bool | ModbusPDU, request: ModbusPDU | None = None) -> Awaitable[ModbusPDU]:
        """Send any request. With `no_response_expected` nobody is told whether it was answered."""
        if isinstance(no_response_expected, ModbusPDU):  # as before pymodbus 3.8
            request, no_response_expected = no_response_expected, False
        assert request is not None
        return self._execute(no_response_expected, request)

    async def _execute(self, no_response_expected: bool, request: ModbusPDU) -> ModbusPDU:
        if self.ctx.is_closed:
            raise ConnectionException(f"Not connected[{self}]: connect() it again")
        return await exchange(
            self._bus,
            self.ctx,
            request,
            no_response_expected=no_response_expected,
            allow_reserved_address=self._allow_reserved_address,
            reply_timeout=self._reply_timeout,
        )
