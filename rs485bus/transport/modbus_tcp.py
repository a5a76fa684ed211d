"""Modbus TCP: to a gateway with its own framing, or to a device that speaks it itself."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from rs485bus.transport.alarm import Alarm, make_alarm
from rs485bus.transport.connection import Connection, connect
from rs485bus.transport.interface import Sink
from rs485bus.wire.mbap import Mbap
from rs485bus.wire.timing import LineSettings


class ModbusTcpTransport:
    """A connection that carries Modbus TCP. What is written and received are RTU frames all the same.

    Args:
        host: its name or address.
        port: its TCP port, usually 502.
        line: how characters travel on the pair behind it.
        native: there is no pair behind it. A device that speaks Modbus TCP itself answers under the number of the
            request that it answers; behind a gateway that number is the gateway's, and the slave may have answered
            an earlier request.
    """

    gateway = True
    numbered = True
    """An answer tells which request it is to."""
    hang_up_hint = (
        "It accepts connections and closes them before it has answered anything. Many gateways serve few clients at a "
        "time: close the others. Otherwise check in its settings that it serves Modbus TCP on this port, and which "
        "addresses it lets in."
    )
    """What to do where the other end closes each connection."""

    def __init__(self, host: str, port: int, line: LineSettings, *, native: bool = False) -> None:
        self.name = f"tcp://{host}:{port}"
        self.line = line
        self.native = native
        self._other_mode = f"socket://{host}:{port}"
        self._host = host
        self._port = port
        self._connection: Connection | None = None
        self._mbap = Mbap()

    @property
    def silent_hint(self) -> str:
        """What to do where it never answers."""
        if self._mbap.answers:
            return ""
        return f"If the gateway is set to raw TCP (RTU over TCP, transparent), open {self._other_mode} instead."

    @property
    def diagnosis(self) -> str:
        """What has come that explains why answers do not; empty if nothing has."""
        if self._mbap.answers_in_rtu:
            return f"{self.name} answers in RTU frames, not in Modbus TCP: open {self._other_mode} instead."
        complaint = self._mbap.complaint
        if not complaint:
            return ""
        return (
            f"{self.name} does not keep to Modbus TCP: {complaint}. Look for new firmware; or set it to RTU over TCP, "
            f"if it has that, and open {self._other_mode} instead."
        )

    async def open(self, sink: Sink) -> None:
        """Connect. Raises `PortError`, which says what to do."""
        self._connection = None
        self._mbap = Mbap(self._mbap)
        unwrapped = _Unwrapped(self._mbap, sink)
        self._connection = await connect(self.name, self._host, self._port, unwrapped, "Modbus TCP")

    def write(self, data: bytes) -> None:
        self.ask(data, None)

    def ask(self, data: bytes, asked: object) -> None:
        """Send the frame of a request. `asked` is the same for all attempts of one request."""
        if self._connection is not None:
            self._connection.write(self._mbap.wrap(data, asked))

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


class _Unwrapped:
    """Tells a sink what comes as RTU frames, and which request each answers."""

    def __init__(self, mbap: Mbap, sink: Sink) -> None:
        self._mbap = mbap
        plain: Callable[[bytes, object], None] = lambda frame, asked: sink.received(frame)  # noqa: E731
        self._answered: Callable[[bytes, object], None] = getattr(sink, "answered", plain)
        self.lost = sink.lost

    def received(self, data: bytes) -> None:
        for frame, asked in self._mbap.unwrap(data):
            self._answered(frame, asked)
