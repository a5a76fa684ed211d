"""Looks for what breaks the promises: many runs of the owner, in parallel processes; each failure can be had again.

python -m tests.endings.search --examples 20000 --seed 1
python -m tests.endings.search --only 1234        # one run again, with its steps
"""

from __future__ import annotations

import argparse
import random
import re
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

from tests.endings import draw
from tests.endings.records import Setting, Step
from tests.endings.world import World, play


def example(seed: int) -> tuple[Setting, list[Step]]:
    """The setting and the steps that belong to a seed."""
    rng = random.Random(seed)
    return draw.setting(rng), draw.steps(rng)


def faults(setting: Setting, steps: list[Step]) -> list[str]:
    """What is wrong after these steps."""
    try:
        return play(setting, steps).wrong
    except Exception as error:
        return [f"raised: {error!r}"[:300]]


def kind(fault: str) -> str:
    """A fault without its numbers."""
    fault = re.sub(r"\([0-9A-F ]+\)|[0-9a-f]{2}( [0-9a-f]{2})+", "", fault)
    return re.sub(r"-?\d+(\.\d+)?", "#", fault)[:90]


def shrink(setting: Setting, steps: list[Step], wanted: str) -> tuple[Setting, list[Step]]:
    """The same fault from fewer steps."""

    def fails(setting: Setting, steps: list[Step]) -> bool:
        return any(kind(fault) == wanted for fault in faults(setting, steps))

    size = max(1, len(steps) // 2)
    while size:
        at, shorter = 0, False
        while at < len(steps):
            fewer = steps[:at] + steps[at + size :]
            if fails(setting, fewer):
                steps, shorter = fewer, True
            else:
                at += size
        size = size if shorter and size == 1 else size // 2
    for name, plain in (
        ("raising", False),
        ("gateway", False),
        ("echo", ""),
        ("echo_config", bool(setting.echo)),
        ("latency", 0.0),
        ("baudrate", 115_200),
        ("by_silence", False),
    ):
        values = {field: getattr(setting, field) for field in Setting.__slots__}
        simpler = Setting(**{**values, name: plain})
        if fails(simpler, steps):
            setting = simpler
    for at, step in enumerate(steps):
        for after in (0.0, 0.01, 0.1):
            if after < step.after:
                simpler_steps = [*steps[:at], Step(after, step.name, step.args), *steps[at + 1 :]]
                if fails(setting, simpler_steps):
                    steps = simpler_steps
                    break
    return setting, steps


def some(seeds: range) -> tuple[Counter[str], list[tuple[int, str]]]:
    """Run some; return what happened and what is wrong."""
    counts: Counter[str] = Counter()
    wrong: list[tuple[int, str]] = []
    for seed in seeds:
        setting, steps = example(seed)
        world: World | None = None
        try:
            world = play(setting, steps)
        except Exception as error:
            wrong.append((seed, f"raised: {error!r}"[:300]))
            continue
        counts.update(world.counts)
        wrong += [(seed, fault) for fault in world.wrong]
    return counts, wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--examples", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", type=int, help="run one again")
    parser.add_argument("--shrink", action="store_true", help="show the fewest steps that lead to each kind of fault")
    options = parser.parse_args()
    if options.only is not None:
        return _show(options.only)
    begun = time.perf_counter()
    first = options.seed * 10_000_000
    size = min(200, max(1, options.examples // options.processes))
    chunks = [
        range(at, min(at + size, first + options.examples)) for at in range(first, first + options.examples, size)
    ]
    counts: Counter[str] = Counter()
    wrong: list[tuple[int, str]] = []
    with ProcessPoolExecutor(options.processes) as pool:
        for counted, found in pool.map(some, chunks):
            counts.update(counted)
            wrong += found
    kinds: dict[str, list[tuple[int, str]]] = {}
    for seed, fault in wrong:
        kinds.setdefault(kind(fault), []).append((seed, fault))
    print(f"{options.examples} examples in {time.perf_counter() - begun:.0f} s; {dict(sorted(counts.items()))}")
    for name, found in sorted(kinds.items(), key=lambda item: -len(item[1])):
        seeds = sorted({seed for seed, _ in found})
        print(f"{len(seeds)} examples: {name}\n    such as {found[0][1]}\n    seeds {seeds[:6]}")
        if options.shrink:
            _print(*shrink(*example(seeds[0]), name))
    print(f"{len({seed for seed, _ in wrong})} wrong")
    return 1 if wrong else 0


def _show(seed: int) -> int:
    setting, steps = example(seed)
    wrong = faults(setting, steps)
    for fault in wrong:
        print("wrong:", fault)
    if wrong:
        _print(*shrink(setting, steps, kind(wrong[0])))
    return 1 if wrong else 0


def _print(setting: Setting, steps: list[Step]) -> None:
    print(f"    {setting}")
    for step in steps:
        print(f"    {step.after:g} {step.name} {step.args}")
    for fault in faults(setting, steps):
        print("      ->", fault)


if __name__ == "__main__":
    sys.exit(main())
