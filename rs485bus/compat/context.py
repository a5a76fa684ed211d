"""`client.ctx` and `client.comm_params`: what pymodbus' clients show of their connection."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.transport import CommParams, CommType

from rs485bus.bus.bus import Bus

_USUAL_RETRIES = 3
"""What pymodbus adds to the retries before it gives a connection up."""


def comm_params(bus: Bus) -> CommParams:
    """A bus as pymodbus describes a connection."""
    line, config = bus.owner.pair.line, bus.config
    return CommParams(
        comm_name="rs485bus",
        comm_type=CommType.SERIAL,
        host=bus.port,
        baudrate=line.baudrate,
        bytesize=8,
        parity=line.parity,
        stopbits=line.stopbits,
        reconnect_delay=config.reopen_min,
        reconnect_delay_max=config.reopen_max,
        timeout_connect=config.reply_timeout,
    )


class BusContext:
    """What drivers ask `client.ctx` for. The bus itself looks after its port, its retries and its transactions.

    Args:
        bus: the bus.
        execute: sends a request.
    """

    is_server = False
    is_closing = False

    def __init__(self, bus: Bus, execute: Callable[[bool, ModbusPDU], Any], *, is_sync: bool = False) -> None:
        self._bus = bus
        self._execute = execute
        self.is_sync = is_sync
        self.is_closed = False
        """The client was closed. The bus is not: it is others' too."""
        self.comm_params = comm_params(bus)
        self.framer = FramerRTU(DecodePDU(False))
        self.retries = bus.config.retries
        self.max_until_disconnect = self.retries + _USUAL_RETRIES
        self.next_tid = 0
        self.unique_id = str(id(self))
        self.trace_packet: Callable[[bool, bytes], bytes] = lambda sending, data: data
        """Told of every frame sent (True) and received. What it returns makes no difference here."""
        self.trace_pdu: Callable[[bool, ModbusPDU], ModbusPDU] = lambda sending, pdu: pdu
        """Told of every PDU sent (True) and received. What it returns makes no difference here."""
        self.reconnect_delay_current = 0.0

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """The event loop that the bus lives in."""
        return self._bus.loop

    def getNextTID(self) -> int:  # noqa: N802 # pymodbus' name
        """0: RTU has no transaction numbers."""
        return self.next_tid

    @property
    def transport(self) -> object | None:
        """Something while there is a connection, None otherwise."""
        return self._bus if self.is_active() else None

    @property
    def count_until_disconnect(self) -> int:
        """It never counts down: a device that does not answer costs the others nothing here."""
        return self.max_until_disconnect

    def is_active(self) -> bool:
        """Whether there is a connection."""
        return self._bus.connected and not self.is_closed

    def open(self) -> bool:
        """Take the client into use again. True where the bus has its port."""
        self.is_closed = False
        return self.is_active()

    async def connect(self) -> bool:
        """The bus is open already."""
        return self.open()

    def close(self, reconnect: bool = False) -> None:
        """The client sends nothing from now on, until it is connected again."""
        self.is_closed = not reconnect

    def reset_delay(self) -> None:
        """Nothing: the bus opens its port anew by itself."""

    def sync_execute(self, no_response_expected: bool, request: ModbusPDU) -> ModbusPDU:
        """Send a request, as a synchronous client does."""
        made: ModbusPDU = self._execute(no_response_expected, request)
        return made

    def execute(self, no_response_expected: bool, request: ModbusPDU) -> Awaitable[ModbusPDU]:
        """Send a request, as the client does."""
        made: Awaitable[ModbusPDU] = self._execute(no_response_expected, request)
        return made
