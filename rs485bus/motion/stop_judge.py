"""Tells whether an axis stands, by what is asked after a stop. Pure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from rs485bus.bus.units.adapter import StandstillDetector
from rs485bus.motion.standstill import Standstill
from rs485bus.motion.state import Fact, Facts
from rs485bus.wire.frames import Request

if TYPE_CHECKING:
    from rs485bus.motion.drive import Drive


class StopJudge(StandstillDetector):
    """Tells whether some axes of a drive stand, by what is asked after a stop."""

    def __init__(self, drive: Drive, axes: Sequence[int]) -> None:
        self._drive = drive
        self._still = {axis: Standstill(drive.state.axes[axis].rule) for axis in axes}
        self._speeds: dict[int, float] = {}
        """What each axis told when it was asked last, in rpm, whichever way it turns."""
        self._status_last = False
        """The status was asked for last."""

    def stop_sent(self) -> None:
        self._status_last = False

    def ask(self, free: Callable[[Request], bool]) -> Request | None:
        says_so = all(still.says_so for still in self._still.values())
        self._status_last = not self._status_last and not says_so
        running, position = (self._drive.reading(fact, free) for fact in (Fact.RUNNING, Fact.POSITION))
        if self._status_last and running is not None:
            return running.request
        if position is not None:
            return position.request
        # The answer to another one shows that what is owed does not come any more.
        others = (request for request in reversed(self._drive.reads()) if free(request))
        return next(others, None)

    def see(self, request: Request, reply: bytes, sent_at: float) -> bool | None:
        told, moves = self._drive.decode(request, reply), False
        self.slows_down = self._is_slower(told)
        for axis, still in self._still.items():
            facts = told[axis] if axis < len(told) else {}
            seen = facts.get(Fact.POSITION), facts.get(Fact.RUNNING), facts.get(Fact.SPEED)
            still.see(sent_at, *seen, self._drive.state.so_by)
            moves = moves or facts.get(Fact.RUNNING) is True
        tells = any(fact in facts for facts in told for fact in (Fact.POSITION, Fact.RUNNING))
        self.lacks_place = not tells or all(still.says_so and still.position is None for still in self._still.values())
        verdicts = [still.verdict for still in self._still.values()]
        if False in verdicts:
            return False
        says_so = all(facts.get(Fact.RUNNING) is False for facts in told) and len(told) >= len(self._still)
        self.by_status_alone = None in verdicts and says_so
        if None in verdicts and not self.by_status_alone:
            return False if moves else None
        self.by_position_alone = not all(still.confirmed for still in self._still.values())
        if not self.by_status_alone:
            self._note_where(sent_at)
        return True

    def _is_slower(self, told: Sequence[Facts]) -> bool:
        """Whether each axis that turned when it was asked before is slower now, by more than one that stands may seem
        to turn."""
        rpms = {axis: facts.get(Fact.SPEED) for axis, facts in enumerate(told) if axis in self._still}
        before, self._speeds = self._speeds, {axis: abs(rpm) for axis, rpm in rpms.items() if rpm is not None}
        least = max(still.rule.still_rpm for still in self._still.values())
        turned = {axis: rpm for axis, rpm in before.items() if rpm > least}
        return bool(turned) and all(self._speeds.get(axis, rpm) < rpm - least for axis, rpm in turned.items())

    def _note_where(self, sent_at: float) -> None:
        """They stand where they were seen last: what is found elsewhere later has restarted."""
        for axis, still in self._still.items():
            state = self._drive.state.axes[axis]
            if sent_at >= self._drive.may_start_until(state.motion):
                state.stood_at = still.position
