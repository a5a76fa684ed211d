"""Where an axis counts from: its zero is set, and what became of that is known before a position is trusted."""

from __future__ import annotations

from collections.abc import Callable

from rs485bus.bus.bus import Bus
from rs485bus.errors import DeviceRefused, MoveFailed, NoReply, OutcomeUnknown, RequestFailed
from rs485bus.motion.carrier import PlanCarrier
from rs485bus.motion.drive import Drive
from rs485bus.motion.knowledge import AxisKnowledge
from rs485bus.motion.state import Fact
from rs485bus.wire.frames import is_read


class Reference:
    """The zero of one axis.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        axis: which one of the drive it is.
        name: names it in messages.
        knowledge: what is known of it.
        carrier: carries out plans.
        tolerance: counts by which a position may differ from where the axis was told to be.
    """

    def __init__(
        self,
        bus: Bus,
        drive: Drive,
        axis: int,
        name: str,
        knowledge: AxisKnowledge,
        carrier: PlanCarrier,
        tolerance: Callable[[], int],
    ) -> None:
        self._bus = bus
        self._drive = drive
        self._axis = axis
        self._name = name
        self._knowledge = knowledge
        self._state = knowledge.state
        self._carrier = carrier
        self._tolerance = tolerance

    async def zero(self) -> None:
        """Make the position at which the axis stands its zero.

        Where nobody says whether that was done, it is read. Where it cannot be read, no position is trusted.
        """
        state, began = self._state, self._bus.now()
        before = state.lost
        try:
            await self._carrier.carry(lambda: self._drive.zero(self._axis))
            await self.take(at_zero=True)
        except BaseException as error:
            refused = isinstance(error, DeviceRefused) and not is_read(error.request)
            if state.changed_at(Fact.POSITION) < began or (refused and self._drive.zeroed_by_one_frame):
                raise  # nothing was done
            state.distrust("nobody knows whether its zero was set.")
            if not (refused or isinstance(error, NoReply | OutcomeUnknown)) or not await self._was_set(before):
                raise

    async def take(self, *, at_zero: bool) -> int:
        """Trust positions from now on; where it stands. Raises `MoveFailed` where that should be at zero and is not."""
        await self._knowledge.afresh(Fact.POSITION)
        position: int = self._state.value(Fact.POSITION)
        if at_zero and abs(position) > max(self._tolerance(), self._state.rule.same):
            raise MoveFailed(f"{self._name} was set to zero and reports {position} {self._state.unit}.")
        self._state.lost = ""
        self._state.stood_at = position
        return position

    async def _was_set(self, before: str) -> bool:
        """See whether its zero was set, where its drive did not say so. It stands: what reports zero has its zero here,
        what reports anything else has kept the old one, which was trusted or not `before`."""
        try:
            await self._knowledge.afresh(Fact.POSITION)
        except RequestFailed:
            return False
        if abs(self._state.value(Fact.POSITION)) > self._state.jump // 5:
            self._state.lost = before
            return False
        if not self._drive.zeroed_by_one_frame:
            await self._carrier.carry(lambda: self._drive.zero(self._axis))  # zero it is already: nothing else changes
        await self.take(at_zero=True)
        return True
