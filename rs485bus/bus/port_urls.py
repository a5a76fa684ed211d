"""What a port's name means: a serial port, a gateway, or a URL of serialx."""

from __future__ import annotations

import ipaddress
import os
import re
import sys
from collections.abc import Callable
from typing import Literal
from urllib.parse import urlsplit

from rs485bus.bus.config import BusConfig
from rs485bus.transport import serialx_port
from rs485bus.transport.interface import Transport
from rs485bus.transport.modbus_tcp import ModbusTcpTransport
from rs485bus.transport.rtu_over_tcp import TcpTransport
from rs485bus.transport.serial import SerialTransport
from rs485bus.wire.timing import LineSettings, Parity

Backend = Literal["pyserial", "serialx"]

_SLOWEST_USUAL = 9600
"""What a gateway's pair is taken for, in bit/s, where nobody says: replies are waited for longer then, not shorter."""
_NO_PAIR = 4_000_000
"""What a device is taken for that speaks Modbus TCP itself."""
PORTS = (
    "a serial port ('/dev/ttyUSB0', 'COM3'), a gateway that speaks RTU over TCP ('socket://host:4196') or Modbus TCP "
    "('tcp://host:502'), or a URL of serialx ('rfc2217://host:port', 'esphome://host:6053/?port_name=...')"
)
_HOST_AND_PORT = re.compile(r"(\[[0-9a-fA-F:]+\]|[\w.-]+):(\d{1,5})")

_HOST = re.compile(r"[A-Za-z0-9][\w-]*(\.[\w-]+)*")
_SERIAL = re.compile(r"(?i)com\d+$|tty|cu\.")


def transport_at(
    port: str,
    *,
    baudrate: int | None,
    parity: Parity,
    stopbits: Literal[1, 2],
    backend: Backend | None,
    native: bool,
    config: BusConfig,
) -> Callable[[], Transport]:
    """What makes the transport of a port. Arguments as for `open_bus`.

    Raises:
        ValueError: it cannot be one, or a setting does not suit it.
    """
    scheme, separator, _ = port.partition("://")
    if not port.strip():
        raise ValueError(f"{port!r} is no port; it must be {PORTS}")
    is_tcp = bool(separator) and scheme in ("socket", "tcp")
    if native and not (is_tcp and scheme == "tcp"):
        raise ValueError(
            f"native=True is for a device that speaks Modbus TCP itself (tcp://host:502), not for {port!r}"
        )
    if is_tcp and backend is not None:
        raise ValueError(f"backend is for serial ports; {port!r} is reached without one")
    if not separator:
        _check_no_host(port)
    elif not is_tcp:
        serialx_port.check_scheme(port, PORTS)
    usual = None if not is_tcp else _NO_PAIR if native else _SLOWEST_USUAL
    rate = usual if baudrate is None else baudrate
    if rate is None:
        raise ValueError(
            f"Say the baud rate of {port}: MKS drives are shipped at 38400 bit/s, ZLAC and TL-R at 115200. "
            "A wrong one fails silently."
        )
    line = LineSettings(baudrate=rate, parity=parity, stopbits=stopbits)
    config.silence_on(line, gateway=is_tcp)
    if is_tcp:
        host, number = _gateway(port, 502 if scheme == "tcp" else None)
        if scheme == "tcp":
            return lambda: ModbusTcpTransport(host, number, line, native=native)
        return lambda: TcpTransport(host, number, line)
    if separator or backend == "serialx":
        return serialx_port.transport_at(port, line, config.rs485_direction)
    return lambda: SerialTransport(port, line, rs485_direction=config.rs485_direction)


def _gateway(url: str, usual: int | None) -> tuple[str, int]:
    """The host and the port of a gateway."""
    parts = urlsplit(url)
    try:
        host, number = parts.hostname, parts.port or usual
    except ValueError:  # no port has that number
        host = number = None
    if not host or not number or parts.path.strip("/") or parts.query:
        likeness = "tcp://192.168.1.10:502" if usual else "socket://192.168.1.10:4196"
        raise ValueError(f"{url!r} names no host and port; it should look like {likeness}")
    return host, number


def _check_no_host(port: str) -> None:
    """Refuse a host without a scheme, with those that there are."""
    if os.path.exists(port) or (sys.platform == "win32" and ":" not in port and "." not in port):
        return
    match = _HOST_AND_PORT.fullmatch(port)
    host, number = (match[1], match[2]) if match else (port, "")
    if match or _is_host(port):
        raise ValueError(
            f"{port!r} does not say how it speaks. If it is a gateway: socket://{host}:{number or 4196} where it is "
            f"set to RTU over TCP (raw, transparent), tcp://{host}:{number or 502} where it is set to Modbus TCP, "
            f"rfc2217://{host}:{number or 4196} where it is set to RFC 2217 (with serialx). If it is a serial port, "
            "give its whole path: '/dev/ttyUSB0', 'COM3'."
        )


def _is_host(name: str) -> bool:
    """Whether a name is an address, or a host's rather than a path."""
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return _HOST.fullmatch(name) is not None and not _SERIAL.match(name)
    return True
