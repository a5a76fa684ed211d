"""The lease of a client: it is taken for what is commanded, and kept by showing presence."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from functools import partial

from rs485bus.bus.handle import start_task
from rs485bus.errors import BusError, NotInControl
from rs485bus.remote.session import Session, new_id
from rs485bus.service.schema import Holding, Presence
from rs485bus.service.topics import PLANT


class Control:
    """What one client commands.

    Args:
        session: its connection.
        seconds: for how long it may be silent: then its axes are stopped.
    """

    def __init__(self, session: Session, seconds: float) -> None:
        self._session = session
        self._seconds = seconds
        self._axes: frozenset[str] = frozenset()
        self._lock = asyncio.Lock()
        self._keeping: asyncio.Task[None] | None = None
        self.number: int | None = None
        self.lost = ""
        """Why control was lost, until it is taken again."""

    @property
    def axes(self) -> frozenset[str]:
        """What is commanded now."""
        return self._axes

    async def cover(self, axes: Iterable[str]) -> int:
        """The number of the lease, once it covers the axes.

        Raises:
            NotInControl: another client commands one of them, or control was lost and not taken again since.
        """
        async with self._lock:
            self._check_plant()
            if self.lost:
                raise NotInControl(
                    f"Control was lost: {self.lost} The axes were stopped. Nothing was done. take_control() to go on."
                )
            wanted = frozenset(axes)
            if self.number is None or not wanted <= self._axes:
                await self._take(wanted | self._axes)
            assert self.number is not None
            return self.number

    async def take(self, axes: Iterable[str]) -> None:
        """Take control of axes, after it was lost, too."""
        async with self._lock:
            self._check_plant()
            self.lost = ""
            await self._take(frozenset(axes) | self._axes)

    async def release(self) -> None:
        """Give control back: what still moves is stopped, and seen to stand."""
        self._stop_keeping()
        number, self.number, self._axes = self.number, None, frozenset()
        session = self._session
        if number is not None and session.served:
            await session.ask(PLANT, "release_control", {}, f"release of {session.topics.plant}", lease=number).wait()

    def close(self) -> None:
        """Show presence no more."""
        self._stop_keeping()

    def _check_plant(self) -> None:
        if self._session.changed:
            raise NotInControl(
                f"{self._session.topics.plant} was started again as another plant: its axes, their units, speeds or "
                "limits are not those that this client was made for. Nothing was done. Look, then connect anew."
            )

    async def _take(self, axes: frozenset[str]) -> None:
        session = self._session
        told = await session.ask(
            PLANT,
            "take_control",
            {"axes": sorted(axes), "seconds": self._seconds},
            f"control of {', '.join(sorted(axes)) or session.topics.plant}",
            lease=self.number,
        )
        holding = Holding.model_validate(told)
        self.number, self._axes = holding.lease, frozenset(holding.axes)
        if self._keeping is None:
            self._keeping = start_task(self._keep(), "rs485bus presence")

    async def _keep(self) -> None:
        """Show presence, until control is lost."""
        session = self._session
        loop = asyncio.get_running_loop()
        answered = loop.time()
        while (number := self.number) is not None:
            if loop.time() - answered > 2 * self._seconds:
                self._lose("the service did not answer.")
                return
            request = new_id()
            make = partial(self._presence, request, number)
            try:
                async with asyncio.timeout(self._seconds / 2):
                    await session.say(session.topics.presence(session.client), request, make, "presence").wait()
                answered = loop.time()
            except NotInControl as error:
                if self.number == number:
                    self._lose(str(error))
                return
            except (BusError, TimeoutError):
                session.requests.drop(request)
            await asyncio.sleep(self._seconds / 4)

    def _presence(self, request: str, number: int) -> Presence:
        return Presence(id=request, client=self._session.client, lease=number, sent=self._session.now())

    def _lose(self, why: str) -> None:
        self.number, self._axes, self.lost, self._keeping = None, frozenset(), why, None

    def _stop_keeping(self) -> None:
        keeping, self._keeping = self._keeping, None
        if keeping is not None:
            keeping.cancel()
