"""`rs485bus group`: one verb for axes that move together."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rs485bus.cli.axis import enabled, home, tell_failure, tell_interruption
from rs485bus.cli.process import DONE, WrongUse, console
from rs485bus.cli.session import Where, open_plant
from rs485bus.plant import Plant, PlantFile
from rs485bus.plant.problems import instead

VERBS = ("status", "enable", "disable", "home", "move-to", "move-by", "stop", "zero")
_WITH_VALUES = ("move-to", "move-by")
_MOVES = ("home", "move-to", "move-by")


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupOrder:
    """What a group is to do."""

    verb: str
    values: list[float] = field(default_factory=list)
    rpm: float | None = None
    duration: float | None = None

    def check(self, name: str, file: PlantFile) -> tuple[str, ...]:
        """Refuse what cannot be meant. Returns the axes of the group. Raises `WrongUse`."""
        if name not in file.groups:
            how = "" if file.groups else f' A plant file says which there are: [groups.{name}], axes = ["x", "y"].'
            raise WrongUse(f"There is no group {name!r}{instead(name, file.groups)}{how}")
        axes = file.groups[name].axes
        if self.verb not in VERBS:
            raise WrongUse(f"There is no verb {self.verb!r}. There is: {', '.join(VERBS)}.")
        wanted = len(axes) if self.verb in _WITH_VALUES else 0
        if len(self.values) != wanted:
            numbers = f"{wanted} numbers, for {', '.join(axes)}" if wanted else "no number"
            raise WrongUse(f"{self.verb} of {name} takes {numbers}; {len(self.values)} were given.")
        if self.verb not in _WITH_VALUES and (self.rpm is not None or self.duration is not None):
            raise WrongUse(f"{self.verb} takes neither --rpm nor --duration.")
        return axes


async def run_group(where: Where, name: str, order: GroupOrder, as_json: bool) -> int:
    """Carry one order out and say what came of it. Returns the exit code."""
    axes = order.check(name, where.file())
    try:
        result = await _carry_out(where, name, axes, order)
    except asyncio.CancelledError as cancelled:
        if as_json:
            tell_interruption({"group": name, "verb": order.verb}, cancelled)
        raise
    except Exception as error:
        if as_json:
            return tell_failure({"group": name, "verb": order.verb}, error)
        raise
    if as_json:
        print(json.dumps({"group": name, "verb": order.verb, "done": True, **result}))
    else:
        for axis, position in result["positions"].items():
            console().print(f"{axis}: {position['position']:g} {position['unit']}")
        if "skew_ms" in result:
            console().print(f"They started within {result['skew_ms']:g} ms of each other.")
    return DONE


async def _carry_out(where: Where, name: str, axes: tuple[str, ...], order: GroupOrder) -> dict[str, Any]:
    async with open_plant(where, watchdogs=order.verb in _MOVES) as plant:
        members = {axis: plant.axes[axis] for axis in axes}
        if order.verb in (*_MOVES, "enable"):
            for axis, member in members.items():
                await enabled(member, axis, plant.file.axes[axis])
        told: dict[str, Any] = {}
        if order.verb in _WITH_VALUES:
            group = plant.groups[name]
            go = group.move_to if order.verb == "move-to" else group.move_by
            move = go(**dict(zip(axes, order.values, strict=True)), duration=order.duration, rpm=order.rpm)
            await move
            if move.skew is not None:
                told["skew_ms"] = round(1000 * move.skew, 1)
        else:
            await _each(order.verb, members)
        return {"positions": await _positions(plant, axes), **told}


async def _each(verb: str, members: Mapping[str, Any]) -> None:
    """Have each axis do the same, all at once."""
    acts: dict[str, Callable[[Any], Any]] = {
        "home": home,
        "disable": lambda axis: axis.disable(),
        "stop": lambda axis: axis.stop(),
        "zero": lambda axis: axis.set_zero(),
    }
    if verb in acts:
        async with asyncio.TaskGroup() as tasks:
            for handle in [acts[verb](axis) for axis in members.values()]:
                tasks.create_task(handle.wait())


async def _positions(plant: Plant, axes: tuple[str, ...]) -> dict[str, Any]:
    return {
        axis: {"position": round(await plant.axes[axis].position(), 6), "unit": plant.file.axes[axis].unit}
        for axis in axes
    }
