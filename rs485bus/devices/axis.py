"""What all axes share for those who use them: units, limits, and the verbs.

A verb acts when it is called: it checks its arguments, joins the axis' queue and returns a handle. A stop overtakes
the queue and is carried out by the owner, whatever becomes of who asked for it.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Awaitable, Callable, Mapping
from typing import Any, TypeVar

from rs485bus.arguments import flag, pair, positive, real, whole
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.bus.units.motion import Motion
from rs485bus.bus.watchdog.guard import WatchdogGuard
from rs485bus.devices.conduct import Conduct
from rs485bus.devices.travel import Look
from rs485bus.errors import BusClosed, EmergencyStopped, LimitExceeded, MoveCancelled, NotSent
from rs485bus.motion.group.member import GroupAxis, GroupCoordinator, GroupMemberMove
from rs485bus.motion.move import Move, MoveTarget
from rs485bus.motion.parameters import MotionParameters, quickest

T = TypeVar("T")


class FormerAxis(Conduct):
    """One motor.

    Args:
        bus: the bus its drive is on.
        attached: its drive, as the bus knows it.
        motion: what of the drive it is.
        name: the axis, in messages.
        units_per_turn: positions are in units of this many to a turn of the motor; 1 for turns.
        reverse: whether positive is the other way round.
        limits: lowest and highest position that may be gone to, in units; None for no limit.
        rpm: the speed of moves that name none.
        acceleration: the acceleration of moves that name none, in rpm/s.
        tolerance: counts of the drive by which a position may differ from another that is to be the same.

    Raises:
        LimitExceeded, ValueError: an argument is out of its range.
        TypeError: one is of a wrong type.
    """

    def __init__(
        self,
        bus: Bus,
        attached: DeviceAdapter,
        motion: Motion,
        name: str,
        *,
        units_per_turn: float,
        reverse: bool,
        limits: tuple[float, float] | None,
        rpm: float,
        acceleration: float,
        tolerance: int,
    ) -> None:
        super().__init__(bus, attached, motion, name, whole("tolerance", tolerance, 0))
        self.units_per_turn = positive("units_per_turn", units_per_turn, "; use reverse=True to turn the other way")
        self.reverse = flag("reverse", reverse)
        self.limits = None if limits is None else _limits(limits)
        self.rpm = real("rpm", rpm)
        self.acceleration = real("acceleration", acceleration)
        self._planned: float | None = None
        """Where the queue will have taken it, in units, if that is known."""
        self._exact: float | None = None
        """Where the last move went, in units, before that was rounded to counts."""
        self._pace(self.rpm, self.acceleration)

    def __repr__(self) -> str:
        return f"<{self.name}>"

    # Verbs

    def enable(self) -> Handle[None]:
        """Energise the motor, so that it holds its position and takes moves.

        After an emergency stop, a trip, or a stop that was not confirmed, its first frame is a stop.
        """
        self.forgive()
        return self._order("enable", self._carry_out_enable)

    def disable(self) -> Handle[None]:
        """Let go of the shaft, once what is queued before it is done and the motor stands. It can then be turned."""
        handle = self._order("disable", self._carry_out_disable)
        self._planned = None
        return handle

    def move_to(self, position: float, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go to a position.

        Args:
            position: in the axis' units.
            rpm: the speed, above 0.
            acceleration: in rpm/s; infinity for a jump.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is queued.
            TypeError: one of them is no number; nothing is queued.
        """
        return self._go(self._pace(rpm, acceleration), self.goal_to(position))

    def move_by(self, distance: float, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go a distance: from the target of the last move if that was reached, else from where the axis stands.

        It is sent as an absolute target, so that it happens once, however often it must be said. Arguments and errors
        as for `move_to`.
        """
        return self._go(self._pace(rpm, acceleration), self.goal_by(distance))

    def run(self, rpm: float, *, acceleration: float | None = None, duration: float | None = None) -> Move:
        """Turn at a speed. Done once that is reached; with a `duration`, once the motor stands again after it.

        Args:
            rpm: the speed; its sign is the direction, and 0 slows down to a stand.
            acceleration: in rpm/s; infinity for a jump.
            duration: seconds; None to go on until told otherwise.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is queued.
            TypeError: one of them is no number; nothing is queued.
        """
        rpm = self._number("rpm", rpm)
        pace = self._pace(abs(rpm) or None, acceleration)
        duration = None if duration is None else self._number("duration", duration)
        ticks = None if duration is None else self._ticks(duration)
        signed = self._sign * (pace.rpm if rpm > 0 else -pace.rpm if rpm < 0 else 0.0)
        move = self._new_move(f"run at {rpm:g} rpm", None)
        self._planned = None
        self._orders.add(move, lambda: self._run(move, signed, pace, duration, ticks))
        return move

    def set_zero(self) -> Handle[None]:
        """Make the position at which the axis then stands its zero."""
        handle = self._order("set_zero", self._carry_out_zero)
        self._planned = 0.0
        return handle

    def stop(self) -> Handle[None]:
        """Stop with the ramp of the running move, see that it stands, and drop what is queued.

        It happens at once, whether the handle is awaited or not, and is repeated until it is confirmed by reading. A
        repetition is the same stop. An emergency stop follows where the drive acknowledged it and does not stand after
        one and a half times its stopping time, or where it acknowledged neither of two.

        Raises:
            StopUnconfirmed: when it is awaited: the axis could not be seen standing after three stops, or while the
                port was away. It is stopped further on.
        """
        return self._stop_now(emergency=False)

    def emergency_stop(self) -> Handle[None]:
        """Stop as fast as the drive can, see that it stands, and drop what is queued."""
        return self._stop_now(emergency=True)

    def watchdog(self, timeout: float, *, lease: float | None = None) -> WatchdogGuard:
        """Guard the axis by its drive's own watchdog while a block runs. As `Bus.watchdog`."""
        return self.bus.watchdog(self, timeout=timeout, lease=lease)

    # For groups

    def goal_to(self, position: float) -> MoveTarget:
        """A position, in units, as somewhere to go. Raises `LimitExceeded`."""
        position = self._number("position", position)
        self._target(position)
        return MoveTarget(f"move to {position:g}", position, position, lambda _: position, self.target_range)

    def goal_by(self, distance: float) -> MoveTarget:
        """A distance, in units, as somewhere to go. Raises `LimitExceeded`."""
        distance = self._number("distance", distance)
        self._to_counts(distance)
        planned = None if self._planned is None else self._planned + distance
        if planned is not None:
            self._target(planned, self._reach)
        return MoveTarget(
            f"move by {distance:g}", None, planned, lambda at: self._starts_from(at) + distance, self._reach
        )

    @property
    def planned(self) -> float | None:
        """Where the queue will have taken it, in units, if that is known."""
        return self._planned

    def way(self, start: float, end: float) -> float:
        """How many turns it is from one position, in units, to another; 0 where these are the same to the drive."""
        counts = abs(self._to_counts(end) - self._to_counts(start))
        return counts / self.counts_per_turn if counts > self.tolerance else 0.0

    def forgive(self) -> None:
        """Take commands again after a failure that nobody has seen."""
        self.bus.check_thread()
        self._orders.forgive()

    def join(self, goal: MoveTarget, who: str, coordinator: GroupCoordinator) -> GroupMemberMove:
        """Queue a move that is made together with others, and of which they say how fast it is."""
        move = GroupMemberMove(
            f"{goal.what} of {self.name}", goal.target, self.position, self._cancel_move, who, coordinator
        )
        self._planned = goal.planned

        async def carry_out() -> float:
            await move.gathered()
            return await self._move(move, goal, quickest(self, min(self.rpm, self.highest_rpm)))

        self._orders.add(move, carry_out)
        return move

    def accompany(self, moves: Mapping[GroupAxis, GroupMemberMove]) -> None:
        """Know who starts with it, before it does."""

    # Questions

    async def position(self) -> float:
        """Where the axis is, in its units."""
        return self._to_units(await self._read_position())

    async def velocity(self) -> float:
        """How fast the motor turns, in rpm."""
        return self._sign * await self._read_velocity()

    async def idle(self) -> bool:
        """Whether nothing is queued and the motor stands."""
        return self._orders.idle and not (await self._look()).moving

    async def drain(self) -> None:
        """Wait until nothing is queued or on its way to a target."""
        await self._orders.drain()

    # What families do

    @property
    @abstractmethod
    def target_range(self) -> tuple[int, int]:
        """The lowest and highest absolute target that the drive can be given, in counts."""

    @property
    def _reach(self) -> tuple[int, int]:
        """The same for a move by a distance, where the drive can go further so."""
        return self.target_range

    @property
    @abstractmethod
    def _fastest(self) -> tuple[float, str]:
        """The highest speed, in rpm, and what makes it that."""

    @abstractmethod
    def _paced(self, rpm: float, acceleration: float) -> MotionParameters:
        """What the drive makes of a speed that it can have, and of an acceleration.

        Raises:
            LimitExceeded: it cannot accelerate like that.
        """

    @property
    def highest_rpm(self) -> float:
        """The highest speed of moves to a position."""
        return self._fastest[0]

    @property
    def rpm_step(self) -> float:
        """The step in which speeds of moves to a position can be told, in rpm."""
        return 1.0

    @abstractmethod
    def lowest_acceleration(self, rpm: float) -> float:
        """The slowest ramp to a speed, in rpm/s: the same for all speeds, or in proportion to them."""

    def position_pace(self, rpm: float, acceleration: float) -> MotionParameters:
        """What the drive makes of a speed and an acceleration on its way to a position. Raises `LimitExceeded`."""
        return self._pace(rpm, acceleration)

    @abstractmethod
    def _ticks(self, duration: float) -> int:
        """How a duration, in seconds, is said to the drive. Raises `LimitExceeded`."""

    @abstractmethod
    async def _read_position(self) -> int:
        """Where it is, in counts."""

    # Inside

    @property
    def _sign(self) -> int:
        return -1 if self.reverse else 1

    def _number(self, what: str, value: float) -> float:
        """A number given to a verb. Raises `TypeError`; `LimitExceeded` for nan."""
        return real(f"{self.name}: {what}", value)

    def _pace(self, rpm: float | None, acceleration: float | None) -> MotionParameters:
        """What the drive makes of a speed and an acceleration; None for the axis' own. Raises as verbs do."""
        speed = self._number("rpm", self.rpm if rpm is None else rpm)
        ramp = self._number("acceleration", self.acceleration if acceleration is None else acceleration)
        self._check_speed(speed)
        return self._paced(speed, ramp)

    def _check_speed(self, rpm: float) -> None:
        """Raise `LimitExceeded` for a speed that the motor cannot have."""
        highest, why = self._fastest
        if not 0 < rpm <= highest:
            raise LimitExceeded(
                f"{self.name}: rpm {rpm:g} is outside its range, which is above 0, up to {highest:g} ({why})"
            )

    def _to_counts(self, units: float) -> int:
        """Counts of the drive. Raises `LimitExceeded` for what is no number, or has no end."""
        if not math.isfinite(units):
            raise LimitExceeded(f"{self.name}: {units:g} is no position and no distance; those are finite numbers.")
        return self._sign * round(units / self.units_per_turn * self.counts_per_turn)

    def _to_units(self, counts: int) -> float:
        return self._sign * counts / self.counts_per_turn * self.units_per_turn

    def _time(self, what: str, seconds: float) -> float:
        """A time that one can wait. Raises `LimitExceeded` for others, `TypeError` for what is no number."""
        return positive(f"{self.name}: {what} (s)", seconds)

    def _check_limits(self, position: float) -> None:
        """Raise `LimitExceeded` for a position that the axis' limits do not allow."""
        half = self.units_per_turn / self.counts_per_turn / 2
        if self.limits is not None and not self.limits[0] - half <= position <= self.limits[1] + half:
            low, high = self.limits
            raise LimitExceeded(f"{self.name}: position {position:g} is outside its limits {low:g}..{high:g}.")

    def _target(self, position: float, reach: tuple[int, int] | None = None) -> int:
        """A position in counts. Raises `LimitExceeded` where the limits or the drive's register do not allow it."""
        self._check_limits(position)
        lowest, highest = self.target_range if reach is None else reach
        if not math.isfinite(position) or not lowest <= (counts := self._to_counts(position)) <= highest:
            ends = sorted((self._to_units(lowest), self._to_units(highest)))
            raise LimitExceeded(
                f"{self.name}: position {position:.10g} is outside {ends[0]:.10g}..{ends[1]:.10g}, which is what the "
                "drive can be told. Go there in steps, each from a new zero: set_zero()."
            )
        return counts

    def _new_move(self, what: str, target: float | None) -> Move:
        self.check_ready()
        return Move(f"{what} of {self.name}", target, self.position, self._cancel_move, self._unseen)

    def _order(self, what: str, carry_out: Callable[[], Awaitable[T]]) -> Handle[T]:
        """Queue a command that is no move."""
        self.check_ready()
        handle: Handle[T] = Handle(f"{what} of {self.name}", self._unseen)
        self._orders.add(handle, carry_out)
        return handle

    def check_ready(self) -> None:
        """Raise what keeps the axis from taking another command."""
        self.check_open()
        if self.bus.closing:
            raise BusClosed(f"{self.name}: the bus is being closed. Nothing is set in motion any more.")
        if not self.bus.connected:
            raise NotSent(
                f"{self.name}: the port is lost. What is asked for now would happen whenever it is there again: wait "
                "for bus.connected, then ask again."
            )
        if self.bus.latched:
            raise EmergencyStopped(
                f"{self.name}: the bus is latched by an emergency stop. clear_emergency_stop(), then enable() the axis."
            )
        self._orders.check()

    def _starts_from(self, counts: int) -> float:
        """Where a relative move starts: at the last target if that was reached, else where the axis stands."""
        if self._commanded is None:
            return self._to_units(counts)
        exact = self._exact
        return (
            exact
            if exact is not None and self._to_counts(exact) == self._commanded
            else self._to_units(self._commanded)
        )

    def _go(self, pace: MotionParameters, goal: MoveTarget) -> Move:
        move = self._new_move(goal.what, goal.target)
        self._planned = goal.planned
        self._orders.add(move, lambda: self._move(move, goal, pace))
        return move

    async def _move(self, move: Move, goal: MoveTarget, pace: MotionParameters) -> float:
        def target(look: Look) -> int:
            move.target = goal.position(look.position)
            return self._target(move.target, goal.reach)

        look = await self._carry_out(move, target, pace)
        self._exact = move.target
        if isinstance(move, GroupMemberMove):
            await self._stay(move, look)
        return self._to_units(look.position)

    async def _run(
        self, move: Move, rpm: float, pace: MotionParameters, duration: float | None, ticks: int | None
    ) -> float:
        await self._carry_out_run(move, rpm, pace, duration, ticks)
        return await self.position()

    def _cancel_move(self, move: Move) -> None:
        self.bus.check_thread()
        cancelled = MoveCancelled(f"{move.what} was cancelled.")
        self._forget_plans()
        if not self._orders.remove(move, cancelled) and self._orders.current is move:
            move.fail(cancelled)
            self.stop()

    def _unseen(self, handle: Handle[Any]) -> None:
        if not isinstance(handle.error, MoveCancelled):
            self.bus.unseen(handle)

    def _forget_plans(self) -> None:
        self._planned = None


def _limits(limits: tuple[float, float]) -> tuple[float, float]:
    low, high = (real("each of limits", end) for end in pair("limits", limits, "a pair of numbers: (lowest, highest)"))
    if low > high:
        raise ValueError(f"limits {limits} are the wrong way round: (lowest, highest)")
    return low, high


Axis = FormerAxis
