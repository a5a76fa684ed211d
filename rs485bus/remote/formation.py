"""Axes of several served plants that move together: they start at a common time."""

from __future__ import annotations

import asyncio
import copy
from collections.abc import Mapping
from typing import TypeVar

from rs485bus.arguments import positive, real
from rs485bus.bus.handle import Handle, start_task
from rs485bus.errors import BusError, MoveCancelled
from rs485bus.motion.profile import Profile
from rs485bus.remote.axis import RemoteAxis
from rs485bus.remote.handles import RemoteMove
from rs485bus.remote.plant import RemotePlant

_LEAD = 0.2
"""Seconds before the start by which all plants should know of it."""
_SLACK = 1.1
"""By how much a move takes longer than it could, where no duration is given."""

E = TypeVar("E", bound=BaseException)


class FormationMove(Handle[dict[str, float]]):
    """A move of axes of several plants. Awaiting it gives the position that each has reached, by name."""

    skew: float | None = None
    """Seconds between the first and the last frame that started one of them, as far as the clocks tell; known at its
    end."""
    uncertainty: float | None = None
    """By how many seconds `skew` may be wrong: what is not known of the clocks."""


class Formation:
    """Axes of several plants, each by a name of its own.

    They start at a common time, by what is known of the clocks, and take equally long. Where one fails, the others are
    stopped, and are seen to stand or their stop is on its way, before anybody is told.

    Args:
        axes: of each its plant, and itself.

    Raises:
        ValueError: there is none.
    """

    def __init__(self, **axes: tuple[RemotePlant, RemoteAxis]) -> None:
        if not axes:
            raise ValueError("a formation needs axes: Formation(x=(cell, cell.x), y=(other, other.y))")
        self._axes = axes
        self._moves: set[asyncio.Task[None]] = set()

    def move_to(self, *, duration: float | None = None, **positions: float) -> FormationMove:
        """Send axes to positions; they start and arrive together.

        Args:
            duration: seconds; None for as long as the slowest needs at its usual speed, and a tenth more.
            positions: where to go, by name, in the units of each axis.

        Raises:
            ValueError: a name is none of the formation, or none is given; a duration that is none.
            LimitExceeded: when it is awaited: an axis cannot go there, or not in that time. What has moved was stopped.
        """
        if not positions:
            raise ValueError(f"say where the axes are to go, by name: {', '.join(self._axes)}")
        for name, position in positions.items():
            if name not in self._axes:
                raise ValueError(f"{name} is none of the axes of this formation: {', '.join(self._axes)}")
            real(name, position)
        if duration is not None:
            positive("duration (s)", duration)
        move = FormationMove(f"move of the formation {', '.join(positions)}")
        task = start_task(self._carry_out(move, positions, duration))
        self._moves.add(task)
        task.add_done_callback(self._moves.discard)
        return move

    async def _carry_out(self, move: FormationMove, positions: Mapping[str, float], duration: float | None) -> None:
        try:
            seconds = duration or await self._takes(positions)
            parts = await self._start(positions, seconds)
            try:
                results = await self._wait(parts)
            finally:
                self._measure(move, parts)
        except Exception as error:
            move.fail(error)
        except asyncio.CancelledError:
            move.fail(MoveCancelled(f"{move.what}: the event loop ended."))
            raise
        else:
            move.finish(results)

    async def _takes(self, positions: Mapping[str, float]) -> float:
        """Seconds that the slowest needs, and some more."""
        longest = 0.0
        for name, position in positions.items():
            _, axis = self._axes[name]
            facts = axis.facts
            turns = abs(position - await axis.position()) / facts.units_per_turn
            longest = max(longest, Profile(turns, facts.rpm, facts.acceleration).duration)
        return max(0.1, longest * _SLACK)

    async def _start(
        self, positions: Mapping[str, float], duration: float
    ) -> dict[RemotePlant, tuple[dict[str, str], RemoteMove[dict[str, float]]]]:
        """Tell each plant its part. Returns them, with the name of each axis there and here."""
        there: dict[RemotePlant, dict[str, str]] = {}
        for name in positions:
            plant, axis = self._axes[name]
            there.setdefault(plant, {})[axis.name] = name
        for plant, names in there.items():
            await plant.cover(*names)
        start = asyncio.get_running_loop().time() + _LEAD + max(plant.clock_offset()[1] for plant in there)
        parts = {}
        for plant, names in there.items():
            places = {axis: positions[name] for axis, name in names.items()}
            at = start + plant.clock_offset()[0]
            parts[plant] = (names, plant.move_to(duration=duration, at=at, **places))
        return parts

    async def _wait(
        self, parts: Mapping[RemotePlant, tuple[dict[str, str], RemoteMove[dict[str, float]]]]
    ) -> dict[str, float]:
        waiting = {asyncio.ensure_future(part.wait()): plant for plant, (_, part) in parts.items()}
        done, others = await asyncio.wait(waiting, return_when=asyncio.FIRST_EXCEPTION)
        failed = next((future for future in done if future.exception() is not None), None)
        if failed is None:
            return {
                names[axis]: place
                for future, plant in waiting.items()
                for names in (parts[plant][0],)
                for axis, place in future.result().items()
            }
        stops = [
            plant.axes[axis].stop() for future in others for plant in (waiting[future],) for axis in parts[plant][0]
        ]
        await asyncio.gather(*(stop.wait() for stop in stops), *others, return_exceptions=True)
        error = failed.exception()
        assert error is not None
        raise _named(waiting[failed].name, error)

    @staticmethod
    def _measure(
        move: FormationMove, parts: Mapping[RemotePlant, tuple[dict[str, str], RemoteMove[dict[str, float]]]]
    ) -> None:
        """How far apart they were started, by each service's clock and what is known of that."""
        starts, wrong = [], []
        for plant, (_, part) in parts.items():
            if part.started is None:
                return
            offset, uncertainty = plant.clock_offset()
            starts += [part.started - offset, part.started - offset + (part.spread or 0.0)]
            wrong.append(uncertainty)
        move.skew = max(starts) - min(starts)
        move.uncertainty = sum(sorted(wrong)[-2:]) if len(wrong) > 1 else 0.0


def _named(plant: str, error: E) -> E:
    """The same error, saying which plant it is of."""
    if not isinstance(error, BusError):
        return error
    named = copy.copy(error)
    named.args = (f"{plant}: {error}",)
    named.__cause__ = error
    return named
