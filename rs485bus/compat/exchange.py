"""One request of pymodbus over a bus: its PDU out, a PDU of its reply back, its exceptions."""

from __future__ import annotations

import struct

from pymodbus.exceptions import ConnectionException, ModbusException, ModbusIOException, ParameterException
from pymodbus.pdu import DecodePDU, ExceptionResponse, ModbusPDU
from pymodbus.pdu.file_message import ReadFifoQueueResponse

from rs485bus.bus.bus import Bus
from rs485bus.compat.context import BusContext
from rs485bus.errors import BroadcastConflict, BusClosed, DeviceRefused, LimitExceeded, RequestFailed
from rs485bus.wire.frames import HIGHEST_ADDRESS, MAX_ADDRESS, Request, from_pdu
from rs485bus.wire.functions import fifo
from rs485bus.wire.registers import Repeat


class BroadcastRefused(ParameterException, BroadcastConflict):
    """A request to `device_id=0` is a read, or a family would act on it that it was not meant for. Nothing was sent.

    It is pymodbus' exception for what cannot be asked, and this package's for broadcasts.
    """


class RequestRefused(ParameterException, LimitExceeded):
    """A request cannot be said in a frame: an address, a count or a value is out of its range. Nothing was sent.

    It is pymodbus' exception for what cannot be asked, and a `ValueError` as this package's is.
    """


def refused(error: Exception) -> RequestRefused:
    """The exception for an error that came up while a frame was made."""
    return RequestRefused(f"{error}. Nothing was sent")


UNSAYABLE = (ValueError, TypeError, OverflowError, AttributeError, struct.error)
"""What making a frame of wrong arguments may raise."""


async def exchange(
    bus: Bus,
    context: BusContext,
    request: ModbusPDU,
    *,
    no_response_expected: bool = False,
    allow_reserved_address: bool = False,
    reply_timeout: float | None = None,
) -> ModbusPDU:
    """Send a request; return the PDU that answers it, or the request itself where nobody answers.

    Args:
        bus: the bus.
        context: knows what was registered, and who traces.
        request: what to send.
        no_response_expected: nobody is told that it was not answered.
        allow_reserved_address: 248..255 are addresses, too.
        reply_timeout: seconds the device may take to answer; None for what the unit or the bus is set to.

    Raises:
        ModbusException: as pymodbus raises it; the classes say more.
    """
    decoder = context.framer.decoder
    frame = _frame(decoder, request, HIGHEST_ADDRESS if allow_reserved_address else MAX_ADDRESS)
    context.trace_pdu(True, request)
    context.trace_packet(True, frame.adu)
    repeat = Repeat.NEVER if frame.writes else Repeat.SAFE
    try:
        reply = await bus.ask(frame, repeat=repeat, moves=frame.writes, reply_timeout=reply_timeout)
    except DeviceRefused as error:
        return ExceptionResponse(request.function_code, error.code or 0, device_id=request.dev_id)
    except BroadcastConflict as error:
        raise BroadcastRefused(str(error)) from error
    except BusClosed as error:
        raise ConnectionException(str(error)) from error
    except RequestFailed as error:
        if no_response_expected:
            return request
        if error.code is not None:  # the frame that came, as pymodbus gives it
            return ExceptionResponse(request.function_code, error.code, device_id=request.dev_id)
        raise ModbusIOException(str(error), request.function_code) from error
    if not reply:
        return request
    context.trace_packet(False, reply)
    decoded = _decoded(decoder, request, reply)
    context.trace_pdu(False, decoded)
    return decoded


def _frame(decoder: DecodePDU, request: ModbusPDU, highest: int) -> Request:
    try:
        head = bytes((request.dev_id, request.function_code)) + request.encode()
        reply_class = decoder.lookupPduClass(head)
        if reply_class is None:
            raise RequestRefused(
                f"function {request.function_code} is not known to pymodbus: register() the class of its reply"
            )
        return from_pdu(request.dev_id, request, reply_class, highest=highest)
    except ModbusException:
        raise
    except UNSAYABLE as error:
        raise refused(error) from error


def _decoded(decoder: DecodePDU, request: ModbusPDU, reply: bytes) -> ModbusPDU:
    try:
        decoded = decoder.decode(reply[1:-2])
    except Exception as error:  # of a class that somebody registered, say
        raise ModbusIOException(f"the reply {reply.hex(' ')} could not be decoded: {error}") from error
    if decoded is None:
        raise ModbusIOException(f"the reply {reply.hex(' ')} could not be decoded")
    if isinstance(decoded, ReadFifoQueueResponse):
        decoded.values = fifo(reply)  # pymodbus before 3.12 makes nothing of them
    decoded.dev_id = request.dev_id
    decoded.transaction_id = request.transaction_id
    return decoded
