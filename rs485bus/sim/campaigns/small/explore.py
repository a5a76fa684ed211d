"""Breadth first from the empty world, in parallel; what was found, and how many states that were.

python -m rs485bus.sim.small_worlds
python -m rs485bus.sim.small_worlds --world stop --depth 12 --processes 2
python -m rs485bus.sim.small_worlds --world stop --path 1T3LTA      # one path again, step by step
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import partial

from rs485bus.sim.campaigns.small.world import ACTIONS, WORLDS, World

_CHUNK = 500
_FINISHED = 8
"""Of so many states one is followed until everything has ended."""
_SHOWN = 20


@dataclass(slots=True)
class Explored:
    """What was found in one world."""

    name: str
    depth: int = 0
    states: int = 0
    tried: int = 0
    """Actions that were tried."""
    seconds: float = 0.0
    wrong: dict[str, str] = field(default_factory=dict)
    """What is wrong, and the shortest path that leads there."""

    def __str__(self) -> str:
        lines = [
            f"{self.name}: {self.states} states, {self.depth} actions deep, {self.tried} actions tried "
            f"in {self.seconds / 60:.1f} minutes; {len(self.wrong)} things wrong"
        ]
        lines += [f"    {what}: --world {self.name} --path {path}" for what, path in list(self.wrong.items())[:_SHOWN]]
        return "\n".join(lines)


def expand(name: str, paths: list[str], only: str = "") -> list[tuple[str, int, list[str]]]:
    """What follows each of some states: path, number, and what is wrong there. `only` says which actions are tried."""
    following = []
    for path in paths:
        at = World(name, path)
        actions = [action for action in at.actions() if not only or action in only]
        for action in actions:
            if action == actions[-1]:
                world = at  # nobody else needs it
                world.do(action)
            else:
                world = World(name, path + action)
            number = world.fingerprint()
            if not world.wrong and number % _FINISHED == 0:
                world.finish()
            following.append((path + action, number, world.wrong))
    return following


def explore(name: str, depth: int, processes: int = 1, most: int | None = None, only: str = "") -> Iterator[Explored]:
    """Go down level by level; tell after each.

    Args:
        name: the world.
        depth: how many actions deep.
        processes: how many work at it.
        most: end after so many states; None for no end.
        only: the actions that are tried; empty for all.
    """
    found, seen, level, begun = Explored(name), {World(name).fingerprint()}, [""], time.perf_counter()
    with ProcessPoolExecutor(processes) as pool:
        while level and found.depth < depth:
            chunks = [level[at : at + _CHUNK] for at in range(0, len(level), _CHUNK)]
            work = partial(expand, name, only=only)
            level = []
            for following in map(work, chunks) if processes == 1 else pool.map(work, chunks):
                for path, number, wrong in following:
                    found.tried += 1
                    for what in wrong:
                        found.wrong.setdefault(what, path)
                    if number not in seen and not wrong:
                        seen.add(number)
                        level.append(path)
                if most is not None and len(seen) >= most:
                    break
            found.depth += 1
            found.states, found.seconds = len(seen), time.perf_counter() - begun
            yield found
            if most is not None and len(seen) >= most:
                return


def show(name: str, path: str) -> None:
    """One path, step by step."""
    world = World(name)
    for action in path:
        world.do(action)
        print(f"{world.now - 1000:9.4f}  {action}  {ACTIONS[action]:60}  {'; '.join(world.wrong)}")
    world.finish()
    for at, one in enumerate(world.asked):
        if one is not None:
            print(f"job {at + 1}: {one.job.outcome} {one.job.reason}, sent {one.job.attempts} times")
    print("wrong:", *world.wrong or ["nothing"])


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m rs485bus.sim.small_worlds",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--world", choices=list(WORLDS), help="only this one")
    parser.add_argument("--depth", type=int, default=9, help="how many actions deep")
    parser.add_argument("--states", type=int, default=None, help="end each world after so many")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--path", help="show one path of actions")
    options = parser.parse_args()
    if options.path is not None:
        show(options.world or "stop", options.path)
        return 0
    broken = False
    for name in [options.world] if options.world else list(WORLDS):
        for found in explore(name, options.depth, options.processes, options.states):
            print(found, flush=True)
        broken = broken or bool(found.wrong)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
