"""Axes that move together: of any family, on one bus or on several."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Generator, Mapping, Sequence
from typing import Any, Generic, Never, TypeVar

from rs485bus.arguments import elsewhere, function, positive
from rs485bus.bus.handle import Handle
from rs485bus.errors import BusError, LimitExceeded, MoveCancelled, NotSupported
from rs485bus.motion.group.execution import GroupExecution, Wish
from rs485bus.motion.group.member import GroupAxis, GroupMember
from rs485bus.motion.group.several import first_failure, named, when_all_have_ended
from rs485bus.motion.group.streams import GroupStream, StreamAxis
from rs485bus.motion.move import Cancellable, Move, MoveState, MoveTarget, positions_until

T = TypeVar("T")

_RESERVED = ("duration", "rpm")
_IN_ORDER = (MoveState.QUEUED, MoveState.STARTING, MoveState.MOVING)


class GroupMove(Cancellable[dict[str, float]]):
    """A move of several axes. Awaiting it gives the position that each has reached, by name, in its units.

    Where one of them fails, faults, stops answering or is stopped, all others are stopped before anybody is told. It
    raises what the one has failed of, with its name; those that were stopped raise `MoveCancelled`.

    `async with` waits for it at the end of the block, and stops all its axes if the block is left by an exception.
    """

    def __init__(self, axes: Mapping[str, GroupAxis], goals: Mapping[str, MoveTarget], wish: Wish) -> None:
        self._root: str | None = None
        """Who failed first."""
        super().__init__(f"move of the group {', '.join(axes)}", self._report)
        self._axes = axes
        self._execution = GroupExecution(
            {name: axis.member for name, axis in axes.items()}, goals, wish, self.finish, self._failed
        )
        self._waits_for.append(self.moves.values)
        for move in self.moves.values():
            move._waits_for.append(self.moves.values)

    @property
    def seen(self) -> bool:
        """Its failure was raised to somebody: its own, or the one that it comes from."""
        return self._seen or (self._root is not None and self.moves[self._root].seen)

    @seen.setter
    def seen(self, seen: bool) -> None:
        self._seen = seen
        if seen:
            for move in self.moves.values():
                move.seen = True

    @property
    def moves(self) -> Mapping[str, Move]:
        """The part of each axis, by name."""
        return self._execution.moves

    @property
    def eta(self) -> float | None:
        """When all should have arrived, on the event loop's clock; None before that is known."""
        etas = [move.eta for move in self.moves.values() if move.eta is not None]
        return max(etas) if len(etas) == len(self.moves) else None

    @property
    def state(self) -> MoveState:
        """How far it has come: as far as the part that is furthest behind, until it has ended."""
        if self.done():
            failed = MoveState.CANCELLED if isinstance(self.error, MoveCancelled) else MoveState.FAILED
            return MoveState.DONE if self.error is None else failed
        states = {move.state for move in self.moves.values()}
        return next((state for state in _IN_ORDER if state in states), MoveState.MOVING)

    @property
    def started_at(self) -> float | None:
        """When the first of the frames that start it was sent, on the event loop's clock; None before that."""
        return min(self._starts(), default=None)

    @property
    def skew(self) -> float | None:
        """Seconds between the first and the last frame that started one of them; None before all have started. Where it
        has failed, of those that had started, if there were two."""
        starts = self._starts()
        return max(starts) - min(starts) if len(starts) >= (2 if self.done() else len(self.moves)) else None

    def _starts(self) -> list[float]:
        begun = [move.started_at for move in self.moves.values() if move.state is not MoveState.STARTING]
        return [at for at in begun if at is not None]

    async def positions(self, every: float = 0.1) -> AsyncIterator[dict[str, float]]:
        """Where the axes are, by name, every so many seconds until the move has ended; last, where it ended.

        Raises:
            RequestFailed, MotionError: what the move raises.
        """
        async for at in positions_until(self, self._ask_positions, every):
            yield at

    async def _ask_positions(self) -> dict[str, float]:
        asked = await asyncio.gather(*(axis.position() for axis in self._axes.values()))
        return dict(zip(self._axes, asked, strict=True))

    def cancel(self) -> None:
        """End it: what waits leaves the queues, what is under way is stopped. It raises `MoveCancelled`."""
        for axis in self._axes.values():
            axis.bus.check_thread()
        if not self.done():
            self._execution.cancel(MoveCancelled(f"{self.what} was cancelled."))

    async def wait(self) -> dict[str, float]:
        """Wait until all have arrived.

        Raises:
            RequestFailed, MotionError: why the first one failed, and which.
        """
        return await super().wait()

    def _failed(self, who: str | None, error: Exception) -> None:
        self._root = who
        self.fail(named(who, error, {name: axis.member for name, axis in self._axes.items()}))

    def _report(self, handle: Handle[Any]) -> None:
        if self._root is not None and not isinstance(self.error, MoveCancelled):
            self._axes[self._root].bus.unseen(handle)


class HandleOfSeveral(Generic[T]):
    """One command of each axis of a group. Awaiting it gives what comes of each, by name.

    Args:
        parts: the commands, by name.
    """

    def __init__(self, parts: Mapping[str, Handle[T]]) -> None:
        self.parts = parts

    def __repr__(self) -> str:
        return f"<{', '.join(f'{name}: {part!r}' for name, part in self.parts.items())}>"

    def done(self) -> bool:
        """Whether all have ended, well or not."""
        return all(part.done() for part in self.parts.values())

    @property
    def error(self) -> Exception | None:
        """Why it failed, once all have ended: of one that was cancelled only where no other failed."""
        return first_failure(self.parts.values())

    def add_done_callback(self, callback: Callable[[HandleOfSeveral[T]], object]) -> None:
        """Have `callback` called with this once all have ended, as `Handle.add_done_callback`."""
        function("callback", callback)
        when_all_have_ended(self.parts.values(), lambda: callback(self))

    async def wait(self) -> dict[str, T]:
        """Wait for all to end.

        Raises:
            RequestFailed, MotionError: why the first one failed, and which; it is awaited in the block of a stream that
                comes before one of them.
        """
        for part in self.parts.values():
            part._check_wait()
        ended = await asyncio.gather(*(part.wait() for part in self.parts.values()), return_exceptions=True)
        results, failed = {}, []
        for name, result in zip(self.parts, ended, strict=True):
            if isinstance(result, BaseException):
                failed.append((name, result))
            else:
                results[name] = result
        if failed:
            name, error = min(failed, key=lambda entry: isinstance(entry[1], MoveCancelled))
            raise named(name, error) from error
        return results

    def __await__(self) -> Generator[Any, None, dict[str, T]]:
        return self.wait().__await__()


class AxisGroup:
    """Axes that move together, each by a name of its own.

    Args:
        axes: the axes. They may be of any families, and on several buses of one event loop.

    Raises:
        ValueError: there is none, one has two names, or a name is taken.
        TypeError: something is no axis.
    """

    def __init__(self, *unnamed: Never, **axes: GroupAxis) -> None:
        if unnamed:
            raise TypeError("each axis of a group has a name: AxisGroup(x=x, y=y), or bus.group(x=x, y=y)")
        if not axes:
            raise ValueError("a group needs axes: AxisGroup(x=..., y=...)")
        names: dict[GroupAxis, str] = {}
        for name, axis in axes.items():
            if not isinstance(axis, GroupAxis):
                raise TypeError(
                    f"{name} is {axis!r}, and no axis"
                    f"{elsewhere(axis) or '. Of what has several, name one by one: left=base.left, ...'}"
                )
            if name in _RESERVED:
                raise ValueError(f"{name} says how fast a group moves; give {axis.name} another name")
            if axis in names:
                raise ValueError(f"{names[axis]} and {name} are one axis, {axis.name}: give it one name")
            axis.bus.check_thread()
            names[axis] = name
        self.axes: Mapping[str, GroupAxis] = dict(axes)

    def __repr__(self) -> str:
        return f"<group {', '.join(f'{name}={axis.name}' for name, axis in self.axes.items())}>"

    # Moves

    def move_to(self, *, duration: float | None = None, rpm: float | None = None, **positions: float) -> GroupMove:
        """Send axes to positions: they start together and arrive together. Those that are not named stay out of it.

        Each gets the speed and, where steps of that are too coarse, the ramp with which it takes as long as all; ramps
        are never quicker than the axis' own `acceleration`. It is one command in the queue of each, and begins when all
        have come to it.

        Args:
            duration: seconds; None for as long as the slowest needs at its own `rpm`, or at the one given. An axis with
                so short a way that it cannot be so slow then arrives earlier.
            rpm: the highest speed of any of them, above 0.
            positions: where to go, by name, in the units of each axis.

        Raises:
            LimitExceeded: a position, a speed or the duration is out of what an axis can do; nothing is queued. What
                duration an axis can do depends on where it starts: where that is not known yet, it is raised when the
                move is awaited, and nothing has moved.
            ValueError: a name is none of the group, or none is given.
            TypeError: something is no number.
        """
        return self._go(positions, lambda member, to: member.goal_to(to), duration, rpm)

    def move_by(self, *, duration: float | None = None, rpm: float | None = None, **distances: float) -> GroupMove:
        """Send axes a distance each. Arguments and errors as for `move_to`."""
        return self._go(distances, lambda member, by: member.goal_by(by), duration, rpm)

    def stream(self, *, timeout: float = 0.25, acceleration: float | None = None) -> GroupStream:
        """Turn all axes at speeds that are told as they come: `async with group.stream() as setpoint:
        setpoint(x=90.0, y=-30.0)`. Where one axis fails, all are stopped.

        Args:
            timeout: seconds after which a set-point is too old.
            acceleration: the ramps of all, in rpm/s; None for each axis' own.

        Raises:
            NotSupported: one of them cannot be told speeds in a stream.
            LimitExceeded, TypeError: an argument is out of its range, or no number.
        """
        able = {name: axis for name, axis in self.axes.items() if isinstance(axis, StreamAxis)}
        if len(able) < len(self.axes):
            names = ", ".join(axis.name for name, axis in self.axes.items() if name not in able)
            raise NotSupported(f"{names} cannot be told speeds in a stream.")
        streams = {name: axis.stream(timeout=timeout, acceleration=acceleration) for name, axis in able.items()}
        return GroupStream(able, streams, {name: axis.member for name, axis in self.axes.items()})

    def home(self) -> HandleOfSeveral[float]:
        """Find the origins of all axes, at once, each as its drive is set up for. All are waited for.

        Raises:
            NotSupported: one has no origin to find, as wheels have none: `set_zero()` it. Nothing is queued.
        """
        homes: dict[str, Callable[[], Handle[float]]] = {}
        for name, axis in self.axes.items():
            home = getattr(axis, "home", None)
            if home is None:
                raise NotSupported(f"{name}: {axis.name} has no origin to find. set_zero() it where its zero is to be.")
            homes[name] = home
        return self._all(homes)

    # Other verbs

    def enable(self) -> HandleOfSeveral[None]:
        """Energise all motors, as `Axis.enable`."""
        for axis in self.axes.values():
            axis.forgive()
        return self._all({name: axis.enable for name, axis in self.axes.items()})

    def disable(self) -> HandleOfSeveral[None]:
        """Let go of all shafts, as `Axis.disable`."""
        return self._all({name: axis.disable for name, axis in self.axes.items()})

    def stop(self) -> HandleOfSeveral[None]:
        """Stop all axes, with their ramps; see them stand, and drop what is queued. It happens at once."""
        return HandleOfSeveral({name: _asked(axis, axis.stop) for name, axis in self.axes.items()})

    def emergency_stop(self) -> HandleOfSeveral[None]:
        """Stop all axes as fast as their drives can; see them stand, and drop what is queued."""
        return HandleOfSeveral({name: _asked(axis, axis.emergency_stop) for name, axis in self.axes.items()})

    # Questions

    async def positions(self) -> dict[str, float]:
        """Where each axis is, in its units."""
        asked: Sequence[Awaitable[float]] = [axis.position() for axis in self.axes.values()]
        return dict(zip(self.axes, await asyncio.gather(*asked), strict=True))

    # Inside

    def _all(self, commands: Mapping[str, Callable[[], Handle[T]]]) -> HandleOfSeveral[T]:
        """Give a command to each axis, or to none where one does not take it."""
        for axis in self.axes.values():
            axis.check_ready()
        return HandleOfSeveral({name: command() for name, command in commands.items()})

    def _go(
        self,
        places: Mapping[str, float],
        goal: Callable[[GroupMember, float], MoveTarget],
        duration: float | None,
        rpm: float | None,
    ) -> GroupMove:
        if not places:
            raise ValueError(f"say where the axes are to go, by name: {', '.join(self.axes)}")
        for name in places:
            if name not in self.axes:
                raise ValueError(f"{name} is none of the axes of this group: {', '.join(self.axes)}")
        axes = {name: self.axes[name] for name in places}
        wish = Wish(
            None if duration is None else positive("duration (s)", duration),
            None if rpm is None else positive("rpm", rpm),
        )
        goals = {}
        for name, axis in axes.items():
            axis.check_ready()
            try:
                member = axis.member
                wish.check_speed(member)
                goals[name] = goal(member, places[name])
                start, end = member.planned, goals[name].planned
                if start is not None and end is not None:
                    wish.check(member, member.way(start, end))
            except (LimitExceeded, TypeError) as error:
                raise named(name, error) from None
        return GroupMove(axes, goals, wish)


def _asked(axis: GroupAxis, stop: Callable[[], Handle[None]]) -> Handle[None]:
    """A stop, or what keeps it from being one: the other axes are stopped all the same."""
    axis.bus.check_thread()
    try:
        return stop()
    except BusError as error:
        handle: Handle[None] = Handle(f"stop of {axis.name}", axis.bus.unseen)
        handle.fail(error)
        return handle
