"""Writes and asks for the parameters of one TL-R drive, in the order in which that was said."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.tlr.drive import TlrDrive
from rs485bus.devices.tlr.frames import read
from rs485bus.motion.plan import Plan
from rs485bus.wire.frames import payload
from rs485bus.wire.registers import Block, Register

Order = Callable[[str, Callable[[], Plan[None]]], Handle[None]]
Carry = Callable[[Callable[[], Plan[None]]], Awaitable[None]]


class TlrParameters:
    """The parameters of one drive.

    Args:
        bus: the bus it is on.
        drive: the drive.
        order: queues a plan.
        carry: carries a plan out at once.
    """

    def __init__(self, bus: Bus, drive: TlrDrive, order: Order, carry: Carry) -> None:
        self.drive = drive
        self._bus = bus
        self._order = order
        self._carry = carry
        self._latest: Handle[None] | None = None

    def order(self, what: str, plan: Callable[[], Plan[None]]) -> Handle[None]:
        """Queue a plan that sets nothing in motion, for when the drive is set up."""

        def whole() -> Plan[None]:
            yield from self.drive.set_up()
            yield from plan()

        self._latest = self._order(what, whole)
        return self._latest

    def put(self, where: Register[Any] | Block, *values: Any) -> Handle[None]:
        """Queue the writing of a parameter, and its reading back. Raises `LimitExceeded`; nothing is queued then."""
        where.encode(*values)
        what = f"{where.name} = {', '.join(map(str, values))}"
        return self.order(what, lambda: self.drive.writer.put(where, *values))

    async def ask(self, what: Register[Any] | Block) -> Any:
        """Ask for a parameter, once those that were queued before are written."""
        latest = self._latest
        if latest is not None and not latest.done():
            ended = asyncio.Event()
            latest.add_done_callback(lambda _: ended.set())  # who awaits it is told how
            await ended.wait()
        return what.decode(payload(await self._bus.ask(read(self.drive.address, what), urgency=Urgency.POLL)))

    async def set_up(self) -> None:
        """Know what must be known before anything else."""
        await self._carry(self.drive.set_up)
