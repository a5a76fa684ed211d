"""Moves that only an MKS drive can make: by pulses, by counts, and to another target while under way.

Source: MKS RTU V1.0.9, 9.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.values import MotionDirection
from rs485bus.devices.move import Move
from rs485bus.devices.pace import Pace
from rs485bus.devices.retarget import Retargeting
from rs485bus.devices.travel import Look
from rs485bus.errors import LimitExceeded
from rs485bus.wire.registers import Field


class MksMoves(MksDrive, Retargeting):
    """Moves in the drive's own units, and changes of a move under way.

    Pulses are 200 times the microsteps a turn, counts 0x4000 a turn; both have the sign of positions. Whether the drive
    counts pulses and coordinates in the same direction only hardware tells: where it does not, such a move ends as
    `ReferenceLost` or `MoveFailed`.
    """

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
        pulses = self._whole("pulses", pulses)
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
        counts = self._whole("counts", counts)
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
        pulses = self._whole("pulses", pulses)
        r.MOVE_TO_PULSES.fields[2].raw(self._sign * pulses)

        async def start(code: int) -> None:
            self._plan_stop(r.MOVE_TO_PULSES, (pace.ramp_code, 0, 0), pace)
            await self._send(r.MOVE_TO_PULSES, pace.ramp_code, code, self._sign * pulses)

        return self._queue(f"move to {pulses} pulses", pace, lambda _: self._counts_of(pulses), start, once=False)

    # Inside

    def _whole(self, what: str, value: float) -> int:
        """A whole number, which may be given as a float."""
        number = self._number(what, value)
        if not number.is_integer():
            raise LimitExceeded(f"{self.name}: {what} {value!r} is not a whole number")
        return int(number)

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
        look = await super()._carry_out(move, target_from, pace, send, once=once)
        await self._check_came_to_zero(look)
        return look

    async def _send_change(self, target: int, pace: Pace, speed: float) -> None:
        """By 0xF5 once more (9.4, note 2)."""
        await self._send_start(target, pace, None)
        # It may be faster than it is to be.
        self._drive.ramp_takes = max(abs(speed), pace.rpm) / pace.acceleration


def _check_distance(field: Field[int], distance: int) -> None:
    if field.raw(distance) == 0:
        raise LimitExceeded(f"{field.name} 0 is no distance")
