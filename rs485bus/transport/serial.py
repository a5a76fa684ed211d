"""A serial port, on pyserial-asyncio: opened in a worker thread, written directly, closed without draining."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import serial
import serial.rs485
import serial_asyncio

from rs485bus.errors import PortBusy, PortError, PortNotFound, PortPermissionDenied
from rs485bus.transport.adapter import Adapter, adapter_at, find_again, plugged_in
from rs485bus.transport.alarm import Alarm, make_alarm
from rs485bus.transport.holders import holders, others
from rs485bus.transport.interface import Sink, SinkProtocol
from rs485bus.transport.permission import how_to_be_allowed
from rs485bus.transport.worker import in_thread
from rs485bus.wire.timing import LineSettings

try:
    import termios
    from termios import error as _termios_error
except ImportError:  # Windows
    _termios_error = OSError  # type: ignore[misc,assignment]

Direction = bool | serial.rs485.RS485Settings
"""Whether the kernel switches the direction by RTS; as the settings say where there are any."""

_FTDI = 0x0403
_FTDI_LATENCY = 0.016
"""Seconds for which an FTDI adapter holds bytes back as it is shipped."""

_log = logging.getLogger("rs485bus")


class _Port(serial.Serial):
    """pyserial's port, with what would block the event loop taken out."""

    if os.name == "posix":

        def read(self, size: int = 1) -> bytes:
            """What is there. pyserial would ask `select` first, which takes no file descriptor above 1023."""
            try:
                data = os.read(self.fileno(), size)
            except BlockingIOError:
                return b""
            except OSError as error:
                raise serial.SerialException(str(error)) from error
            if not data:
                raise serial.SerialException("the port has gone")
            return data

    def flush(self) -> None:
        """pyserial-asyncio drains here, on the event loop, when it closes. What must go out has gone out by then."""
        try:
            self.reset_output_buffer()
        except (OSError, _termios_error) as error:  # the port has gone
            _log.debug("%s: %s", self.port, error)


class Opener(Protocol):
    """What opens a port: a package for serial ports."""

    async def __call__(
        self,
        find: Callable[[], str],
        opened: Callable[[str], None],
        line: LineSettings,
        direction: Direction,
        protocol: asyncio.Protocol,
    ) -> tuple[asyncio.WriteTransport, int]:
        """Open a port exclusively.

        Args:
            find: returns its path. Blocks.
            opened: to be called with the path when it is open. Blocks.
            line: how characters travel.
            direction: whether and how the kernel switches the direction.
            protocol: is told what comes in.

        Returns:
            A transport, and the file descriptor; -1 where there is none.

        Raises:
            PortError: it says what to do.
        """


class SerialTransport:
    """A serial port.

    Args:
        port: its path or name: "/dev/ttyUSB0", "COM3".
        line: how characters travel.
        rs485_direction: let the kernel switch the direction by RTS (TIOCSRS485); with settings, as they say.
        opener: opens it; pyserial where none is given.
    """

    gateway = False

    def __init__(
        self, port: str, line: LineSettings, *, rs485_direction: Direction = False, opener: Opener | None = None
    ) -> None:
        self.name = port
        self.line = line
        self.receive_latency = 0.0
        """Seconds for which the adapter may hold received bytes back, as far as the system tells."""
        self._path = port
        self._rs485_direction = rs485_direction
        self._opener = opener or _open_with_pyserial
        self._transport: asyncio.WriteTransport | None = None
        self._protocol: SinkProtocol | None = None
        self._fd = -1
        self._adapter: Adapter | None = None
        self._was_open = False

    async def open(self, sink: Sink) -> None:
        """Open the port exclusively; if it was open before, on the same adapter only.

        Raises:
            PortError: it says what to do.
        """
        protocol = self._protocol = SinkProtocol(sink)
        self._transport, self._fd = await self._opener(
            self._find, self._opened, self.line, self._rs485_direction, protocol
        )

    def _find(self) -> str:
        return self.name if self._adapter is None else find_again(self._adapter, self.name)

    def _opened(self, path: str) -> None:
        self._path = path
        if not self._was_open:
            self._adapter, self._was_open = adapter_at(self.name), True
        if path != self.name:
            _log.warning("%s is %s now: it is the same adapter", self.name, path)
        self.receive_latency = _receive_latency(path, self._rs485_direction, self._adapter)

    def readers(self) -> list[str]:
        """Other programs that have the port open, too, such as "cat (process 123)". It takes some time."""
        return others(self._path)

    def write(self, data: bytes) -> None:
        if self._transport is None or self._transport.is_closing():
            return
        if self._fd < 0 or self._transport.get_write_buffer_size():
            self._transport.write(data)
            return
        try:
            sent = os.write(self._fd, data)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            _log.debug("%s: %s", self.name, error)
            self.abort()
            return
        if sent < len(data):
            self._transport.write(data[sent:])

    @property
    def unsent(self) -> int:
        return 0 if self._transport is None else self._transport.get_write_buffer_size()

    def abort(self) -> None:
        if self._transport is not None:
            self._drop_unsent()
            self._transport.abort()

    async def close(self) -> None:
        self._drop_unsent()
        transport, self._transport, self._fd = self._transport, None, -1
        if transport is not None and self._protocol is not None:
            await self._protocol.close(transport)

    def _drop_unsent(self) -> None:
        """Closing would wait until it is sent."""
        if self._fd >= 0 and self._transport is not None and not self._transport.is_closing():
            with contextlib.suppress(OSError, _termios_error):
                termios.tcflush(self._fd, termios.TCOFLUSH)

    def alarm(self, callback: Callable[[], None]) -> Alarm:
        return make_alarm(asyncio.get_running_loop(), callback)


async def _open_with_pyserial(
    find: Callable[[], str],
    opened: Callable[[str], None],
    line: LineSettings,
    direction: Direction,
    protocol: asyncio.Protocol,
) -> tuple[asyncio.WriteTransport, int]:
    """Open a port as `Opener` says. All that may take its time is done in a worker thread."""

    def open_port() -> _Port:
        path = find()
        port = _open(path, line, direction)
        try:
            check_taken(_descriptor(port), path, line)
            opened(path)
        except BaseException:
            port.close()
            raise
        return port

    port = await in_thread(open_port, lambda port: port.close())
    loop = asyncio.get_running_loop()
    try:
        transport, _ = await serial_asyncio.connection_for_serial(loop, lambda: protocol, port)
    except (OSError, ValueError, _termios_error) as error:
        port.close()
        raise explained(str(port.port), line, error) from error
    return transport, _descriptor(port)


def _descriptor(port: _Port) -> int:
    return int(port.fileno()) if os.name == "posix" else -1


def check_taken(fd: int, path: str, line: LineSettings) -> None:
    """Refuse a port whose driver did not take the parity or the stop bits: it may keep that to itself.

    Raises:
        PortError: it did not.
    """
    if fd < 0:
        return
    try:
        flags = termios.tcgetattr(fd)[2]
    except (OSError, _termios_error) as error:
        raise explained(path, line, error) from error
    taken = ("O" if flags & termios.PARODD else "E") if flags & termios.PARENB else "N"
    stopbits = 2 if flags & termios.CSTOPB else 1
    if (taken, stopbits, flags & termios.CSIZE) != (line.parity, line.stopbits, termios.CS8):
        raise explained(path, line, ValueError(f"its driver keeps to 8{taken}{stopbits}"))


def _open(name: str, line: LineSettings, rs485_direction: Direction) -> _Port:
    try:
        port = _Port(
            name,
            baudrate=line.baudrate,
            parity=line.parity,
            stopbits=line.stopbits,
            timeout=0,
            write_timeout=0,
            exclusive=True,
        )
    except (OSError, ValueError, _termios_error) as error:
        raise explained(name, line, error) from error
    try:
        if rs485_direction:
            settings = serial.rs485.RS485Settings() if rs485_direction is True else rs485_direction
            setattr(port, "rs485_mode", settings)  # noqa: B010 - typed as a method
    except (OSError, ValueError, NotImplementedError) as error:
        port.close()
        raise no_direction(name, error) from error
    _hurry(port)
    return port


def _hurry(port: _Port) -> None:
    """Ask the driver not to hold bytes back."""
    try:
        port.set_low_latency_mode(True)
    except (OSError, ValueError, NotImplementedError, AttributeError) as error:
        _log.debug("%s: no low-latency mode: %s", port.port, error)


def _receive_latency(path: str, rs485_direction: Direction, adapter: Adapter | None) -> float:
    """Seconds by which a reply may be seen later than it came; warn where it is many."""
    waits = 0.0 if isinstance(rs485_direction, bool) else rs485_direction.delay_before_tx or 0.0
    timer = _latency_timer(path)
    try:
        latency = int(timer.read_text())
    except (OSError, ValueError):
        is_ftdi = adapter is not None and adapter.vendor == _FTDI and sys.platform != "linux"
        return waits + (_FTDI_LATENCY if is_ftdi else 0.0)
    if latency > 1:
        _log.warning(
            "%s hands received bytes over only every %d ms, which slows every request down. "
            "Mend it with: echo 1 | sudo tee %s",
            path,
            latency,
            timer,
        )
    return waits + latency / 1000


def _latency_timer(port: str) -> Path:
    """Where Linux keeps how many milliseconds an FTDI adapter collects bytes."""
    return Path(f"/sys/bus/usb-serial/devices/{Path(port).resolve().name}/latency_timer")


def no_direction(name: str, error: Exception) -> PortError:
    """What to do where the driver does not switch the direction."""
    return PortError(
        f"{name} cannot switch the direction of RS-485 by itself ({error}). "
        "Leave rs485_direction off for adapters that do it in hardware."
    )


def explained(name: str, line: LineSettings, error: Exception) -> PortError:
    """The same error, with what a person can do about it."""
    number = getattr(error, "errno", None)
    text = str(error)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or "FileNotFoundError" in text:
        return PortNotFound(f"There is no port {name}. {_ports()}")
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text:
        held = ", ".join(f"{program} (process {number})" for number, program in sorted(holders(name).items()))
        return PortBusy(
            f"{name} is in use{held and f' by {held}'}. Close the other program, or share one bus within one program."
        )
    if number in (errno.EACCES, errno.EPERM) or "PermissionError" in text:
        if sys.platform == "win32":
            return PortBusy(f"{name} is in use by another program, or may not be opened. Close the other program.")
        how = how_to_be_allowed(name)
        return PortPermissionDenied(f"You may not open {name}. {how[0].upper()}{how[1:]}")
    if number in (errno.EISDIR, errno.ENOTTY) or "Inappropriate ioctl" in text:
        return PortError(f"{name} could not be opened as a serial port, as it is none. {_ports()}")
    setting = f"{line.baudrate} bit/s, 8{line.parity}{line.stopbits}"
    return PortError(f"{name} could not be opened as a serial port at {setting}: {text}")


def _ports() -> str:
    return f"Ports of this machine: {', '.join(port.device for port in plugged_in()) or 'none'}."
