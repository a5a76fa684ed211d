"""Asks a drive for what is not known of an axis, or too old to decide by."""

from __future__ import annotations

from collections.abc import Iterable

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.schedule.job import Urgency
from rs485bus.errors import ReferenceLost
from rs485bus.motion.diagnosis import LOST
from rs485bus.motion.drive import Drive
from rs485bus.motion.state import FRESH, Fact

_LOOK_AGAIN = 0.005
_ATTEMPTS = 3
"""How often something is asked whose answer may have been that to something older, or tells nothing."""


class AxisKnowledge:
    """What is known of one axis, for who is about to decide something.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        axis: which one of the drive it is.
        name: names it in messages.
    """

    def __init__(self, bus: Bus, drive: Drive, axis: int, name: str) -> None:
        self.state = drive.state.axes[axis]
        self._bus = bus
        self._drive = drive
        self._axis = axis
        self._name = name

    async def know(self, facts: Iterable[Fact], *, since: float | None = None) -> None:
        """Have facts that were asked for since a time, or at least since the last frame that can have changed them."""
        for fact in self._drive.tells(*facts):
            for _ in range(_ATTEMPTS):
                known = self.state.known(fact)
                if known.value is not None and (since is None or known.at >= since):
                    break
                reading = self._drive.reading(fact)
                assert reading is not None
                await self._bus.ask(reading.request, urgency=Urgency.POLL)

    async def afresh(self, *facts: Fact) -> None:
        """Ask for facts now."""
        await self.know(facts, since=self._bus.now())

    async def stands(self) -> bool:
        """Whether the axis stands, as can be seen now."""
        still, rule = self.state.standstill, self.state.rule
        if still.verdict is True and still.until > self._bus.now() - FRESH:
            return True
        await self.afresh(Fact.POSITION)
        while still.is_in_doubt(FRESH):
            await self.know((Fact.RUNNING,), since=still.since)
            again = max(still.since + rule.apart, still.until + _LOOK_AGAIN)
            await anyio.sleep(max(0.0, again - self._bus.now()))
            await self.afresh(Fact.POSITION)
        return still.verdict is True

    async def see_restart(self, *facts: Fact) -> None:
        """Ask for what a restart would change, and for other facts, since the drive may have restarted last."""
        await self.know((*self._drive.marks(self._axis), *facts), since=self._drive.state.unsure_since(self._bus.now()))
        enabled = self.state.known(Fact.ENABLED)
        if enabled.value is False and self.state.holds:
            # A protection that let go of the motor explains that as well.
            await self.know((Fact.STALLED, Fact.FAULT), since=enabled.at)
        self.notice_restart()

    def notice_restart(self) -> None:
        """Trust its positions no more, if what is known shows that the drive has restarted."""
        self.state.suspect(self._drive.restarted(self._axis))

    def check_reference(self) -> None:
        """Raise `ReferenceLost` where its positions are not to be trusted."""
        if self.state.lost:
            raise ReferenceLost(f"{self._name}: {self.state.lost} {LOST}")
