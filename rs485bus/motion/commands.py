"""What is queued on one axis: each command with its handle, and where the queue will have taken the axis."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.errors import LimitExceeded, MotionError, MoveCancelled
from rs485bus.motion.drive import Drive
from rs485bus.motion.executor import MoveExecutor
from rs485bus.motion.group.member import GroupCoordinator, GroupMemberMove
from rs485bus.motion.move import Move, MoveState, MoveTarget
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Plan
from rs485bus.motion.retargeting import Change
from rs485bus.motion.runs import RunExecutor
from rs485bus.motion.scale import AxisScale
from rs485bus.motion.stop_control import StopControl

T = TypeVar("T")

_log = logging.getLogger("rs485bus")


class AxisCommands:
    """Queues the commands of one axis.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        name: names it in messages.
        scale: its units.
        stops: stops it, and has its queue.
        executor: carries out its moves.
        runs: carries out its runs.
        position: asks where it is, in its units.
        check_ready: raises what keeps it from taking another command.
    """

    def __init__(
        self,
        bus: Bus,
        drive: Drive,
        name: str,
        scale: AxisScale,
        stops: StopControl,
        executor: MoveExecutor,
        runs: RunExecutor,
        position: Callable[[], Awaitable[float]],
        check_ready: Callable[[], None],
    ) -> None:
        self.planned: float | None = None
        """Where the queue will have taken it, in units, if that is known."""
        self._bus = bus
        self._drive = drive
        self._name = name
        self._scale = scale
        self._stops = stops
        self._queue = stops.queue
        self._executor = executor
        self._run_executor = runs
        self._position = position
        self._check_ready = check_ready
        self._runs: list[Move] = []
        """Those that another one may replace."""
        self._is_warned = False
        """It was said that nothing watches its drive."""
        self._exact: float | None = None
        """Where the last move went, in units, before that was rounded to counts."""

    # Where a move goes

    def goal_to(self, position: float) -> MoveTarget:
        """A position, in units, as somewhere to go. Raises `LimitExceeded`."""
        position = self._scale.number("position", position)
        self._scale.target(position)
        reach = self._scale.ability.target_range
        return MoveTarget(f"move to {position:g}", position, position, lambda _: position, reach)

    def goal_by(self, distance: float) -> MoveTarget:
        """A distance, in units, as somewhere to go. Raises `LimitExceeded`."""
        distance, ability = self._scale.number("distance", distance), self._scale.ability
        reach, longest = ability.reach, ability.longest
        if abs(self._scale.to_counts(distance)) > longest:
            raise LimitExceeded(
                f"{self._name}: a way of {distance:g} is longer than {longest} counts, which is what the drive can be "
                "told. Go it in several moves, each from a new zero: set_zero()."
            )
        planned = None if self.planned is None else self.planned + distance
        if planned is not None:
            self._scale.target(planned, reach)
        return MoveTarget(f"move by {distance:g}", None, planned, lambda at: self._starts_from(at) + distance, reach)

    def way(self, start: float, end: float) -> float:
        """How many turns it is from one position, in units, to another; 0 where these are the same to the drive."""
        counts = abs(self._scale.to_counts(end) - self._scale.to_counts(start))
        return counts / self._scale.ability.counts_per_turn if counts > self._executor.tolerance else 0.0

    def _starts_from(self, counts: int) -> float:
        """Where a relative move starts: at the last target if that was reached, else where the axis stands."""
        commanded, exact, scale = self._executor.commanded, self._exact, self._scale
        if commanded is None:
            return scale.to_units(counts)
        return exact if exact is not None and scale.to_counts(exact) == commanded else scale.to_units(commanded)

    # Commands that are no moves

    def order(self, what: str, carry_out: Callable[[], Awaitable[T]]) -> Handle[T]:
        """Queue a command that is no move."""
        self._check_ready()
        handle: Handle[T] = Handle(f"{what} of {self._name}", self.unseen)
        self._queue.add(handle, carry_out)
        return handle

    def order_plan(self, what: str, plan: Callable[[], Plan[T]]) -> Handle[T]:
        """Queue a plan that sets nothing in motion."""
        return self.order(what, lambda: self._executor.carry(plan))

    # Moves

    def queue(
        self, what: str, target: float | None, planned: float | None, carry_out: Callable[[Move], Awaitable[float]]
    ) -> Move:
        """Queue a move.

        Args:
            what: names it in messages, before the name of the axis.
            target: where it goes, in units, as far as is known.
            planned: where the queue will have taken the axis then.
            carry_out: carries it out, and says where it ended, in units.
        """
        move = self._new_move(what, target)
        self.planned = planned
        self._queue.add(move, lambda: carry_out(move))
        return move

    def _new_move(self, what: str, target: float | None) -> Move:
        self._check_ready()
        return Move(f"{what} of {self._name}", target, self._position, self._cancel, self.unseen)

    async def move(self, move: Move, goal: MoveTarget, parameters: MotionParameters) -> float:
        """Carry out a move to somewhere; where it ended."""

        def target(start: int) -> int:
            move.target = goal.position(start)
            return self._scale.target(move.target, goal.reach)

        position = await self._executor.move(move, target, parameters)
        self._exact = move.target
        return self._scale.to_units(position)

    def go_by_plan(
        self,
        what: str,
        parameters: MotionParameters,
        target_from: Callable[[int], int],
        plan: Callable[[int, MotionParameters], Plan[None]],
    ) -> Move:
        """Queue a move to counts, which is told the drive by a plan of its own."""

        async def carry_out(move: Move) -> float:
            def target(start: int) -> int:
                counts = target_from(start)
                move.target = self._scale.to_units(counts)
                self._scale.check_limits(move.target)
                return counts

            return self._scale.to_units(await self._executor.move(move, target, parameters, plan))

        return self.queue(what, None, None, carry_out)

    def seek(
        self, what: str, plan: Callable[[], Plan[None]], *, by_reference: bool = False, at_zero: bool = True
    ) -> Move:
        """Queue a routine of the drive's own that ends at zero, or where the drive then says."""
        planned = 0.0 if at_zero else None

        async def carry_out(move: Move) -> float:
            counts = await self._executor.seek(move, plan, by_reference=by_reference, at_zero=at_zero)
            move.target = 0.0 if at_zero else self._scale.to_units(counts)
            return move.target

        return self.queue(what, planned, planned, carry_out)

    def join(
        self,
        goal: MoveTarget,
        who: str,
        coordinator: GroupCoordinator,
        carry_out: Callable[[Move], Awaitable[float]],
    ) -> GroupMemberMove:
        """Queue a move that is made together with others, and of which they say how fast it is."""
        what = f"{goal.what} of {self._name}"
        move = GroupMemberMove(what, goal.target, self._position, self._cancel, who, coordinator)
        self.planned = goal.planned

        async def together() -> float:
            await move.gathered()
            return await carry_out(move)

        self._queue.add(move, together)
        return move

    def retarget(self, position: float, parameters: MotionParameters) -> Handle[None]:
        """Send the move under way elsewhere. Raises `MotionError` where there is none that can be."""
        position = self._scale.number("position", position)
        target = self._scale.target(position)
        under_way = self._executor.changeable
        if under_way is None or under_way.state is not MoveState.MOVING:
            raise MotionError(f"{self._name}: no move_to() or move_by() is under way that could be changed.")
        handle: Handle[None] = Handle(f"change of the target of {self._name}", self.unseen)
        self._executor.change(Change(handle, position, target, parameters))
        self.planned = None
        return handle

    # Runs

    def run(self, rpm: float, carry_out: Callable[[Move], Awaitable[float]], *, timed: bool, replace: bool) -> Move:
        """Queue a run; one that is not `timed` may be replaced by another one."""
        move = self._new_move(f"run at {rpm:g} rpm", None)
        self.planned = None
        self.warn_unwatched()
        if replace:
            self._replace_runs()
        self._runs = [run for run in self._runs if not run.done()]
        if not timed:
            self._runs.append(move)
        self._queue.add(move, lambda: carry_out(move))
        return move

    def _replace_runs(self) -> None:
        """Wait no longer for the runs that were asked for before."""
        for run in self._runs:
            if self._queue.current is run:
                self._run_executor.overtake()
            else:
                self._queue.remove(run, MoveCancelled(f"{run.what} was replaced before it began."))

    def warn_unwatched(self) -> None:
        """Warn once where nothing stops the motor if this program dies."""
        if self._drive.watchdog is None and not self._is_warned:
            self._is_warned = True
            _log.warning(
                "%s has no watchdog: nothing stops it if this program dies while it runs. Have a safety relay cut its "
                "power that something else watches",
                self._name,
            )

    # Their ends

    def _cancel(self, move: Move) -> None:
        self._bus.check_thread()
        cancelled = MoveCancelled(f"{move.what} was cancelled.")
        self.planned = None
        if not self._queue.remove(move, cancelled) and self._queue.current is move:
            move.fail(cancelled)
            self._stops.stop_now(emergency=False)

    def unseen(self, handle: Handle[Any]) -> None:
        """A command failed, and nobody has seen it yet."""
        if not isinstance(handle.error, MoveCancelled):
            self._bus.unseen(handle)
