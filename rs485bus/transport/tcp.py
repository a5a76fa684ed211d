"""RTU over TCP: the frames of the pair, as they are, through a gateway that puts them on it."""

from __future__ import annotations

import asyncio
import socket
import sys
from collections.abc import Callable

from rs485bus.errors import PortError, PortNotFound
from rs485bus.transport.alarm import Alarm, make_alarm
from rs485bus.transport.interface import Sink, SinkProtocol
from rs485bus.wire.timing import LineSettings

CONNECT_TIMEOUT = 5.0
_SIOCOUTQ = 0x5411


class TcpTransport:
    """A connection to a gateway.

    Args:
        host: its name or address.
        port: its TCP port.
        line: how characters travel on the pair behind it.
    """

    gateway = True

    def __init__(self, host: str, port: int, line: LineSettings) -> None:
        self.name = f"socket://{host}:{port}"
        self.line = line
        self._host = host
        self._port = port
        self._transport: asyncio.WriteTransport | None = None
        self._protocol: SinkProtocol | None = None

    async def open(self, sink: Sink) -> None:
        """Connect. Raises `PortError`, which says what to do."""
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT):
                transport, protocol = await loop.create_connection(lambda: SinkProtocol(sink), self._host, self._port)
        except TimeoutError as error:
            raise PortNotFound(
                f"{self.name} did not answer within {CONNECT_TIMEOUT:g} s. Check the gateway's address and power."
            ) from error
        except ConnectionRefusedError as error:
            raise PortNotFound(
                f"{self.name} refused the connection. Check the gateway's port and that it serves raw TCP."
            ) from error
        except OSError as error:
            raise PortError(f"{self.name} could not be reached: {error}") from error
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._transport, self._protocol = transport, protocol

    def write(self, data: bytes) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    @property
    def unsent(self) -> int:
        """Bytes that the gateway has not acknowledged, where the system tells."""
        if self._transport is None or self._transport.is_closing():
            return 0
        waiting = self._transport.get_write_buffer_size()
        return waiting + _unacknowledged(self._transport.get_extra_info("socket"))

    def abort(self) -> None:
        if self._transport is not None:
            self._transport.abort()

    async def close(self) -> None:
        transport, self._transport = self._transport, None
        if transport is not None and self._protocol is not None:
            await self._protocol.close(transport)

    def alarm(self, callback: Callable[[], None]) -> Alarm:
        return make_alarm(asyncio.get_running_loop(), callback)


if sys.platform == "linux":
    import fcntl
    import struct

    def _unacknowledged(sock: socket.socket) -> int:
        try:
            return int(struct.unpack("i", fcntl.ioctl(sock.fileno(), _SIOCOUTQ, b"\0\0\0\0"))[0])
        except OSError:
            return 0

else:

    def _unacknowledged(sock: socket.socket) -> int:
        return 0
