"""One TCP connection to a gateway, of which nothing arrives after it was given up."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import struct
import sys

from rs485bus.errors import PortError, PortNotFound
from rs485bus.transport.interface import Sink, SinkProtocol

CONNECT_TIMEOUT = 5.0
_UNACKNOWLEDGED = 1.0
"""Seconds after which the system gives a connection up whose other end does not acknowledge what is sent."""
_OPTIONS = {
    "TCP_NODELAY": 1,
    # A gateway that was switched off is noticed while nothing is asked, too.
    "TCP_KEEPIDLE": 5,
    "TCP_KEEPINTVL": 2,
    "TCP_KEEPCNT": 3,
    "TCP_USER_TIMEOUT": round(1000 * _UNACKNOWLEDGED),
}
_NO_LINGER = struct.pack("hh" if sys.platform == "win32" else "ii", 1, 0)


class Connection(SinkProtocol):
    """Made by `connect`. It ends by a reset where something is unsent: the system would go on sending it."""

    transport: asyncio.Transport
    latest = b""
    """The bytes that came last."""

    def data_received(self, data: bytes) -> None:
        self.latest = data
        self._sink.received(data)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport
        set_up(transport)

    def eof_received(self) -> None:
        """The other end has closed. asyncio would wait until everything is sent, which may be never."""
        self._drop_unsent()
        self.transport.abort()

    def write(self, data: bytes) -> None:
        """Send at once; nothing where the connection has ended."""
        if not self.transport.is_closing():
            self.transport.write(data)

    @property
    def unsent(self) -> int:
        """Bytes that have not left this machine, or that the other one does not acknowledge, where the system tells."""
        return unsent(self.transport)

    def abort(self) -> None:
        """Reset it now; the sink is told."""
        will_reset(self.transport)
        self.transport.abort()

    async def aclose(self) -> None:
        """End it now; the sink is not told."""
        self._drop_unsent()
        await self.close(self.transport)

    def _drop_unsent(self) -> None:
        if self.unsent:
            will_reset(self.transport)


def set_up(transport: asyncio.BaseTransport) -> None:
    """Have a TCP connection send at once, and notice that the other end is gone."""
    sock = transport.get_extra_info("socket")
    with contextlib.suppress(OSError):  # one that is lost already is told so elsewhere
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in _OPTIONS.items():
            if hasattr(socket, name):
                sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def unsent(transport: asyncio.WriteTransport) -> int:
    """Bytes that have not left this machine, or that the other one does not acknowledge, where the system tells."""
    if transport.is_closing():
        return 0
    return transport.get_write_buffer_size() + _stuck(transport.get_extra_info("socket"))


def will_reset(transport: asyncio.BaseTransport) -> None:
    """Have a TCP connection end by a reset: what the system still holds is dropped then."""
    with contextlib.suppress(OSError):
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _NO_LINGER)


async def connect(name: str, host: str, port: int, sink: Sink, what: str) -> Connection:
    """Connect to a gateway.

    Args:
        name: what people call it.
        host: its name or address.
        port: its TCP port.
        sink: who is told what it sends.
        what: what it should serve there, for the message.

    Raises:
        PortError: it cannot be reached; the message says what to do.
    """
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(CONNECT_TIMEOUT):
            return (await loop.create_connection(lambda: Connection(sink), host, port))[1]
    except TimeoutError as error:
        raise PortNotFound(
            f"{name} did not answer within {CONNECT_TIMEOUT:g} s. Check the gateway's address and power."
        ) from error
    except ConnectionRefusedError as error:
        raise PortNotFound(
            f"{name} refused the connection. Check the gateway's port and that it serves {what}."
        ) from error
    except OSError as error:
        raise PortError(f"{name} could not be reached: {error}") from error


if sys.platform == "linux":
    import fcntl

    _SIOCOUTQ = 0x5411
    _SIOCOUTQNSD = 0x894B
    _RETRANSMITS, _PROBES = 2, 3

    def _stuck(sock: socket.socket) -> int:
        """Bytes in the system's buffer that cannot be sent, or were sent again because nobody acknowledged them.

        What is merely under way does not count: an acknowledgement may take 40 ms where no answer carries it.
        """
        try:
            if waiting := _queued(sock, _SIOCOUTQNSD):
                return waiting
            info = sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 8)
            return _queued(sock, _SIOCOUTQ) if info[_RETRANSMITS] or info[_PROBES] else 0
        except OSError:
            return 0

    def _queued(sock: socket.socket, which: int) -> int:
        return int(struct.unpack("i", fcntl.ioctl(sock.fileno(), which, bytes(4)))[0])

else:

    def _stuck(sock: socket.socket) -> int:
        return 0
