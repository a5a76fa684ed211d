"""Axes of one drive that carry out one command: they begin together, and one frame sets them in motion."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rs485bus.bus.handle import Handle
from rs485bus.motion.carrier import PlanCarrier
from rs485bus.motion.group.barrier import Barrier
from rs485bus.motion.move import Task
from rs485bus.motion.plan import Plan

PlanOfAll = Callable[[Mapping[int, Any]], Plan[None]]
"""Makes the plan from what each axis is to do, by axis."""


@dataclass(frozen=True, slots=True)
class Part:
    """What one axis is to do."""

    carrier: PlanCarrier
    task: Task
    wanted: Any
    """In the family's terms."""
    plan: PlanOfAll


class Joint(Barrier[int]):
    """Some axes of a drive, by their numbers.

    Args:
        axes: which ones.
        drop: ends an axis' part of the command, because another one's failed.
    """

    def __init__(self, axes: tuple[int, ...], drop: Callable[[int], None]) -> None:
        super().__init__(axes)
        self._drop = drop
        self._in = set(axes)

    def join(self, axis: int, part: Handle[Any]) -> None:
        """An axis' part of the command. Where it fails, however it does, it takes the others along."""
        part.add_done_callback(lambda ended: self._leave(axis, ended.error is not None))

    async def gather(self, axis: int) -> None:
        """Wait until all have come to it, in their queues."""
        await self.meet(axis, None, _nothing)

    async def once(self, axis: int, act: Callable[[], Awaitable[None]]) -> None:
        """Have something done once, as soon as all have come to it."""
        await self.meet(axis, None, lambda _: act())

    async def set_off(self, axis: int, part: Part) -> None:
        """Have the axes set in motion by one plan, as soon as all are ready for it."""
        await self.meet(axis, part, _set_off)

    def _leave(self, axis: int, failed: bool) -> None:
        self._in.discard(axis)
        if failed:
            others, self._in = self._in, set()
            for other in others:
                self._drop(other)


async def _set_off(parts: dict[int, Part]) -> None:
    first, *others = parts.values()
    first.task.partners = tuple((part.carrier, part.task) for part in others)
    wanted = {axis: part.wanted for axis, part in sorted(parts.items())}
    await first.carrier.carry(lambda: first.plan(wanted), first.task)


async def _nothing(_: object) -> None:
    """They only meet."""
