"""The command: the same moves through this package and through pymodbus, in parallel processes, in virtual time."""

from __future__ import annotations

import argparse
import asyncio
import importlib
import logging
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor

from rs485bus.sim.campaigns.moves.plant import SHAFTS, Plant, Tally
from rs485bus.sim.clock import VirtualClockLoop

PIECE = 200
"""Moves of each shaft of one plant: then another one begins."""
WHO = {"rs485bus": "ours", "pymodbus": "theirs"}


def run(who: str, seed: int, moves: int = PIECE, lost: float = 0.05) -> Tally:
    """Send each of the six shafts of one plant so many times.

    Args:
        who: "rs485bus" or "pymodbus".
        seed: makes it reproducible.
        moves: of each shaft.
        lost: the probability with which a request is lost, and that with which a reply is.
    """
    move = importlib.import_module(f"rs485bus.sim.campaigns.moves.{WHO[who]}").move
    tally = Tally()
    logging.getLogger("rs485bus").setLevel(logging.CRITICAL)
    with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
        begun = runner.get_loop().time()
        runner.run(move(Plant(lost, seed), moves, seed, tally))
        tally.seconds = runner.get_loop().time() - begun
    return tally


def report(results: dict[str, Tally]) -> str:
    """What came of it, for people."""
    lines = [
        f"{'':9} {'moves':>8} {'told done':>9} {'told not':>8} {'done wrong':>10} {'shafts astray':>13} {'worst':>12}"
    ]
    for who, tally in results.items():
        astray = f"{tally.astray} of {tally.shafts}"
        lines.append(
            f"{who:9} {tally.moves:8} {tally.acknowledged:9} {tally.failed:8} {tally.off:10} {astray:>13} "
            f"{tally.worst:6.2f} turns {tally.seconds / 3600:6.2f}"
        )
        lines += [f"{'':9} {count} x {error}" for error, count in sorted(tally.errors.items())]
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m rs485bus.sim.relative_moves",
        description="Relative moves on a line that loses frames, by rs485bus and by pymodbus' own client.",
    )
    parser.add_argument("--moves", type=int, default=6000, help="of all shafts together")
    parser.add_argument("--lost", type=float, default=0.05, help="the part of the requests, and of the replies")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--who", choices=list(WHO), help="only this one")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    plants = max(1, -(-options.moves // (PIECE * len(SHAFTS))))
    seeds = range(options.seed, options.seed + plants)
    results: dict[str, Tally] = {}
    for who in [options.who] if options.who else WHO:
        begun, results[who] = time.perf_counter(), Tally()
        with ProcessPoolExecutor(options.processes) as pool:
            work = pool.map(run, *zip(*((who, seed, PIECE, options.lost) for seed in seeds), strict=True))
            for seed, tally in zip(seeds, work, strict=True):
                results[who].add(tally)
                if who == "rs485bus" and (tally.off or tally.astray):
                    print(
                        f"--who {who} --seed {seed} --moves 1: {tally.off} done wrong, {tally.astray} astray",
                        flush=True,
                    )
        minutes, hours = (time.perf_counter() - begun) / 60, results[who].seconds / 3600
        print(
            f"{who}: {results[who].moves} moves, {hours:.1f} hours in {minutes:.1f} minutes",
            file=sys.stderr,
            flush=True,
        )
    print(report(results))
    ours = results.get("rs485bus", Tally())
    return 1 if ours.off or ours.astray else 0
