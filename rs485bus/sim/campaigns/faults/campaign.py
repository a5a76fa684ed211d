"""All runs, in parallel processes; what was found, in a table.

    python -m rs485bus.sim.every_fault
    python -m rs485bus.sim.every_fault --family mks --scenario home-and-move --fault reply-lost --frame 17
    python -m rs485bus.sim.every_fault --family mks --share 20          # every twentieth run

The second one runs one of them, and shows its calls and its frames.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field, replace

from rs485bus.sim.campaigns.faults.case import Case, bases, cases_of, pairs_of, without_faults
from rs485bus.sim.campaigns.faults.evidence import Evidence
from rs485bus.sim.campaigns.faults.fault import FAULTS
from rs485bus.sim.campaigns.faults.oracle import INVARIANTS
from rs485bus.sim.campaigns.faults.scenario import SCENARIOS

_CHUNK = 10
"""Runs of a piece: what they find is told when the last one has ended."""
_OPTIONS_SHARE = 10
"""Drives that are not plain are tried with every tenth run, each scenario with other ones."""


@dataclass(slots=True)
class Found:
    """What some runs have shown."""

    runs: int = 0
    alike: int = 0
    """Runs that were not made, because they are the same as others: no call has failed, so that an application which
    goes on after errors does what one does that gives up."""
    failed: list[tuple[Case, str, str]] = field(default_factory=list)
    """What was broken: by which run, which invariant, and what was seen."""

    @property
    def failures(self) -> int:
        """How many runs went wrong."""
        return len({case for case, _, _ in self.failed})

    def add(self, other: Found) -> None:
        """Put others' findings to these."""
        self.runs += other.runs
        self.alike += other.alike
        self.failed += other.failed


@dataclass(frozen=True, slots=True)
class Piece:
    """What one process carries out at once."""

    cases: list[Case]
    both: bool = False
    """Each stands for an application that gives up, and for one that goes on after errors."""


def try_all(cases: list[Case], *, both: bool = False) -> Found:
    """Run some; return what was found. `both`: as in `Piece`."""
    found = Found()
    for case in cases:
        evidence = _try(case, found)
        if both and evidence.gave_up:
            _try(replace(case, goes_on=True), found)
        found.alike += both and not evidence.gave_up
    return found


def _try(case: Case, found: Found) -> Evidence:
    evidence, wrong = case.judged()
    found.runs += 1
    found.failed += [(case, name, seen) for name, seen in wrong]
    return evidence


def plan(chosen: list[Case], faults: list[str], share: int = 1, offset: int = 0) -> list[Piece]:
    """The runs, in pieces that one process carries out."""
    pieces = []
    for base in chosen:
        other = replace(base, goes_on=not base.goes_on)
        both = other in chosen and not without_faults(replace(base, goes_on=False)).gave_up
        if both and base.goes_on:
            continue
        plain = base.option == "plain"
        every = share if plain else share * _OPTIONS_SHARE
        cases = [case for case in cases_of(base) if not faults or case.faults[0][0] in faults]
        cases += pairs_of(base) if plain and not faults else []
        cases = ([base] if not faults else []) + cases[offset % every :: every]
        pieces += [Piece(cases[at : at + _CHUNK], both) for at in range(0, len(cases), _CHUNK)]
        offset += 7
    return pieces


def run_all(pieces: list[Piece], processes: int, show: bool) -> Found:
    """Run them in parallel."""
    found, total = Found(), sum(len(piece.cases) * (1 + piece.both) for piece in pieces)
    with _progress(total, show) as tell:
        if processes == 1:
            for piece in pieces:
                found.add(try_all(piece.cases, both=piece.both))
                tell(found)
            return found
        with ProcessPoolExecutor(processes) as pool:
            for future in as_completed([pool.submit(try_all, piece.cases, both=piece.both) for piece in pieces]):
                found.add(future.result())
                tell(found)
    return found


def report(found: Found, seconds: float) -> str:
    """What came of it, for people."""
    by_invariant = Counter(name for _, name, _ in found.failed)
    lines = [f"{found.runs} runs in {seconds / 60:.1f} minutes; {found.failures} of them broke an invariant"]
    lines += [f"{found.alike} more were not made: no call failed, so that going on after errors is no difference", ""]
    width = max(map(len, INVARIANTS))
    lines += [f"{name:{width}}  {by_invariant[name]:6d}  {INVARIANTS[name].sentence}" for name in INVARIANTS]
    return "\n".join(lines + replays(found.failed, [""]))


def replays(failed: Sequence[tuple[Case, str, str]], between: Sequence[str] = ()) -> list[str]:
    """The command that replays each run that failed, and what was wrong with it; other lines before each."""
    lines: list[str] = []
    seen: set[Case] = set()
    for case, name, what in failed:
        lines += ([] if case in seen else [*between, str(case)]) + [f"    {name}: {what}"]
        seen.add(case)
    return lines


def account(says: str, evidence: Evidence, wrong: list[tuple[str, str]]) -> str:
    """One run, for people: what was called, what was on the line, what went wrong."""
    begun = evidence.begun
    lines = [says, ""]
    lines += [
        f"{frame.at - begun:9.4f}  {at:4d}  {frame.data.hex(' ').upper()}  {frame.treated}"
        for at, frame in enumerate(evidence.frames)
    ]
    lines.append("")
    lines += [
        f"{call.begun - evidence.begun:9.4f}  {call.ended - evidence.begun:9.4f}  {call}" for call in evidence.calls
    ]
    lines += [""] + [f"{at - evidence.begun:9.4f}  {level}: {text}" for at, level, text in evidence.logged]
    for shaft in evidence.shafts.values():
        ways = [
            f"{b - evidence.begun:.3f}..{e - evidence.begun:.3f} to {shaft.at(e).position:.4f}"
            for b, e in shaft.motions()
        ]
        mishaps = [f"{mishap.what} at {mishap.at - evidence.begun:.3f}" for mishap in shaft.mishaps]
        lines.append(f"{shaft.name} turned {', '.join(ways) or 'never'}; {', '.join(mishaps) or 'no mishap'}")
    lines += [""] + [f"{name}: {what}" for name, what in wrong or [("nothing", "is wrong")]]
    return "\n".join(lines)


class _progress:  # noqa: N801 # a context manager
    """What has failed, as soon as it is found, and how far it has come: by rich where it is there."""

    def __init__(self, total: int, show: bool) -> None:
        self._total = total
        self._begun = time.perf_counter()
        self._show = show
        self._rich = None
        if show and sys.stderr.isatty() and importlib.util.find_spec("rich") is not None:
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
            self._rich = Progress(*columns, console=Console(stderr=True))
            self._task = self._rich.add_task("runs", total=total)
        self._told = self._begun
        self._failed = 0
        """How much of what has failed was told."""

    def __enter__(self) -> _progress:
        if self._rich is not None:
            self._rich.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._rich is not None:
            self._rich.stop()

    def __call__(self, found: Found) -> None:
        for line in replays(found.failed[self._failed :]):
            if self._rich is not None:
                self._rich.console.print(line, markup=False, highlight=False, soft_wrap=True)
            elif self._show:
                print(line, file=sys.stderr, flush=True)
        self._failed = len(found.failed)
        if self._rich is not None:
            self._rich.update(self._task, completed=found.runs + found.alike, description=f"{found.failures} failed")
        elif self._show and time.perf_counter() - self._told > 10:
            self._told = time.perf_counter()
            took = self._told - self._begun
            made = found.runs + found.alike
            left = took * (self._total - made) / max(1, made)
            print(
                f"{made} of {self._total} runs, {found.failures} failed, {left / 60:.1f} minutes left",
                file=sys.stderr,
                flush=True,
            )


def _cases(options: argparse.Namespace) -> Iterator[Case]:
    """One run, or the one without faults, as the options name it."""
    names = options.fault.split(",") if options.fault else []
    frames = [int(frame) for frame in options.frame.split(",")] if options.frame else []
    yield Case(
        options.family,
        options.scenario,
        options.option or "plain",
        options.goes_on,
        tuple(zip(names, frames, strict=True)),
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="python -m rs485bus.sim.every_fault",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--family", choices=list(SCENARIOS), help="only its scenarios")
    parser.add_argument("--scenario", help="only this one")
    parser.add_argument("--option", help="only drives that are like this")
    parser.add_argument("--fault", help=f"only this one, or several with commas: {', '.join(FAULTS)}")
    parser.add_argument("--frame", help="only at this frame, counted from 0: shows the run; -1 for no fault")
    parser.add_argument("--goes-on", action="store_true", help="the application goes on after errors")
    parser.add_argument("--share", type=int, default=1, help="run every so manieth only")
    parser.add_argument("--offset", type=int, default=0, help="begin with this one")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--list", action="store_true", help="show the scenarios and end")
    options = parser.parse_args()
    if options.list:
        for known in SCENARIOS.values():
            for scenario in known.values():
                print(f"{scenario.family:6} {scenario.name:28} {scenario.says}")
        return 0
    if options.frame is not None:
        options.frame, options.fault = ("", "") if options.frame == "-1" else (options.frame, options.fault)
        if (options.frame or "").count(",") != (options.fault or "").count(","):
            parser.error("--frame: one for each fault, with commas like them")
        for case in _cases(options):
            evidence, wrong = case.judged()
            print(account(case.script.says, evidence, wrong))
        return 1 if wrong else 0
    begun = time.perf_counter()
    chosen = bases(options.family, options.scenario, options.option)
    faults = options.fault.split(",") if options.fault else []
    found = run_all(plan(chosen, faults, options.share, options.offset), options.processes, show=True)
    print(report(found, time.perf_counter() - begun))
    return 1 if found.failed else 0
