"""Hours of a mixed plant of twelve axes, in episodes that each have their own dice; the same oracle judges each.

    python -m rs485bus.sim.long_motion --hours 10 --seed 1
    python -m rs485bus.sim.long_motion --seed 1 --episode 17        # one of them again, with all its calls

Every axis has a caller of its own that moves, homes, runs, streams, queues, cancels and stops it at random. A group
moves two more. Meanwhile there is noise on the pairs, the port is lost, drives are switched off and on, and somebody
makes emergency stops.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import sys
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ProcessPoolExecutor

from rs485bus.errors import BusError
from rs485bus.sim.campaigns.faults.evidence import Evidence
from rs485bus.sim.campaigns.faults.options import PLAIN
from rs485bus.sim.campaigns.faults.oracle import judge
from rs485bus.sim.campaigns.faults.plant import KINDS
from rs485bus.sim.campaigns.faults.recorder import Recorded
from rs485bus.sim.campaigns.faults.scenario import Scenario
from rs485bus.sim.campaigns.faults.scenarios import mks, tlr
from rs485bus.sim.campaigns.faults.world import World
from rs485bus.sim.noise import Noise

EPISODE = 60.0
"""Virtual seconds."""
PLANT = (
    (("mks", 1), ("mks", 2), ("mks", 3), ("zlac", 4), ("tlr", 5), ("tlr", 6)),
    (("mks", 7), ("mks", 8), ("zlac", 9), ("tlr", 10)),
)
"""Twelve axes on two pairs: each ZLAC has two."""
NOISE = Noise(
    lost_request=0.01, lost_reply=0.01, flipped=0.005, torn=0.005, late=0.005, late_by=0.3, duplicated=0.005, stray=0.01
)
_REACH = 1.5
"""Turns."""


class Episode:
    """A minute of it.

    Args:
        seed: of the campaign.
        number: of the episode.
        seconds: virtual time.
    """

    def __init__(self, seed: int, number: int, seconds: float = EPISODE) -> None:
        self._rng = random.Random(f"{seed}/{number}")
        self._seed = seed * 1_000_003 + number
        self._seconds = seconds

    def run(self) -> Evidence:
        """Run it; return what was seen."""
        scenario = Scenario("long", "episode", "", PLANT, self._play, frozenset(), short=False)
        options = dict.fromkeys(KINDS, PLAIN)
        return World(scenario, options, goes_on=True, usual=self._seconds, noise=NOISE, seed=self._seed).run()

    async def _play(self, app: World) -> None:
        async with app.bus(0) as one, app.bus(1) as other:
            x, y = app.axis(1), app.axis(7, bus=1)
            group = app.group(x=x, y=y)
            alone = [app.axis(2), app.axis(3), app.axis(5), app.axis(6), app.axis(8, bus=1), app.axis(10, bus=1)]
            bases = [app.axis(4), app.axis(9, bus=1)]
            wheels = [wheel for base in bases for wheel in (base.left, base.right)]
            over = app.now() + self._seconds
            callers = [self._use(app, axis, over) for axis in (*alone, *wheels)]
            await app.both(*callers, self._use_group(app, group, over), self._happen(app, (one, other), over))

    async def _use(self, app: World, axis: Recorded, over: float) -> None:
        rng = random.Random(self._rng.random())
        acts = [self._move, self._queue, self._run, self._run_on, self._stop, self._zero, self._ask]
        if hasattr(axis.real, "home"):
            acts.append(self._home)
        if hasattr(axis.real, "stream"):
            acts.append(self._stream)
        await axis.enable()
        while app.now() < over:
            await rng.choice(acts)(app, axis, rng)
            await app.sleep(rng.uniform(0.0, 0.5))

    async def _move(self, app: World, axis: Recorded, rng: random.Random) -> None:
        await axis.move_to(rng.uniform(-_REACH, _REACH))

    async def _queue(self, app: World, axis: Recorded, rng: random.Random) -> None:
        moves = [axis.move_by(rng.uniform(-0.3, 0.3)) for _ in range(3)]
        if rng.random() < 0.3:
            await app.sleep(rng.uniform(0.0, 0.2))
            rng.choice(moves).cancel()
        for move in moves:
            await move

    async def _run(self, app: World, axis: Recorded, rng: random.Random) -> None:
        await axis.run(rng.choice((-1, 1)) * rng.uniform(60, 150), duration=0.3)

    async def _run_on(self, app: World, axis: Recorded, rng: random.Random) -> None:
        await axis.run(rng.choice((-1, 1)) * rng.uniform(60, 150))
        await app.sleep(rng.uniform(0.0, 0.4))
        await axis.stop()

    async def _stop(self, app: World, axis: Recorded, rng: random.Random) -> None:
        axis.move_to(rng.uniform(-_REACH, _REACH))
        await app.sleep(rng.uniform(0.0, 0.2))
        await (axis.stop() if rng.random() < 0.7 else axis.emergency_stop())
        await axis.enable()

    async def _zero(self, app: World, axis: Recorded, rng: random.Random) -> None:
        await axis.set_zero()

    async def _ask(self, app: World, axis: Recorded, rng: random.Random) -> None:
        await axis.position()
        await axis.velocity()

    async def _home(self, app: World, axis: Recorded, rng: random.Random) -> None:
        await axis.move_to(0.0)
        await axis.home(mks.HOMING if "mks" in axis.name else tlr.HOMING, timeout=10.0)

    async def _stream(self, app: World, axis: Recorded, rng: random.Random) -> None:
        with contextlib.suppress(BusError):
            async with axis.stream(timeout=0.25) as setpoint:
                for _ in range(rng.randrange(1, 12)):
                    setpoint(rng.uniform(-120, 120))
                    await app.sleep(rng.uniform(0.02, 0.1))

    async def _use_group(self, app: World, group: Recorded, over: float) -> None:
        rng = random.Random(self._rng.random())
        await group.enable()
        while app.now() < over:
            await group.move_to(x=rng.uniform(-1, 1), y=rng.uniform(-1, 1))
            await app.sleep(rng.uniform(0.0, 0.5))

    async def _happen(self, app: World, buses: tuple[Recorded, ...], over: float) -> None:
        rng = random.Random(self._rng.random())
        happenings: list[tuple[float, Callable[[], Awaitable[None] | None]]] = [
            (3.0, lambda: rng.choice(app.drives).restart(app.now())),
            (1.0, lambda: app.unplug(rng.uniform(0.05, 3.0))),
            (1.0, lambda: app.deafen(rng.choice(app.drives), app.now(), rng.uniform(0.1, 1.5))),
            (1.0, lambda: app.pause(rng.uniform(0.05, 0.6))),
            (1.0, lambda: self._emergency(app, rng.choice(buses))),
        ]
        while app.now() < over:
            await app.sleep(rng.expovariate(1 / 10))
            weights = [weight for weight, _ in happenings]
            happened = rng.choices([happen for _, happen in happenings], weights)[0]()
            if happened is not None:
                await happened

    async def _emergency(self, app: World, bus: Recorded) -> None:
        await bus.emergency_stop()
        with contextlib.suppress(BusError):
            bus.clear_emergency_stop()


def judged(seed: int, number: int, seconds: float = EPISODE) -> tuple[int, int, int, list[tuple[str, str]]]:
    """One episode: its number, how many moves ended well, how many calls there were, and what is wrong."""
    evidence = Episode(seed, number, seconds).run()
    moves = sum(call.verb in ("move_to", "move_by", "run", "home") and call.end == "done" for call in evidence.calls)
    return number, moves, len(evidence.calls), judge(evidence)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m rs485bus.sim.long_motion",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--hours", type=float, default=1.0, help="virtual time")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=1, help="run so many, from --seed on")
    parser.add_argument("--episode", type=int, default=None, help="show one of them")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    if options.episode is not None:
        from rs485bus.sim.campaigns.faults.campaign import account

        evidence = Episode(options.seed, options.episode).run()
        wrong = judge(evidence)
        print(account("An episode of the long motion campaign.", evidence, wrong))
        return 1 if wrong else 0
    begun, count = time.perf_counter(), max(1, round(options.hours * 3600 / EPISODE))
    episodes = [(seed, at) for seed in range(options.seed, options.seed + options.seeds) for at in range(count)]
    moves = calls = broken = 0
    with ProcessPoolExecutor(options.processes) as pool:
        results = pool.map(judged, *zip(*episodes, strict=True), chunksize=4)
        for at, ((seed, _), (number, moved, called, wrong)) in enumerate(zip(episodes, results, strict=True), 1):
            moves, calls, broken = moves + moved, calls + called, broken + bool(wrong)
            for name, seen in wrong:
                print(f"--seed {seed} --episode {number}: {name}: {seen}", flush=True)
            if at % 20 == 0:
                took = time.perf_counter() - begun
                left = took * (len(episodes) - at) / at / 60
                print(f"{at} of {len(episodes)}, {broken} broken, {left:.1f} minutes left", file=sys.stderr, flush=True)
    hours = len(episodes) * EPISODE / 3600
    print(
        f"{hours:g} hours, {calls} calls, {moves} motions done; {broken} of {len(episodes)} episodes broke an invariant"
    )
    return 1 if broken else 0
