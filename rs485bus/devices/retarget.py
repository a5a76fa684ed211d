"""Another target for the move under way, without a stop. Families that can do it say how: `_send_change`."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from rs485bus.bus.handle import Handle
from rs485bus.devices.axis import FormerAxis
from rs485bus.errors import MotionError, MoveCancelled, OutcomeUnknown, RequestFailed
from rs485bus.motion.group.member import GroupMemberMove
from rs485bus.motion.move import Move, MoveState, MoveTarget
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.profile import seconds_to

_ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class _Change:
    handle: Handle[None]
    position: float
    target: int
    pace: MotionParameters


class Retargeting(FormerAxis):
    """An axis whose absolute moves can be changed while they are under way."""

    _live: Move | None = None
    """The absolute move under way."""
    _change: _Change | None = None

    @abstractmethod
    async def _send_change(self, target: int, pace: MotionParameters, speed: float) -> None:
        """Give the move under way, which has this speed in rpm, another target. Raises `OutcomeUnknown` if nobody knows
        whether it has it; it may be said again then."""

    def retarget(self, position: float, *, rpm: float | None = None, acceleration: float | None = None) -> Handle[None]:
        """Change target, speed and acceleration of the `move_to` or `move_by` under way, without a stop.

        The move keeps its handle, and is done where it goes now. The handle returned is done once the drive took the
        change. Arguments as for `move_to`.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is sent.
            MotionError: no such move is under way (`move.state` is not `MoveState.MOVING`).
        """
        pace = self._pace(rpm, acceleration)
        position = self._number("position", position)
        target = self._target(position)
        if self._live is None or self._live.state is not MoveState.MOVING:
            raise MotionError(f"{self.name}: no move_to() or move_by() is under way that could be changed.")
        self._drop_change(f"{self.name}: another change of its target came first.")
        handle: Handle[None] = Handle(f"change of the target of {self.name}", self._unseen)
        self._change = _Change(handle, position, target, pace)
        self._planned = None
        self._stands.set()
        return handle

    async def _move(self, move: Move, goal: MoveTarget, pace: MotionParameters) -> float:
        self._live = move
        try:
            return await super()._move(move, goal, pace)
        finally:
            self._live = None
            self._drop_change(f"{self.name}: its move ended before the target was changed.")

    def _drop_change(self, why: str) -> None:
        change, self._change = self._change, None
        if change is not None:
            change.handle.fail(MoveCancelled(why))

    async def _meanwhile(self, move: Move) -> None:
        change, self._change = self._change, None
        if change is None:
            return
        try:
            await self._make_change(move, change)
        except RequestFailed as error:
            change.handle.fail(error)
            if isinstance(error, OutcomeUnknown):
                await self._block("nobody knows which target it goes to")
                raise
            # The move goes on to where it went.
        except BaseException as error:
            change.handle.fail(MoveCancelled(f"{self.name}: its target was not changed ({error!r})."))
            raise

    async def _make_change(self, move: Move, change: _Change) -> None:
        await self._grace()
        look = await self._look(quick=True)
        if not look.moving:
            # It has ended, or its drive has restarted: nothing may set it in motion again.
            change.handle.fail(MoveCancelled(f"{self.name} stood still before its target was changed."))
            return
        pace, speed, sent_at = change.pace, await self._read_velocity(), self.bus.now()
        for attempt in range(_ATTEMPTS):
            try:
                await self._send_change(change.target, pace, speed)
                break
            except OutcomeUnknown:
                if attempt + 1 == _ATTEMPTS:
                    raise
                if not await self._still_turns():
                    self._suspect("it stood still when its target was changed: the drive may have restarted.")
                    raise
                # One that has moved all the time has not restarted, and an absolute target may be said twice.
        self._way = (self._way[0], change.target)
        if isinstance(move, GroupMemberMove):
            move.profile = None
        move.target, move.rpm, move.acceleration = change.position, pace.rpm, pace.acceleration
        turns = (change.target - look.position) / self.counts_per_turn
        move.eta = sent_at + seconds_to(turns, pace.rpm, pace.acceleration, speed)
        change.handle.finish(None)

    async def _still_turns(self) -> bool:
        try:
            return (await self._look(quick=True)).moving
        except RequestFailed:
            return False
