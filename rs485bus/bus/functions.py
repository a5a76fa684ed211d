"""The public functions of Modbus by pymodbus' method names: coils, inputs, registers, queues, files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, TypedDict, Unpack

from rs485bus.bus.readback import coils_read_back, files_read_back, mask_read_back
from rs485bus.bus.schedule.job import Urgency
from rs485bus.bus.schedule.verification import Verification, holds
from rs485bus.wire import functions
from rs485bus.wire.frames import Request, read_holding, read_input, registers, write_multiple, write_single
from rs485bus.wire.registers import Repeat


class RequestOptions(TypedDict, total=False):
    """What every request may be given, by keyword."""

    urgency: Urgency
    """Its place among the others; COMMAND where it is not given."""
    timeout: float | None
    """Seconds from the call to its end; None for no limit."""
    repeat: Repeat
    """Whether it may be sent again when no reply comes: SAFE for what changes nothing, else NEVER."""
    reply_timeout: float | None
    """Seconds the device may take to begin its answer; None for what the unit or the bus is set to."""
    pause: float | None
    """Seconds of quiet on the pair before it is sent; None for what the unit is set to."""


ReadBack = Callable[[], Verification | None]
"""Makes what tells by a read whether a write was carried out; None where no read can tell."""


class DataFunctions(ABC):
    """What reads and writes a device's data."""

    address: int
    highest: int
    """The highest address that it may have: 247, or 255 where reserved ones were allowed."""

    @abstractmethod
    def ask(
        self, request: Request, options: RequestOptions, read_back: ReadBack | None = None
    ) -> Coroutine[Any, Any, bytes]:
        """Send a request; the coroutine returns the frame that answers it. `read_back` is for what is repeated by
        VERIFY."""

    # Coils and discrete inputs

    async def read_coils(self, address: int, count: int = 1, **options: Unpack[RequestOptions]) -> list[bool]:
        """Read `count` (1..2000) coils from `address` (0..65535) on, function 01."""
        request = functions.read_coils(self.address, address, count, highest=self.highest)
        return functions.bits(await self.ask(request, options), count)

    async def read_discrete_inputs(self, address: int, count: int = 1, **options: Unpack[RequestOptions]) -> list[bool]:
        """Read `count` (1..2000) discrete inputs from `address` (0..65535) on, function 02."""
        request = functions.read_discrete(self.address, address, count, highest=self.highest)
        return functions.bits(await self.ask(request, options), count)

    async def write_coil(self, address: int, value: bool, **options: Unpack[RequestOptions]) -> None:
        """Set or clear the coil at `address`, function 05. `repeat` as for `write_register`."""
        request = functions.write_coil(self.address, address, value, highest=self.highest)
        await self.ask(request, options, lambda: coils_read_back(request, [value]))

    async def write_coils(self, address: int, values: Sequence[bool], **options: Unpack[RequestOptions]) -> None:
        """Set or clear 1..1968 coils from `address` on, function 15. `repeat` as for `write_register`."""
        request = functions.write_coils(self.address, address, values, highest=self.highest)
        await self.ask(request, options, lambda: coils_read_back(request, values))

    # Registers

    async def read_holding_registers(
        self, address: int, count: int = 1, **options: Unpack[RequestOptions]
    ) -> list[int]:
        """Read `count` (1..125) registers from `address` (0..65535) on, function 03."""
        return registers(await self.ask(read_holding(self.address, address, count, self.highest), options))

    async def read_input_registers(self, address: int, count: int = 1, **options: Unpack[RequestOptions]) -> list[int]:
        """Read `count` (1..125) input registers from `address` (0..65535) on, function 04."""
        return registers(await self.ask(read_input(self.address, address, count, self.highest), options))

    async def write_register(self, address: int, value: int, **options: Unpack[RequestOptions]) -> None:
        """Write `value` (0..65535) to the register at `address`, function 06.

        It is sent once, unless `repeat` says otherwise: SAFE repeats it blindly, VERIFY reads the register back first.
        """
        request = write_single(self.address, address, value, highest=self.highest)
        await self.ask(request, options, lambda: holds(self.address, address, [value]))

    async def write_registers(self, address: int, values: Sequence[int], **options: Unpack[RequestOptions]) -> None:
        """Write 1..123 `values` to the registers from `address` on, function 16. `repeat` as for `write_register`."""
        request = write_multiple(self.address, address, values, highest=self.highest)
        await self.ask(request, options, lambda: holds(self.address, address, values))

    async def mask_write_register(
        self, address: int, and_mask: int = 0xFFFF, or_mask: int = 0, **options: Unpack[RequestOptions]
    ) -> None:
        """Set the register at `address` to (its value AND `and_mask`) OR (`or_mask` AND NOT `and_mask`), function 22.

        Doing it twice is doing it once, so `repeat=Repeat.SAFE` harms nobody who does not write the same register.
        """
        request = functions.mask_write(self.address, address, and_mask, or_mask, highest=self.highest)
        await self.ask(request, options, lambda: mask_read_back(request, and_mask, or_mask))

    async def readwrite_registers(
        self,
        read_address: int,
        read_count: int,
        write_address: int,
        values: Sequence[int],
        **options: Unpack[RequestOptions],
    ) -> list[int]:
        """Write 1..121 `values` from `write_address` on, then read `read_count` (1..125) registers, function 23."""
        request = functions.read_write(
            self.address, read_address, read_count, write_address, values, highest=self.highest
        )
        return registers(await self.ask(request, options))

    # Queues and files

    async def read_fifo_queue(self, address: int, **options: Unpack[RequestOptions]) -> list[int]:
        """Read the queue of up to 31 registers whose pointer is at `address`, function 24. It stays as it is."""
        request = functions.read_fifo(self.address, address, highest=self.highest)
        return functions.fifo(await self.ask(request, options))

    async def read_file_record(
        self, records: Sequence[tuple[int, int, int]], **options: Unpack[RequestOptions]
    ) -> list[list[int]]:
        """Read registers of files, function 20: a list for each of `records`.

        Args:
            records: file number (1..65535), first record (0..9999), how many registers; as many as fit a frame.
            options: as for every request.
        """
        request = functions.read_files(self.address, records, highest=self.highest)
        return functions.file_records(await self.ask(request, options))

    async def write_file_record(
        self, records: Sequence[tuple[int, int, Sequence[int]]], **options: Unpack[RequestOptions]
    ) -> None:
        """Write registers of files, function 21. `repeat` as for `write_register`.

        Args:
            records: file number (1..65535), first record (0..9999), the values; as many as fit a frame.
            options: as for every request.
        """
        request = functions.write_files(self.address, records, highest=self.highest)
        await self.ask(request, options, lambda: files_read_back(request, records))
