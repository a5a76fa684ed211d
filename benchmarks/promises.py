"""What must be so, held against what was measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from benchmarks.clients.registry import BRIEF, FLOOR, LIBRARIES, OURS
from benchmarks.lossy_cases import CASES
from benchmarks.setting import READ_COUNT, Setting
from benchmarks.summary import Runs

_CLOSE = 0.985
_CPU = {"pymodbus": 1.25, "anymodbus": 0.6}
_MORE_WAITING = 1.2
_IDLE = 0.01
_MEMORY = 0.01


@dataclass(frozen=True, slots=True)
class Promise:
    """One of them."""

    what: str
    figure: str
    kept: bool


def promises(runs: Runs) -> list[Promise]:
    """Those that these runs can tell of."""
    return [*_shares(runs), *_cpu(runs), *_stops(runs), *_lossy(runs), *_rest(runs)]


def _shares(runs: Runs) -> Iterator[Promise]:
    for metric, whose in (("share", ""), ("typical", "the median transaction, ")):
        for baudrate in (38400, 115200):
            yield from _share(runs, metric, f"{whose}{baudrate} baud", baudrate)
    if runs.of("share", OURS):
        early, frames = runs.total("early", "share", OURS), runs.total("frames", "share", OURS)
        yield Promise("no frame before t3.5", f"{early} of {frames}", early == 0)


def _share(runs: Runs, metric: str, where: str, baudrate: int) -> Iterator[Promise]:
    for other in runs.libraries:
        ratio = runs.ratio(metric, "share", OURS, other, baudrate=baudrate)
        if ratio is None or other == OURS:
            continue
        figure = f"{ratio.median:.4f} ({ratio.low:.4f}..{ratio.high:.4f})"
        if other == FLOOR:
            yield Promise(f"{where}: at least {_CLOSE} of the floor", figure, ratio.median >= _CLOSE)
        elif LIBRARIES[other].keeps_silence:
            yield Promise(f"{where}: ahead of {other}", figure, ratio.median > 1)


def _cpu(runs: Runs) -> Iterator[Promise]:
    for peer, most in _CPU.items():
        ratio = runs.ratio("cpu_us", "share", OURS, peer)
        if ratio is not None:
            figure = f"{ratio.median:.3f} ({ratio.low:.3f}..{ratio.high:.3f})"
            yield Promise(f"CPU a request at most {most} of {peer}'s", figure, ratio.median <= most)


def _stops(runs: Runs) -> Iterator[Promise]:
    setting = Setting()
    allowed = 1000 * (setting.read_time + setting.line.t35 + 0.001)
    for queued in runs.values("amount", "stop"):
        took = runs.spread("slowest_ms", "stop", OURS, amount=queued)
        if took is not None:
            figure = f"slowest {took.median:.2f} ms ({took.low:.2f}..{took.high:.2f})"
            what = f"a stop behind {queued} reads ({READ_COUNT} registers) is on the wire within {allowed:.2f} ms"
            yield Promise(what, figure, took.median <= allowed)


def _lossy(runs: Runs) -> Iterator[Promise]:
    for name in (*runs.cases("lossy"), *runs.cases("dead")):
        case = CASES[name]
        row = "lossy" if name in runs.cases("lossy") else "dead"
        took = runs.spread("ms", row, OURS, case=name)
        if took is None:
            continue
        figure = f"{took.median:.2f} ms ({took.low:.2f}..{took.high:.2f})"
        if case.most_ms:
            yield Promise(
                f"{name}: a delivered answer takes at most {case.most_ms} ms", figure, took.median <= case.most_ms
            )
        if case.of_ideal:
            share = case.ideal_ms / took.median
            what = f"{name}: at least {case.of_ideal:.0%} of an ideal repetition ({case.ideal_ms:.2f} ms)"
            yield Promise(what, f"{share:.0%}, {figure}", share >= case.of_ideal)
        clean = runs.spread("ms", row, OURS, case=case.clean) if case.clean else None
        if clean is not None:
            ratio = took.median / clean.median
            what = f"{name}: at most {case.of_clean} of what it takes without loss"
            yield Promise(what, f"{ratio:.2f}, {figure}", ratio <= case.of_clean)
        wrong = runs.total("lies", row, OURS, case=name)
        yield Promise(
            f"{name}: no wrong answer", f"{wrong} of {runs.total('requests', row, OURS, case=name)}", not wrong
        )
        for peer in runs.libraries:
            # Who leaves no silence is raced by the same library with as short a one.
            ours = OURS if LIBRARIES[peer].keeps_silence else BRIEF
            ratio_to = runs.ratio("ms", row, ours, peer, case=name) if peer not in (OURS, BRIEF) else None
            if ratio_to is not None and not name.startswith("0 %"):
                figure = f"{ratio_to.median:.2f} ({ratio_to.low:.2f}..{ratio_to.high:.2f})"
                yield Promise(f"{name}: {ours} ahead of {peer}", figure, ratio_to.median < 1)


def _rest(runs: Runs) -> Iterator[Promise]:
    for run in runs.of("watched", OURS):
        figure = f"{100 * run['unfed']:.2f} % of its time; {100 * run['allowed']:.2f} % is allowed"
        what = f"{run['baudrate']} baud: no watched device unfed for a third of its time and one transaction"
        yield Promise(what, figure, run["unfed"] <= run["allowed"])
    for waiting in runs.values("amount", "waiting"):
        growth = runs.growth("cpu_us", "waiting", OURS, waiting, 100)
        if growth is not None and waiting > 100:
            figure = f"{growth.median:.3f} ({growth.low:.3f}..{growth.high:.3f})"
            yield Promise(f"{waiting} waiting cost at most 1.2 of 100", figure, growth.median <= _MORE_WAITING)
    for drives in runs.values("amount", "idle"):
        core = runs.spread("core", "idle", OURS, amount=drives)
        if core is not None:
            figure = f"{100 * core.median:.2f} % ({100 * core.low:.2f}..{100 * core.high:.2f})"
            what = f"an idle bus with watched drives ({drives}, 1 s each) takes under 1 % of a core"
            yield Promise(what, figure, core.median < _IDLE)
    for run in runs.of("memory", OURS):
        minute, end = run["minute"], run["end"]
        figure = f"{minute['kilobytes']} kB and {end['kilobytes']} kB, {minute['blocks']} and {end['blocks']} blocks"
        kept = all(end[key] <= (1 + _MEMORY) * minute[key] for key in end)
        yield Promise(f"memory after {run['seconds'] / 60:.0f} min of virtual time as after one", figure, kept)
