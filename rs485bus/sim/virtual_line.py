"""The virtual pair under an event loop: as a transport for `open_bus`, and on a pseudo-terminal for anybody."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Literal

from rs485bus.errors import PortNotFound
from rs485bus.sim.clock import VirtualClockLoop
from rs485bus.sim.device import SimDevice
from rs485bus.sim.line import VirtualPair
from rs485bus.sim.noise import Noise
from rs485bus.transport.alarm import Alarm, make_alarm
from rs485bus.transport.interface import Sink
from rs485bus.wire.timing import LineSettings, Parity

_QUIET = Noise()
_TCGETS2, _TERMIOS2 = 0x802C542A, 44
"""Linux: the request for a terminal's settings with their rates as numbers, and the size of the answer."""


class VirtualLine:
    """A virtual RS-485 line: a transport with the timing of a real pair.

    Args:
        devices: what hangs on it.
        baudrate: bit/s.
        parity: "N", "E" or "O".
        stopbits: 1 or 2.
        noise: what goes wrong.
        seed: makes the noise reproducible.
        turnaround: seconds the devices take before they answer, where they have no time of their own.
    """

    name = "virtual line"
    gateway = False

    def __init__(
        self,
        *devices: SimDevice,
        baudrate: int = 115200,
        parity: Parity = "N",
        stopbits: Literal[1, 2] = 1,
        noise: Noise = _QUIET,
        seed: int = 0,
        turnaround: float = 0.002,
    ) -> None:
        self.line = LineSettings(baudrate=baudrate, parity=parity, stopbits=stopbits)
        self.pair = VirtualPair(devices, self.line, noise, seed, turnaround)
        self.plugged = True
        self._sink: Sink | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._alarm: Alarm | None = None

    @property
    def unsent(self) -> int:
        """Bytes that wait to be sent: none ever."""
        return 0

    async def open(self, sink: Sink) -> None:
        if not self.plugged:
            raise PortNotFound("The virtual line is unplugged.")
        self._run()
        self._sink = sink

    def write(self, data: bytes) -> None:
        """The bus sends bytes."""
        if self._sink is not None and self._loop is not None:
            self.transmit(data, self._loop.time())

    def abort(self) -> None:
        """The port is lost; the bus is told."""
        sink, self._sink = self._sink, None
        if sink is not None and self._loop is not None:
            self._loop.call_soon(sink.lost, None)

    async def close(self) -> None:
        """The bus hears nothing any more."""
        self._sink = None

    def alarm(self, callback: Callable[[], None]) -> Alarm:
        """A timer that calls back on the event loop's clock."""
        return make_alarm(asyncio.get_running_loop(), callback)

    def unplug(self) -> None:
        """Pull the adapter out: the port is lost, and cannot be opened until `plug`."""
        self.plugged = False
        self.abort()

    def plug(self) -> None:
        """Put it in again."""
        self.plugged = True

    def babble(self, intervals: Iterator[float]) -> None:
        """From now on there are bytes that nobody sends, one after each of those intervals (`VirtualPair.babble`)."""
        self._run()
        assert self._loop is not None
        self.pair.babble(intervals, self._loop.time())
        self._pump()

    async def serve_pty(self, link: str | Path | None = None) -> VirtualPort:
        """Put the line on a pseudo-terminal, in real time, so that any Modbus master can be tried on it (not Windows).

        There, frames that start too early are counted but understood: what comes through a pseudo-terminal is late by
        what the system makes it. The master speaks at the rate to which it sets the pseudo-terminal. A drive hears it
        at its own rate only; one without a rate of its own gets that of the line, here.

        Args:
            link: a symbolic link to make to it, for a path that stays the same.
        """
        self._run()
        self.pair.lenient = True
        for device in self.pair.devices:
            device.baudrate = device.baudrate or self.line.baudrate
        return VirtualPort(self, link)

    async def serve_tap(self, link: str | Path | None = None) -> VirtualPort:
        """Another pseudo-terminal, on which a program can listen to all that is on the pair, and send nothing.

        Args:
            link: as for `serve_pty`.
        """
        self._run()
        return VirtualPort(self, link, listens_only=True)

    def listen(self, ear: Callable[[bytes, float], None]) -> Callable[[], None]:
        """Have `ear` called with all bytes on the pair, a few at a time, whoever sent them, and with the time.

        Returns:
            A function that ends that.
        """
        self.pair.ears.append(ear)
        return lambda: self.pair.ears.remove(ear)

    def hear(self, sink: Sink | None) -> None:
        """Hand what the master receives to a sink."""
        self._sink = sink

    def transmit(self, data: bytes, now: float) -> None:
        """The master sends."""
        self.pair.transmit(data, now)
        self._pump()

    def speak(self, baudrate: int) -> None:
        """The master speaks and listens at this rate from now on."""
        if baudrate != self.line.baudrate:
            self.line = replace(self.line, baudrate=baudrate)
            self.pair.speak(self.line)

    def _run(self) -> None:
        loop = asyncio.get_running_loop()
        if self._loop is not loop:
            if self._loop is not None and isinstance(loop, VirtualClockLoop):
                # The drives have lived on in the loop before: they would not understand a clock that goes back.
                loop.block(max(0.0, self._loop.time() - loop.time()))
            self._loop = loop
            self._alarm = make_alarm(loop, self._pump)

    def _pump(self) -> None:
        assert self._loop is not None
        assert self._alarm is not None
        for piece in self.pair.advance(self._loop.time()):
            if self._sink is not None:
                self._sink.received(piece)
        self._alarm.set(self.pair.next_at)


class VirtualPort:
    """A virtual line on a pseudo-terminal; an async context manager."""

    def __init__(self, line: VirtualLine, link: str | Path | None, *, listens_only: bool = False) -> None:
        import pty
        import tty

        self._link = None if link is None else Path(link)
        if self._link is not None and self._link.exists() and not self._link.is_symlink():
            raise ValueError(f"{self._link} is there, and is no symbolic link: name another place for the link")
        if self._link is not None and not self._link.parent.is_dir():
            raise ValueError(f"there is no folder {self._link.parent} for the link")
        self._line = line
        self._loop = asyncio.get_running_loop()
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        """What to open."""
        if self._link is not None:
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(self.path)
        self._loop.add_reader(self._master, self._read)
        self._listens_only = listens_only
        self._deafen = line.listen(lambda data, _: self.received(data)) if listens_only else lambda: line.hear(None)
        if not listens_only:
            line.hear(self)

    def received(self, data: bytes) -> None:
        with contextlib.suppress(OSError):  # nobody reads the other side
            os.write(self._master, data)

    def lost(self, error: Exception | None) -> None:
        """A pseudo-terminal is not lost."""

    async def aclose(self) -> None:
        """Take it away: whoever has it open loses the port."""
        if self._master >= 0:
            self._deafen()
            self._loop.remove_reader(self._master)
            os.close(self._master)
            os.close(self._slave)
            self._master = -1
            if self._link is not None and self._link.is_symlink() and os.readlink(self._link) == self.path:
                self._link.unlink()  # nobody else's: another simulation may have made it anew

    async def __aenter__(self) -> VirtualPort:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    def _read(self) -> None:
        data = os.read(self._master, 4096)
        if not self._listens_only:
            self._line.speak(_rate_of(self._slave))
            self._line.transmit(data, self._loop.time())


def _rate_of(terminal: int) -> int:
    """The baud rate that a pseudo-terminal is set to, also where it is none of the usual ones."""
    import fcntl
    import termios

    if os.uname().sysname == "Linux":
        settings = fcntl.ioctl(terminal, _TCGETS2, bytes(_TERMIOS2))
        return int.from_bytes(settings[-4:], sys.byteorder)
    return int(termios.tcgetattr(terminal)[5])  # there, the constants are the rates
