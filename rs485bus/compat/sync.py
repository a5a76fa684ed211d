"""A synchronous pymodbus client over a shared bus that runs in another thread.

A driver written for `ModbusSerialClient` blocks its own thread, never the bus:

    from anyio.from_thread import start_blocking_portal

    with start_blocking_portal() as portal:
        with portal.wrap_async_context_manager(open_bus("/dev/ttyUSB0", baudrate=38400)) as bus:
            meter = Driver(SyncBusClient(bus))    # was: ModbusSerialClient("/dev/ttyUSB0", baudrate=38400)

Inside an asynchronous application, call such a driver by `await anyio.to_thread.run_sync(driver.poll)`.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import threading
import time
from types import TracebackType

from pymodbus.client.mixin import ModbusClientMixin
from pymodbus.exceptions import ConnectionException
from pymodbus.framer import FramerRTU
from pymodbus.pdu import ModbusPDU

from rs485bus.bus.bus import Bus
from rs485bus.compat.context import BusContext
from rs485bus.compat.exchange import exchange
from rs485bus.compat.older import takes_older_calls
from rs485bus.errors import WrongThread

_LOOKS = 0.5
"""Seconds after which it is looked whether the event loop of the bus still runs."""


@takes_older_calls
class SyncBusClient(ModbusClientMixin[ModbusPDU]):
    """pymodbus' synchronous client methods, sent over a bus. Any number of threads may use it.

    As `BusClient` otherwise.

    Args:
        bus: an open bus, whose event loop runs in another thread than those that call.
        reply_timeout: seconds a device may take to begin its answer; None for what its unit or the bus is set to.
        allow_reserved_address: devices may have an address in 248..255, which the specification reserves.
    """

    def __init__(self, bus: Bus, *, reply_timeout: float | None = None, allow_reserved_address: bool = False) -> None:
        super().__init__()  # type: ignore[no-untyped-call] # pymodbus leaves it untyped
        self._bus = bus
        self._reply_timeout = reply_timeout
        self._allow_reserved_address = allow_reserved_address
        self.ctx = self.transaction = BusContext(bus, self.execute, is_sync=True)
        self.comm_params = self.ctx.comm_params
        self.retries = self.ctx.retries
        self.use_udp = False
        self.inter_byte_timeout = bus.owner.pair.line.t15
        self.silent_interval = bus.owner.pair.silence
        self.reconnect_delay_current = 0.0
        self.last_frame_end: float | None = 0.0
        """When the latest request was answered, in seconds of `time.time()`."""

    def __str__(self) -> str:
        return f"{type(self).__name__} {self.comm_params.host}"

    @property
    def framer(self) -> FramerRTU:
        """What knows the classes of the replies."""
        return self.ctx.framer

    @property
    def connected(self) -> bool:
        """Whether the bus has its port, and the client was not closed."""
        return self.ctx.is_active()

    @property
    def socket(self) -> object | None:
        """Something while there is a connection, None otherwise."""
        return self.ctx.transport

    def is_socket_open(self) -> bool:
        """Whether there is a connection."""
        return self.connected

    def connect(self) -> bool:
        """The bus is open already. True where it has its port."""
        return self.ctx.open()

    def close(self) -> None:
        """Nothing but to be remembered until the next request. The bus stays open: it is others' too."""
        self.ctx.close()

    def __enter__(self) -> SyncBusClient:
        self.connect()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def send(self, request: bytes, addr: tuple[object, ...] | None = None) -> int:
        """Refused: bytes past the queue would fall into others' transactions. `execute()` sends any request."""
        raise NotImplementedError("send() would fall into others' transactions on the bus: execute() sends any request")

    def recv(self, size: int | None) -> bytes:
        """Refused: what comes in belongs to whoever asked."""
        raise NotImplementedError("recv() would take others' answers: execute() returns the answer to its request")

    def idle_time(self) -> float:
        """Seconds since the latest request was answered."""
        return time.time() - self.last_frame_end if self.last_frame_end else 0.0

    def register(self, custom_response_class: type[ModbusPDU]) -> None:
        """Know the replies of a function that pymodbus does not: their class, as pymodbus' page on it makes one."""
        self.ctx.framer.decoder.register(custom_response_class)

    def set_max_no_responses(self, max_count: int) -> None:
        """Nothing but to be remembered: the bus never gives its port up because a device does not answer."""
        self.ctx.max_until_disconnect = max_count

    def execute(self, no_response_expected: bool | ModbusPDU, request: ModbusPDU | None = None) -> ModbusPDU:
        """Send any request, and wait for its answer. With `no_response_expected` nobody is told whether there was one.

        Raises:
            ModbusException: as pymodbus raises it.
            WrongThread: it was called in the event loop of the bus itself, which it would stop.
        """
        if isinstance(no_response_expected, ModbusPDU):  # as before pymodbus 3.8
            request, no_response_expected = no_response_expected, False
        assert request is not None
        loop = self._bus.loop
        if threading.get_ident() == self._bus.thread:
            raise WrongThread(
                "SyncBusClient was called in the thread of the bus, which it would stop. Use BusClient there, or call "
                "what needs it by: await anyio.to_thread.run_sync(driver.poll)"
            )
        self.connect()  # as pymodbus' synchronous clients do
        asked = exchange(
            self._bus,
            self.ctx,
            request,
            no_response_expected=no_response_expected,
            allow_reserved_address=self._allow_reserved_address,
            reply_timeout=self._reply_timeout,
        )
        if not loop.is_running():
            asked.close()
            raise ConnectionException("The event loop of the bus does not run, so that nothing can be asked")
        reply = _await(asyncio.run_coroutine_threadsafe(asked, loop), loop)
        self.last_frame_end = time.time()
        return reply


def _await(future: concurrent.futures.Future[ModbusPDU], loop: asyncio.AbstractEventLoop) -> ModbusPDU:
    """The result of a future in another thread. Whoever is interrupted while he waits asks for it no more."""
    try:
        while True:
            try:
                return future.result(_LOOKS)
            except concurrent.futures.TimeoutError:
                if future.done():
                    raise
                if not loop.is_running():
                    raise ConnectionException("The event loop of the bus has ended, and the request with it") from None
            except concurrent.futures.CancelledError:
                raise ConnectionException("The event loop of the bus has ended, and the request with it") from None
    except BaseException:
        future.cancel()
        raise
