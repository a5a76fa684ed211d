"""What the parts of a bus that users hold need of the bus itself."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, Protocol, TypeVar, Unpack

from rs485bus.bus.config import BusConfig
from rs485bus.bus.handle import Handle
from rs485bus.bus.owner import Owner
from rs485bus.bus.record import Record
from rs485bus.bus.requests import AskOptions
from rs485bus.bus.schedule.scheduler import Failed, unheeded
from rs485bus.bus.stopping.halt import Procedure
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.wire.frames import Request

T = TypeVar("T")


class BusProtocol(Protocol):
    """The event loop's side of a bus."""

    config: BusConfig

    @property
    def owner(self) -> Owner:
        """The machine inside."""

    @property
    def devices(self) -> list[DeviceAdapter]:
        """The devices attached."""

    @property
    def flight(self) -> list[Record]:
        """The latest transactions."""

    def check_thread(self) -> None:
        """Refuse a call that the event loop of the bus cannot carry out."""

    def now(self) -> float:
        """The time on the bus' clock, in seconds."""

    def unseen(self, handle: Handle[Any]) -> None:
        """A command failed: it is told, unless somebody sees it."""

    def poke(self) -> None:
        """The owner has something new to wait for."""

    def after(self, seconds: float, callback: Callable[[], None]) -> asyncio.TimerHandle:
        """Call back after so many seconds."""

    def start(self, procedure: Procedure[T], done: Callable[[T], None], failed: Failed = unheeded) -> None:
        """Have the owner carry out a procedure that nothing can cancel. One that raises has `failed`."""

    def ask(self, request: Request, **options: Unpack[AskOptions]) -> Coroutine[Any, Any, bytes]:
        """Send a request; the coroutine returns the frame that answers it."""
