"""The bus of the blocking face."""

from __future__ import annotations

import os
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, Never

from rs485bus.blocking.display import show_figures, table
from rs485bus.blocking.interrupts import blocks, calls, interrupts
from rs485bus.blocking.mirror import Face, face_class, register
from rs485bus.blocking.opened import OpenedBus
from rs485bus.bus.bus import Bus as AsyncBus
from rs485bus.bus.config import BusConfig
from rs485bus.bus.opening import open_bus as open_async_bus
from rs485bus.bus.port_urls import Backend
from rs485bus.errors import BusError
from rs485bus.transport.interface import Transport
from rs485bus.wire.timing import Parity

_DEFAULT = BusConfig()

if TYPE_CHECKING:
    _BusFace = Face
else:
    _BusFace = face_class(AsyncBus)


def open_bus(
    port: str | os.PathLike[str] | Transport,
    *,
    baudrate: int | None = None,
    parity: Parity = "N",
    stopbits: Literal[1, 2] = 1,
    backend: Backend | None = None,
    native: bool = False,
    config: BusConfig = _DEFAULT,
) -> Bus:
    """Open the bus on a port, now.

    `with open_bus(...) as bus:` closes it at the end: a block that ends well waits for queued moves first, one left by
    an exception stops every axis that may move. Without a block `bus.close()` does, and the end of the program.

    Arguments and errors are those of `rs485bus.open_bus`.
    """
    opening = open_async_bus(
        port, baudrate=baudrate, parity=parity, stopbits=stopbits, backend=backend, native=native, config=config
    )
    calls.depth += 1
    try:
        bus = Bus._on(OpenedBus(opening))
    finally:
        calls.depth -= 1
        if calls.pressed and not calls.depth:
            interrupts.take_effect()
    return bus


class Bus(_BusFace):
    """One RS-485 pair, for programs without `async`. Made by `open_bus`.

    Any thread may call it. Ctrl-C stops its axes before it is raised in the main thread.
    """

    _opened: OpenedBus

    def __init__(self) -> None:
        raise TypeError("A bus is opened: rs485bus.blocking.open_bus(port, baudrate=...)")

    @classmethod
    def _on(cls, opened: OpenedBus) -> Bus:
        bus = cls.__new__(cls)
        bus._opened = opened
        bus._adopt(opened.bus, opened.loop, None)
        opened.held_by(bus)
        return bus

    def mks(self, address: int, **settings: Any) -> Any:
        """The MKS SERVO drive at an address, 1..247. Settings and errors are those of `MksServo`.

        Asked for again, with the same settings or without, it is the same one: a notebook's cell can be run twice.
        """
        from rs485bus.devices.mks import MksServo

        return self._axis(MksServo, address, settings)

    def tlr(self, address: int, **settings: Any) -> Any:
        """The TL-R stepper at a station, 1..247. Settings and errors are those of `TlrStepper`. As `mks` otherwise."""
        from rs485bus.devices.tlr import TlrStepper

        return self._axis(TlrStepper, address, settings)

    def zlac(self, address: int, **settings: Any) -> Any:
        """The ZLAC8015D at an address, 1..127, with its two wheels `left` and `right`. Settings and errors are those of
        `Zlac8015d`. As `mks` otherwise."""
        from rs485bus.devices.zlac import Zlac8015d

        return self._axis(Zlac8015d, address, settings)

    def group(self, *unnamed: Never, **axes: Face) -> Any:
        """Axes that move together, each by a name of its own. Errors are those of `AxisGroup`."""
        from rs485bus.motion.group.axis_group import AxisGroup

        return face_class(AxisGroup)(*unnamed, **axes)

    def vehicle(self, zlac: Face, wheel_radius: float, track: float, **settings: Any) -> Any:
        """A vehicle on the two wheels of a ZLAC8015D. Arguments and errors are those of `DifferentialDrive`."""
        from rs485bus.devices.zlac import DifferentialDrive

        return face_class(DifferentialDrive)(zlac, wheel_radius, track, **settings)

    def timeline(self) -> Any:
        """A picture of the latest 256 transactions, as a matplotlib figure: who was asked when, latency, load, axes.

        Raises:
            ValueError: nothing happened yet.
            ModuleNotFoundError: matplotlib is missing: pip install "rs485bus[plot]".
        """
        from rs485bus.capture.reading import capture_of

        try:
            from rs485bus.capture.figures import timeline
        except ModuleNotFoundError as missing:
            missing.add_note('a timeline needs matplotlib: pip install "rs485bus[plot]"')
            raise
        figure = timeline(self._loop.call(capture_of, self._inner))
        show_figures()
        return figure

    def close(self, *, leave_running: bool | None = None) -> None:
        """Stop every axis that may move, see it stand, release the watchdogs, close the port. Ctrl-C waits for it.

        Args:
            leave_running: leave motors turning; None for what the configuration says.
        """
        self._opened.close(leave_running=leave_running)

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        calls.depth += 1
        try:
            self._opened.leave(kind, error, trace)
        finally:
            calls.depth -= 1
            if calls.pressed and not calls.depth:
                interrupts.take_effect()

    def __repr__(self) -> str:
        state = "closed" if self._inner.closed else "open" if self._inner.connected else "its port is lost"
        return f"<bus on {self._inner.port}: {state}>"

    def _repr_html_(self) -> str:
        try:
            stats = self.stats
        except BusError as error:
            return table(repr(self).strip("<>"), {"": str(error)})
        rows = {
            f"unit {address}": f"{unit.requests} requests, {unit.retries} repeated, {unit.timeouts} unanswered"
            for address, unit in sorted(stats.units.items())
        }
        return table(repr(self).strip("<>"), {"load": f"{100 * stats.load:.1f} % of the time", **rows})

    def _new(self, cls: type, arguments: tuple[Any, ...], keywords: dict[str, Any]) -> Any:
        return self._loop.call(self._opened.make, cls, *arguments, **keywords)

    def _axis(self, family: type, address: int, settings: dict[str, Any]) -> Any:
        return self._call(self._opened.axis, family, address, settings)


register(AsyncBus, Bus)
blocks.add(Bus.__exit__.__code__)
