"""Opening a bus: by a port's name, by a gateway's address, or on a transport."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator
from types import TracebackType
from typing import Any, Literal

from rs485bus.arguments import flag, instance
from rs485bus.bus.async_block import AsyncBlock
from rs485bus.bus.bus import Bus
from rs485bus.bus.config import BusConfig
from rs485bus.bus.port_urls import PORTS, Backend, transport_at
from rs485bus.bus.stopping.halt import Halted
from rs485bus.errors import StopUnconfirmed
from rs485bus.transport.interface import Transport
from rs485bus.wire.timing import Parity

_DEFAULT = BusConfig()


def open_bus(
    port: str | os.PathLike[str] | Transport,
    *,
    baudrate: int | None = None,
    parity: Parity = "N",
    stopbits: Literal[1, 2] = 1,
    backend: Backend | None = None,
    native: bool = False,
    config: BusConfig = _DEFAULT,
) -> Opening:
    """Open the bus on a port.

    `async with open_bus(...) as bus` closes it at the end: a block that ends well waits for queued moves first, one
    left by an exception stops every axis that may move. `bus = await open_bus(...)` leaves that to `bus.aclose()`.

    Args:
        port: a serial port ("/dev/ttyUSB0", "COM3"), a gateway that speaks RTU over TCP ("socket://host:4196") or
            Modbus TCP ("tcp://host:502"), a URL of serialx ("rfc2217://host:port"), or a transport, as
            `rs485bus.sim.VirtualLine` is one.
        baudrate: bit/s. A serial port needs it said: MKS drives are shipped at 38400, ZLAC and TL-R at 115200. Behind
            a gateway it is only used to know how long bytes take.
        parity: "N", "E" or "O".
        stopbits: 1 or 2.
        backend: the package that opens a serial port: "pyserial", or "serialx" (an extra).
        native: what is at "tcp://..." is the device itself, not a gateway with a pair behind it. Then nothing waits
            for late replies: they bear the number of their request.
        config: how the bus behaves.

    Raises:
        ValueError: a setting out of range, a port that cannot be one, or a serial port without a baud rate.
        NotSupported: serialx is asked for and not installed.
        TypeError: an argument of a wrong type.
        PortError: when it is entered or awaited; the message says what to do.
    """
    instance("config", config, BusConfig, "BusConfig(reply_timeout=0.2)")
    if isinstance(port, os.PathLike):
        port = os.fspath(port)
    if not isinstance(port, str):
        if not hasattr(port, "alarm"):
            raise TypeError(f"port must be {PORTS}, or a transport, not {port!r}")
        return Opening(lambda: port, config)
    if backend not in (None, "pyserial", "serialx"):
        raise ValueError(f"backend {backend!r} is neither 'pyserial' nor 'serialx'")
    flag("native", native)
    make = transport_at(
        port, baudrate=baudrate, parity=parity, stopbits=stopbits, backend=backend, native=native, config=config
    )
    return Opening(make, config)


class Opening(AsyncBlock):
    """What `open_bus` returns: an async context manager, or to be awaited for a bus to be closed with `aclose()`."""

    def __init__(self, make: Callable[[], Transport], config: BusConfig) -> None:
        self._make = make
        self._config = config
        self._bus: Bus | None = None

    def __repr__(self) -> str:
        return "<open_bus(...) that nobody awaited>" if self._bus is None else repr(self._bus)

    async def _open(self) -> Bus:
        bus = Bus(self._make(), self._config)
        await bus.open()
        return bus

    def __await__(self) -> Generator[Any, None, Bus]:
        return self._open().__await__()

    async def __aenter__(self) -> Bus:
        self._bus = await self._open()
        return self._bus

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        bus = self._bus
        assert bus is not None
        if error is None:
            try:
                await bus.drain()
            finally:
                await bus.aclose()
            failures = [*bus.failures(), *(_unconfirmed(halted) for halted in bus.stopped if not halted.standing)]
            if failures:
                raise ExceptionGroup("commands failed that nobody awaited", failures)
            return False
        try:
            await bus.aclose()
        finally:
            for failure in bus.failures():
                if failure is not error:
                    error.add_note(f"Nobody awaited a command that failed: {failure!r}")
            for halted in bus.stopped:
                if not halted.standing:
                    error.add_note(str(_unconfirmed(halted)))
        return False


def _unconfirmed(halted: Halted) -> StopUnconfirmed:
    return StopUnconfirmed(
        f"{halted.family} {halted.address} could not be seen standing when the bus was closed. Look at the machine; "
        "use the hard-wired emergency stop."
    )
