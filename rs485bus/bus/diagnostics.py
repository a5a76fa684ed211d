"""What a device tells of itself, by pymodbus' method names: status, counters, log, identification."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine
from typing import Any, Unpack

from rs485bus.arguments import choice, flag
from rs485bus.bus.functions import RequestOptions
from rs485bus.wire import diagnostics
from rs485bus.wire.diagnostics import DeviceInformation, Diagnostic, EventCounter, EventLog, ReadCode
from rs485bus.wire.frames import Request

_DELIMITER = 0x0A


class DiagnosticFunctions(ABC):
    """What asks a device about itself. Where there are counters, they are numbers of 16 bits."""

    address: int
    highest: int

    @abstractmethod
    def ask(self, request: Request, options: RequestOptions) -> Coroutine[Any, Any, bytes]:
        """Send a request; the coroutine returns the frame that answers it."""

    @abstractmethod
    def share_time(self, options: RequestOptions) -> Callable[[], RequestOptions]:
        """For several requests that share one `timeout`: the options of the next one."""

    async def read_exception_status(self, **options: Unpack[RequestOptions]) -> int:
        """Read the eight exception status outputs, function 07: one bit each."""
        return (await self.ask(diagnostics.exception_status(self.address, highest=self.highest), options))[2]

    async def report_device_id(self, **options: Unpack[RequestOptions]) -> bytes:
        """Read what the device says it is, function 17.

        Server id, run indicator (0x00 off, 0xFF on) and more, as the device's manual says: the specification leaves
        their lengths open.
        """
        return (await self.ask(diagnostics.server_id(self.address, highest=self.highest), options))[3:-2]

    async def read_device_information(
        self, read_code: int = ReadCode.BASIC, object_id: int = 0, **options: Unpack[RequestOptions]
    ) -> DeviceInformation:
        """Read the identification, function 43 type 14, with as many requests as it takes.

        Args:
            read_code: 1 the basic objects, 2 the regular ones, 3 all, 4 the one named.
            object_id: where to begin, 0..255.
            options: as for every request; `timeout` is for all of them.
        """
        code = choice("read_code", read_code, ReadCode)
        next_options = self.share_time(options)
        conformity, follows, objects = 0, object_id, dict[int, bytes]()
        while True:
            request = diagnostics.identification(self.address, code, follows, highest=self.highest)
            part = diagnostics.identified(await self.ask(request, next_options()))
            conformity = part.conformity
            objects |= part.objects
            # A device that names no later object would be asked for ever.
            if part.follows is None or part.follows <= follows or code is ReadCode.SPECIFIC:
                return DeviceInformation(conformity, objects)
            follows = part.follows

    # Diagnostics, function 08

    async def diag_query_data(self, msg: bytes, **options: Unpack[RequestOptions]) -> bytes:
        """Have 1..250 bytes sent back, subfunction 0."""
        return await self._diagnose(Diagnostic.QUERY_DATA, options, msg)

    async def diag_restart_communication(self, toggle: bool = False, **options: Unpack[RequestOptions]) -> None:
        """Restart the device's port and clear its counters, subfunction 1; with `toggle` its event log, too.

        It is the only way out of listen-only mode. A device in that mode does it without an answer, which is told as
        `OutcomeUnknown`.
        """
        await self._diagnose(Diagnostic.RESTART_COMMUNICATION, options, 0xFF00 if flag("toggle", toggle) else 0)

    async def diag_read_diagnostic_register(self, **options: Unpack[RequestOptions]) -> int:
        """Read the diagnostic register, subfunction 2."""
        return await self._count(Diagnostic.DIAGNOSTIC_REGISTER, options)

    async def diag_change_ascii_input_delimeter(
        self, delimiter: int = _DELIMITER, **options: Unpack[RequestOptions]
    ) -> None:
        """Set the character (0..255) that ends a message in ASCII mode, subfunction 3."""
        await self._diagnose(Diagnostic.CHANGE_ASCII_DELIMITER, options, diagnostics.ascii_delimiter(delimiter))

    async def diag_force_listen_only(self, **options: Unpack[RequestOptions]) -> None:
        """Make the device listen and answer nothing, this included, subfunction 4. It returns once it is sent."""
        await self._diagnose(Diagnostic.FORCE_LISTEN_ONLY, options)

    async def diag_clear_counters(self, **options: Unpack[RequestOptions]) -> None:
        """Clear the counters and the diagnostic register, subfunction 10."""
        await self._diagnose(Diagnostic.CLEAR_COUNTERS, options)

    async def diag_read_bus_message_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages that the device has seen on the pair, subfunction 11."""
        return await self._count(Diagnostic.BUS_MESSAGE_COUNT, options)

    async def diag_read_bus_comm_error_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the CRC errors that it has seen, subfunction 12."""
        return await self._count(Diagnostic.BUS_COMM_ERROR_COUNT, options)

    async def diag_read_bus_exception_error_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the exceptions that it has answered, subfunction 13."""
        return await self._count(Diagnostic.BUS_EXCEPTION_ERROR_COUNT, options)

    async def diag_read_device_message_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages that were for it, subfunction 14."""
        return await self._count(Diagnostic.DEVICE_MESSAGE_COUNT, options)

    async def diag_read_device_no_response_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages that it has not answered, subfunction 15."""
        return await self._count(Diagnostic.DEVICE_NO_RESPONSE_COUNT, options)

    async def diag_read_device_nak_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages that it has answered by a NAK, subfunction 16."""
        return await self._count(Diagnostic.DEVICE_NAK_COUNT, options)

    async def diag_read_device_busy_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages for which it was busy, subfunction 17."""
        return await self._count(Diagnostic.DEVICE_BUSY_COUNT, options)

    async def diag_read_bus_char_overrun_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the messages that it has lost because characters came too fast, subfunction 18."""
        return await self._count(Diagnostic.BUS_CHAR_OVERRUN_COUNT, options)

    async def diag_read_iop_overrun_count(self, **options: Unpack[RequestOptions]) -> int:
        """Count the overruns of the input/output processor of a Modicon 884, subfunction 19."""
        return await self._count(Diagnostic.IOP_OVERRUN_COUNT, options)

    async def diag_clear_overrun_counter(self, **options: Unpack[RequestOptions]) -> None:
        """Clear the counter of overruns and its flag, subfunction 20."""
        await self._diagnose(Diagnostic.CLEAR_OVERRUN_COUNTER, options)

    async def diag_getclear_modbus_response(self, data: int = 3, **options: Unpack[RequestOptions]) -> bytes:
        """Read (`data` 3) or clear (4) the Modbus Plus statistics of a Modicon controller, subfunction 21."""
        return await self._diagnose(Diagnostic.MODBUS_PLUS, options, data)

    async def diag_get_comm_event_counter(self, **options: Unpack[RequestOptions]) -> EventCounter:
        """Read how many messages the device has completed, function 11."""
        reply = await self.ask(diagnostics.event_counter(self.address, highest=self.highest), options)
        return diagnostics.counted_events(reply)

    async def diag_get_comm_event_log(self, **options: Unpack[RequestOptions]) -> EventLog:
        """Read its counters and its latest 64 events, function 12."""
        reply = await self.ask(diagnostics.event_log(self.address, highest=self.highest), options)
        return diagnostics.logged_events(reply)

    async def _count(self, subfunction: Diagnostic, options: RequestOptions) -> int:
        return int.from_bytes((await self._diagnose(subfunction, options))[:2], "big")

    async def _diagnose(self, subfunction: Diagnostic, options: RequestOptions, data: int | bytes = 0) -> bytes:
        request = diagnostics.diagnostic(self.address, subfunction, data, highest=self.highest)
        reply = await self.ask(request, options)
        return diagnostics.diagnostic_data(reply)
