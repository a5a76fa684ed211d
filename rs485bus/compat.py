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
from pymodbus.exceptions import ConnectionException, ModbusIOException, ParameterException
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU

from rs485bus.bus.bus import Bus
from rs485bus.errors import BroadcastConflict, BusClosed, DeviceRefused, RequestFailed
from rs485bus.wire.frames import from_pdu
from rs485bus.wire.registers import Repeat


class BroadcastRefused(ParameterException, BroadcastConflict):
    """A request to `device_id=0` is a read, or a family would act on it that it was not meant for. Nothing was sent.

    It is pymodbus' exception for what cannot be asked, and this package's for broadcasts.
    """


class BusClient(ModbusClientMixin[Awaitable[ModbusPDU]]):
    """pymodbus' client methods, sent over a bus.

    They return pymodbus' PDUs, and raise its exceptions. A device that refuses gives a PDU whose `isError()` is true.

    Args:
        bus: an open bus. It stays open when the client is closed.
    """

    def __init__(self, bus: Bus) -> None:
        super().__init__()  # type: ignore[no-untyped-call] # pymodbus leaves it untyped
        self._bus = bus
        self._decoder = DecodePDU(False)

    @property
    def connected(self) -> bool:
        """Whether the bus has its port."""
        return self._bus.connected

    async def connect(self) -> bool:
        """The bus is open already."""
        return self.connected

    def close(self) -> None:
        """Nothing: the bus is others' too."""

    async def __aenter__(self) -> BusClient:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def execute(self, no_response_expected: bool, request: ModbusPDU) -> Awaitable[ModbusPDU]:
        """Send any request. With `no_response_expected` nobody is told whether it was answered."""
        return self._execute(no_response_expected, request)

    async def _execute(self, no_response_expected: bool, request: ModbusPDU) -> ModbusPDU:
        head = bytes((request.dev_id, request.function_code)) + request.encode()
        reply_class = self._decoder.lookupPduClass(head)
        if reply_class is None:
            raise ModbusIOException(f"function {request.function_code} is not known to pymodbus")
        frame = from_pdu(request.dev_id, request, reply_class)
        repeat = Repeat.NEVER if frame.writes else Repeat.SAFE
        try:
            reply = await self._bus.ask(frame, repeat=repeat, moves=frame.writes)
        except DeviceRefused as refused:
            return ExceptionResponse(request.function_code, refused.code or 0, device_id=request.dev_id)
        except BroadcastConflict as error:
            raise BroadcastRefused(str(error)) from error
        except BusClosed as error:
            raise ConnectionException(str(error)) from error
        except RequestFailed as error:
            if no_response_expected:
                return request
            if error.code is not None:  # the frame that came, as pymodbus gives it
                return ExceptionResponse(request.function_code, error.code, device_id=request.dev_id)
            raise ModbusIOException(str(error)) from error
        if not reply:
            return request  # a broadcast: nobody answers
        decoded = self._decoder.decode(reply[1:-2])
        if decoded is None:
            raise ModbusIOException(f"the reply {reply.hex(' ')} could not be decoded")
        decoded.dev_id = request.dev_id
        return decoded
