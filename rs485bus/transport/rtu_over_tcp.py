"""RTU over TCP: the frames of the pair, as they are, through a gateway that puts them on it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rs485bus.transport.alarm import Alarm, make_alarm
from rs485bus.transport.connection import Connection, connect
from rs485bus.transport.interface import Sink
from rs485bus.wire.mbap import looks_like_mbap
from rs485bus.wire.timing import LineSettings


class TcpTransport:
    """A connection to a gateway.

    Args:
        host: its name or address.
        port: its TCP port.
        line: how characters travel on the pair behind it.
    """

    gateway = True
    hang_up_hint = (
        "It accepts connections and closes them before it has answered anything. Many gateways serve one client at a "
        "time: close the other one. Otherwise check in its settings that it serves raw TCP on this port, and which "
        "addresses it lets in."
    )
    """What to do where the other end closes each connection."""

    def __init__(self, host: str, port: int, line: LineSettings) -> None:
        self.name = f"socket://{host}:{port}"
        self._other_mode = f"tcp://{host}:{port}"
        self.line = line
        self._host = host
        self._port = port
        self._connection: Connection | None = None

    @property
    def silent_hint(self) -> str:
        """What to do where it never answers."""
        return f"If the gateway is set to Modbus TCP, open {self._other_mode} instead."

    @property
    def diagnosis(self) -> str:
        """What has come that explains why answers do not; empty if nothing has."""
        if self._connection is None or not looks_like_mbap(self._connection.latest):
            return ""
        return f"{self.name} answers in Modbus TCP frames, not in RTU: open {self._other_mode} instead."

    async def open(self, sink: Sink) -> None:
        """Connect. Raises `PortError`, which says what to do."""
        self._connection = None
        self._connection = await connect(self.name, self._host, self._port, sink, "raw TCP")

    def write(self, data: bytes) -> None:
        if self._connection is not None:
            self._connection.write(data)

    @property
    def unsent(self) -> int:
        return 0 if self._connection is None else self._connection.unsent

    def abort(self) -> None:
        if self._connection is not None:
            self._connection.abort()

    async def close(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            await connection.aclose()

    def alarm(self, callback: Callable[[], None]) -> Alarm:
        return make_alarm(asyncio.get_running_loop(), callback)
