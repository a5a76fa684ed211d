"""Moves that only an MKS drive can make: by pulses, by counts, and to another target while under way.

Source: MKS RTU V1.0.9, 9.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from rs485bus.bus.handle import Handle
from rs485bus.devices.conduct import Look, Pace
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.values import MotionDirection
from rs485bus.devices.move import Move, MoveState
from rs485bus.errors import LimitExceeded, MotionError, MoveCancelled, OutcomeUnknown, RequestFailed
from rs485bus.profile import seconds_to
from rs485bus.wire.registers import Field

_ATTEMPTS = 3


@dataclass(frozen=True, slots=True)
class _Change:
    """Another target for the move under way."""

    handle: Handle[None]
    position: float
    target: int
    pace: Pace


class MksMoves(MksDrive):
    """Moves in the drive's own units, and changes of a move under way.

    Pulses are 200 times the microsteps a turn, counts 0x4000 a turn; both have the sign of positions. Whether the drive
    counts pulses and coordinates in the same direction only hardware tells: where it does not, such a move ends as
    `ReferenceLost` or `MoveFailed`.
    """

    _live = False
    """An absolute move by coordinates is under way: it can be changed."""
    _change: _Change | None = None

    # Verbs

    def move_by_pulses(self, pulses: int, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go so many pulses, by a relative command (9.1). `move_by` is safer: it can be said twice.

        Where its answer is lost, it is said again only if status and position show that it was not taken. A move too
        short to tell (`tolerance`) raises `OutcomeUnknown` then, and the axis moves only after `enable()`.

        Args:
            pulses: -4294967295..4294967295, not 0.
            rpm: the speed, above 0.
            acceleration: in rpm/s; infinity for a jump.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is queued.
        """
        pace = self._pace(rpm, acceleration)
        _check_distance(r.MOVE_PULSES.fields[3], abs(pulses))

        async def start(code: int) -> None:
            self._plan_stop(r.MOVE_PULSES, (MotionDirection.CCW, pace.ramp_code, 0, 0), pace)
            direction = self._direction(self._sign * pulses)
            await self._send(r.MOVE_PULSES, direction, pace.ramp_code, code, abs(pulses))

        return self._queue(
            f"move by {pulses} pulses", pace, lambda look: look.position + self._counts_of(pulses), start, once=True
        )

    def move_by_counts(self, counts: int, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go so many counts, by a relative command (9.3). As `move_by_pulses`, for -2147483648..2147483647 counts.

        It also goes where `move_to` and `move_by` cannot: beyond the 32 bits of an absolute target.
        """
        pace = self._pace(rpm, acceleration)
        _check_distance(r.MOVE_COUNTS.fields[2], self._sign * counts)

        async def start(code: int) -> None:
            self._plan_stop(r.MOVE_COUNTS, (pace.ramp_code, 0, 0), pace)
            await self._send(r.MOVE_COUNTS, pace.ramp_code, code, self._sign * counts)

        return self._queue(
            f"move by {counts} counts", pace, lambda look: look.position + self._sign * counts, start, once=True
        )

    def move_to_pulses(self, pulses: int, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go to a position counted in pulses from zero (9.2): -2147483648..2147483647. Else as `move_to`."""
        pace = self._pace(rpm, acceleration)
        r.MOVE_TO_PULSES.fields[2].raw(self._sign * pulses)

        async def start(code: int) -> None:
            self._plan_stop(r.MOVE_TO_PULSES, (pace.ramp_code, 0, 0), pace)
            await self._send(r.MOVE_TO_PULSES, pace.ramp_code, code, self._sign * pulses)

        return self._queue(f"move to {pulses} pulses", pace, lambda _: self._counts_of(pulses), start, once=False)

    def retarget(self, position: float, *, rpm: float | None = None, acceleration: float | None = None) -> Handle[None]:
        """Change target, speed and acceleration of the absolute move under way, without a stop (9.4, note 2).

        The move keeps its handle, and is done where it goes now. The handle returned is done once the drive took the
        change. Arguments as for `move_to`.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is sent.
            MotionError: no `move_to` or `move_by` is under way (`move.state` is not `MoveState.MOVING`).
        """
        pace = self._pace(rpm, acceleration)
        target = self._target(position)
        move = self._orders.current
        if not (self._live and isinstance(move, Move) and move.state is MoveState.MOVING):
            raise MotionError(f"{self.name}: no move_to() or move_by() is under way that could be changed.")
        self._drop_change(f"{self.name}: another change of its target came first.")
        handle: Handle[None] = Handle(f"change of the target of {self.name}", self._unseen)
        self._change = _Change(handle, position, target, pace)
        self._planned = None
        self._stands.set()
        return handle

    # Inside

    def _queue(
        self,
        what: str,
        pace: Pace,
        target_from: Callable[[Look], int],
        start: Callable[[int], Awaitable[None]],
        *,
        once: bool,
    ) -> Move:
        """Queue a move; `start` is given the speed as the drive is told it then."""
        move = self._new_move(what, None)
        self._planned = None

        def target(look: Look) -> int:
            counts = target_from(look)
            self._check_limits(self._to_units(counts))
            move.target = self._to_units(counts)
            return counts

        async def carry_out() -> float:
            look = await self._carry_out(move, target, pace, lambda: start(self._speed_code(pace)), once=once)
            return self._to_units(look.position)

        self._orders.add(move, carry_out)
        return move

    def _counts_of(self, pulses: int) -> int:
        return self._sign * round(pulses * r.COUNTS_PER_TURN / (r.STEPS_PER_TURN * self.microsteps))

    async def _carry_out(
        self,
        move: Move,
        target_from: Callable[[Look], int],
        pace: Pace,
        send: Callable[[], Awaitable[None]] | None = None,
        *,
        once: bool = False,
    ) -> Look:
        self._live = send is None
        try:
            look = await super()._carry_out(move, target_from, pace, send, once=once)
            if self._near(look.position, 0):
                await self._check_zero()
            return look
        finally:
            self._live = False
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
        pace, speed = change.pace, await self._read_velocity()
        sent_at = self.bus.now()
        for attempt in range(_ATTEMPTS):
            try:
                await self._send_move(change.target, pace)
                break
            except OutcomeUnknown:
                if attempt + 1 == _ATTEMPTS:
                    raise
                if not await self._still_turns():
                    self._lost = "it stood still when its target was changed: the drive may have restarted."
                    raise
        # It may be faster than it is to be.
        self._drive.ramp_takes = max(abs(speed), pace.rpm) / pace.acceleration
        self._way = (self._way[0], change.target)
        move.target, move.rpm, move.acceleration = change.position, pace.rpm, pace.acceleration
        turns = (change.target - look.position) / self.counts_per_turn
        move.eta = sent_at + seconds_to(turns, pace.rpm, pace.acceleration, speed)
        change.handle.finish(None)

    async def _still_turns(self) -> bool:
        try:
            return (await self._look(quick=True)).moving
        except RequestFailed:
            return False


def _check_distance(field: Field[int], distance: int) -> None:
    if field.raw(distance) == 0:
        raise LimitExceeded(f"{field.name} 0 is no distance")
