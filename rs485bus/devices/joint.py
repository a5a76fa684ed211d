"""A move that one axis makes together with others."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import NamedTuple, Protocol

from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.devices.move import Move, MoveState
from rs485bus.devices.pace import Pace
from rs485bus.profile import Profile


class Course(NamedTuple):
    """How fast one of those goes that start together, and when it starts."""

    pace: Pace
    slot: BurstSlot


class Company(Protocol):
    """Those that move together. Each is known by its name."""

    async def meet(self, who: str) -> None:
        """Wait until all are as far as this one."""

    async def agree(self, who: str, turns: float, target: int) -> Course:
        """Wait until it is known of all how far they go, in turns; 0 for one that is there already."""

    async def all_arrived(self, who: str, within: float) -> bool:
        """This one has arrived. Wait some seconds until all have; whether they have."""

    def finished(self, who: str, position: float) -> None:
        """This one's part has ended well, there."""

    def stumbled(self, who: str) -> None:
        """This one's part is about to fail. The others are stopped while it is found out why."""

    def broken(self, who: str, error: Exception) -> None:
        """This one's part has failed. All are stopped, and each is told then (`JointMove.tell`)."""


class JointMove(Move):
    """One axis' part of a move that several make together.

    Where it fails, the others are stopped, and only then is anybody told.

    Args:
        what: names it in messages.
        target: where it goes, in the axis' units; None if that is not known yet.
        position: asks the axis where it is.
        cancel: stops the axis on behalf of this move.
        who: which axis it is, among the others.
        company: the others.
    """

    def __init__(
        self,
        what: str,
        target: float | None,
        position: Callable[[], Awaitable[float]],
        cancel: Callable[[Move], None],
        who: str,
        company: Company,
    ) -> None:
        super().__init__(what, target, position, cancel, lambda _: None)
        self.who = who
        self.profile: Profile | None = None
        """How it goes, as long as nobody changes that."""
        self._company = company

    def finish(self, result: float) -> None:
        super().finish(result)
        self._company.finished(self.who, result)

    def fail(self, error: Exception) -> None:
        if not self.done():
            self._company.broken(self.who, error)

    def tell(self, error: Exception) -> None:
        """Tell who waits that it has failed."""
        super().fail(error)

    # For the axis

    def stumble(self) -> None:
        """Have the others stopped: it is about to fail."""
        if self.state is not MoveState.QUEUED:
            self._company.stumbled(self.who)

    async def gathered(self) -> None:
        """Wait until all have come to it, in their queues."""
        await self._company.meet(self.who)

    async def prepared(self) -> None:
        """Wait until all stand, and may be moved."""
        await self._company.meet(self.who)

    async def agree(self, turns: float, target: int) -> Course:
        """Wait until all know how far they go, and agree on how fast they do."""
        return await self._company.agree(self.who, turns, target)

    async def all_arrived(self, within: float) -> bool:
        """Say that the axis has arrived; wait so many seconds until all have. Whether they have."""
        return await self._company.all_arrived(self.who, within)

    async def ended(self) -> None:
        """Wait until it has ended for all: none begins its next command while another may still fail in this one."""
        await self._company.meet(self.who)
