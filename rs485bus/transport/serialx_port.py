"""Serial ports, and what is reached like one, by the package serialx (an extra)."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Callable
from functools import partial
from typing import Any

from serial.rs485 import RS485Settings

from rs485bus.errors import NotSupported, PortError, PortNotFound
from rs485bus.transport.alarm import Alarm, make_alarm
from rs485bus.transport.connection import set_up, unsent, will_reset
from rs485bus.transport.direction import switch_direction
from rs485bus.transport.interface import Sink, SinkProtocol, Transport
from rs485bus.transport.serial import Direction, SerialTransport, check_taken, explained, no_direction
from rs485bus.transport.worker import in_thread
from rs485bus.wire.timing import LineSettings

CONNECT_TIMEOUT = 10.0
_LOCAL = ("device", "linux", "posix", "extended_posix", "darwin", "freebsd", "windows", "win32")
"""Schemes of ports of this machine. A path without one is the same."""
_KNOWN = (*_LOCAL, "rfc2217", "esphome")
"""Schemes that serialx has where all that it needs is installed."""
_SECRETS = re.compile(r"(?i)\b(key|password|noise_psk)=[^&#]*")


def check_scheme(url: str, ports: str) -> None:
    """Refuse a URL that serialx does not know.

    Args:
        url: what was given for a port.
        ports: what ports there are, for the message.

    Raises:
        ValueError: nobody has such a scheme.
        NotSupported: serialx, or what it needs for this scheme, is not installed.
    """
    scheme = url.partition("://")[0]
    try:
        serialx = _serialx()
    except NotSupported:
        if scheme in _KNOWN:
            raise
        raise ValueError(f"{url!r} is no port; it must be {ports}") from None
    try:
        serialx.get_serial_classes(url)
    except serialx.SerialException as error:
        if scheme == "esphome":
            raise NotSupported(f'{scheme}:// needs another package: pip install "serialx[esphome]"') from error
        raise ValueError(f"{url!r} is no port; it must be {ports}") from error


def transport_at(port: str, line: LineSettings, direction: Direction) -> Callable[[], Transport]:
    """What makes the transport of a path, or of a URL that `check_scheme` has let pass.

    Args:
        port: the path or the URL.
        line: how characters travel.
        direction: whether and how the kernel switches the direction.

    Raises:
        NotSupported: serialx is not installed.
        ValueError: the direction is to be switched on another machine.
    """
    _serialx()
    scheme, separator, path = port.partition("://")
    if not separator or scheme in _LOCAL:
        name = path if separator else port
        return lambda: SerialTransport(name, line, rs485_direction=direction, opener=_open)
    if direction:
        raise ValueError("rs485_direction is for ports of this machine: what is behind a network does it by itself")
    return lambda: NetworkPort(port, line)


def _serialx() -> Any:
    try:
        import serialx
    except ModuleNotFoundError as error:
        raise NotSupported('The package serialx is not installed: pip install "rs485bus[serialx]"') from error
    return serialx


async def _open(
    find: Callable[[], str],
    opened: Callable[[str], None],
    line: LineSettings,
    direction: Direction,
    protocol: asyncio.Protocol,
) -> tuple[asyncio.WriteTransport, int]:
    """Open a port of this machine, as `Opener` says. It is opened exclusively and with low latency by itself."""
    serialx = _serialx()
    path = await in_thread(find, lambda _: None)
    try:
        transport = await _connect(protocol, path, line)
    except (OSError, ValueError, serialx.SerialException) as error:
        # Who holds the port is looked for: that takes its time.
        raise await in_thread(partial(explained, path, line, error), lambda _: None) from error
    fd = int(transport.serial.fileno()) if os.name == "posix" else -1
    try:
        if direction:
            _switch(path, fd, RS485Settings() if direction is True else direction)
        check_taken(fd, path, line)
        await in_thread(lambda: opened(path), lambda _: None)
    except BaseException:
        transport.abort()
        raise
    return transport, fd


def _switch(path: str, fd: int, settings: RS485Settings) -> None:
    try:
        switch_direction(fd, settings)
    except OSError as error:
        raise no_direction(path, error) from error


async def _connect(protocol: asyncio.Protocol, url: str, line: LineSettings, **options: Any) -> Any:
    serialx = _serialx()
    loop = asyncio.get_running_loop()
    transport, _ = await serialx.create_serial_connection(
        loop,
        lambda: protocol,
        url,
        baudrate=line.baudrate,
        parity=serialx.Parity(line.parity),
        stopbits=serialx.StopBits(line.stopbits),
        exclusive=True,
        **options,
    )
    return transport


def _less_demanding(kind: Any) -> Any:
    """serialx' transport for RFC 2217, which waits for an answer to two requests that servers need not answer.

    They subscribe to changes of the modem's lines and of the line's state. ser2net and pyserial's server answer
    neither, so that no connection would ever come about.
    """

    class Rfc2217(kind):  # type: ignore[misc] # serialx is an extra: its types are not known everywhere
        async def _send_and_wait(self, command: Any) -> Any:
            if type(command).__name__ not in ("SetModemstateMaskCmd", "SetLinestateMaskCmd"):
                return await super()._send_and_wait(command)
            self._send_command(command)
            return command

    return Rfc2217


class NetworkPort:
    """A serial port of another machine, by RFC 2217 or an ESPHome proxy.

    The network may hold bytes back: what is true of a gateway is true of it.

    Args:
        url: as serialx takes it.
        line: how characters travel; the other machine is told.
    """

    gateway = True

    def __init__(self, url: str, line: LineSettings) -> None:
        self.name = _SECRETS.sub(r"\1=...", url)
        self.line = line
        self._url = url
        self._transport: Any = None
        self._protocol: SinkProtocol | None = None
        self._tcp: asyncio.Transport | None = None
        """The TCP connection beneath it, where there is one of its own."""

    async def open(self, sink: Sink) -> None:
        """Connect. Raises `PortError`, which says what to do."""
        serialx = _serialx()
        protocol = self._protocol = SinkProtocol(sink)
        self._transport = self._tcp = None
        try:
            options: dict[str, Any] = {"connect_timeout": CONNECT_TIMEOUT}
            if self._url.startswith("rfc2217://"):
                options["transport_cls"] = _less_demanding(serialx.get_serial_classes(self._url)[1])
            self._transport = await _connect(protocol, self._url, self.line, **options)
            self._tcp = getattr(self._transport, "_tcp_transport", None)
            if self._tcp is not None:
                set_up(self._tcp)
        except TimeoutError as error:
            raise PortNotFound(
                f"{self.name} did not answer within {CONNECT_TIMEOUT:g} s. Check its address and power, and that it "
                "speaks this protocol on this port."
            ) from error
        except ConnectionRefusedError as error:
            raise PortNotFound(
                f"{self.name} refused the connection. Check its port and what it serves there."
            ) from error
        except (OSError, ValueError, serialx.SerialException) as error:
            setting = f"{self.line.baudrate} bit/s, 8{self.line.parity}{self.line.stopbits}"
            raise PortError(f"{self.name} could not be opened at {setting}: {error or repr(error)}") from error

    def write(self, data: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    @property
    def unsent(self) -> int:
        if self._tcp is not None:
            return unsent(self._tcp)
        return 0 if self._transport is None else int(self._transport.get_write_buffer_size())

    def abort(self) -> None:
        if self._transport is not None:
            if self._tcp is not None:
                will_reset(self._tcp)
            self._transport.abort()

    async def close(self) -> None:
        if self._tcp is not None and unsent(self._tcp):
            will_reset(self._tcp)
        transport, self._transport, self._tcp = self._transport, None, None
        if transport is not None and self._protocol is not None:
            await self._protocol.close(transport)

    def alarm(self, callback: Callable[[], None]) -> Alarm:
        return make_alarm(asyncio.get_running_loop(), callback)
