"""From runs to what is quoted: medians with their spread, and ratios within one repetition."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from benchmarks.clients.registry import FLOOR, OURS

Run = dict[str, Any]
"""One run: row, library, baudrate, units, amount, repetition, and what was found."""


@dataclass(frozen=True, slots=True)
class Spread:
    """A median and what it lies between."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Iterable[float]) -> Spread | None:
        there = sorted(values)
        return cls(statistics.median(there), there[0], there[-1]) if there else None


Cells = dict[str, str]
"""What each library reached."""


@dataclass(frozen=True, slots=True)
class Row:
    """A row of the table."""

    title: str
    cells: Cells


class Runs:
    """All runs of a benchmark."""

    def __init__(self, runs: list[Run]) -> None:
        self.runs = runs
        self.libraries = list(dict.fromkeys(run["library"] for run in runs))

    def of(self, row: str, library: str, **wanted: Any) -> list[Run]:
        return [
            run
            for run in self.runs
            if run["row"] == row and run["library"] == library and all(run[key] == wanted[key] for key in wanted)
        ]

    def values(self, key: str, row: str) -> list[Any]:
        """The different values of a setting in a row, in order."""
        return sorted({run[key] for run in self.runs if run["row"] == row})

    def cases(self, row: str) -> list[str]:
        """The cases of a row, as they were measured."""
        return list(dict.fromkeys(run["case"] for run in self.runs if run["row"] == row))

    def spread(self, metric: str, row: str, library: str, **wanted: Any) -> Spread | None:
        return Spread.of(run[metric] for run in self.of(row, library, **wanted))

    def ratio(self, metric: str, row: str, library: str, to: str, **wanted: Any) -> Spread | None:
        """A library's metric over another's, each pair out of one repetition."""
        base = {_place(run): run[metric] for run in self.of(row, to, **wanted)}
        pairs = [(run[metric], base[_place(run)]) for run in self.of(row, library, **wanted) if _place(run) in base]
        return Spread.of(mine / other for mine, other in pairs if other)

    def growth(self, metric: str, row: str, library: str, amount: int, than: int) -> Spread | None:
        """A metric with one amount over that with another, each pair out of one repetition."""
        base = {run["repetition"]: run[metric] for run in self.of(row, library, amount=than)}
        there = [run for run in self.of(row, library, amount=amount) if base.get(run["repetition"])]
        return Spread.of(run[metric] / base[run["repetition"]] for run in there)

    def total(self, metric: str, row: str, library: str, **wanted: Any) -> int:
        return int(sum(run[metric] for run in self.of(row, library, **wanted)))


def rows(runs: Runs) -> list[Row]:
    """The table."""
    table = _Table(runs)
    rates = runs.values("baudrate", "share")
    for baudrate in rates:
        for units in runs.values("units", "share"):
            title = f"share of the limit, {baudrate} baud, {units} unit{'s' * (units > 1)}"
            table.add(title, _share, baudrate=baudrate, units=units)
    for baudrate in rates:
        table.add(f"share of the floor's, {baudrate} baud", _of_floor, metric="share", baudrate=baudrate)
    for baudrate in rates:
        table.add(f"the median transaction: share of the limit, {baudrate} baud", _typical, baudrate=baudrate)
    for baudrate in rates:
        title = f"the median transaction: share of the floor's, {baudrate} baud"
        table.add(title, _of_floor, metric="typical", baudrate=baudrate)
    table.add("frames before t3.5", _early)
    for baudrate in rates:
        table.add(f"CPU a request over pymodbus', {baudrate} baud", _cpu, baudrate=baudrate)
    for queued in runs.values("amount", "stop"):
        table.add(f"ms to the wire, a stop behind {queued} reads (slowest)", _stop, amount=queued)
    for waiting in runs.values("amount", "waiting"):
        table.add(f"CPU a request with {waiting} waiting, over with 100", _waiting, amount=waiting)
    table.add("wrong answers on a faulty line", _faulty, metric="lies")
    table.add("writes done twice on a faulty line", _faulty, metric="twice")
    for row in ("lossy", "dead"):
        for case in runs.cases(row):
            table.add(f"ms a delivered answer, {case}", _delivered, row=row, case=case)
    table.add("wrong answers of those", _lossy_wrong)
    for baudrate in runs.values("baudrate", "watched"):
        title = f"longest unfed of 16 watched devices, saturated, {baudrate} baud (may be), of their time"
        table.add(title, _unfed, baudrate=baudrate)
    for drives in runs.values("amount", "idle"):
        table.add(f"core used by an idle bus, watched drives: {drives}", _idle, amount=drives)
    table.add("memory after a minute, and at the end", _memory)
    return table.rows


Cell = Callable[..., str]
"""What a library reached, as text: given the runs, its name, and which runs are meant. Empty if there are none."""


class _Table:
    def __init__(self, runs: Runs) -> None:
        self.rows: list[Row] = []
        self._runs = runs

    def add(self, title: str, cell: Cell, **wanted: Any) -> None:
        runs = self._runs
        cells = {library: text for library in runs.libraries if (text := cell(runs, library, **wanted))}
        if cells:
            self.rows.append(Row(title, cells))


def percent(spread: Spread | None, digits: int = 1) -> str:
    if spread is None:
        return ""
    return f"{100 * spread.median:.{digits}f} % ({100 * spread.low:.{digits}f}..{100 * spread.high:.{digits}f})"


def factor(spread: Spread | None) -> str:
    return "" if spread is None else f"{spread.median:.2f} ({spread.low:.2f}..{spread.high:.2f})"


def plain(spread: Spread | None) -> str:
    return "" if spread is None else f"{spread.median:.1f} ({spread.low:.1f}..{spread.high:.1f})"


def _share(runs: Runs, library: str, **wanted: Any) -> str:
    return percent(runs.spread("share", "share", library, **wanted))


def _typical(runs: Runs, library: str, **wanted: Any) -> str:
    return percent(runs.spread("typical", "share", library, **wanted))


def _of_floor(runs: Runs, library: str, metric: str, **wanted: Any) -> str:
    return percent(runs.ratio(metric, "share", library, FLOOR, **wanted))


def _cpu(runs: Runs, library: str, **wanted: Any) -> str:
    return factor(runs.ratio("cpu_us", "share", library, "pymodbus", **wanted))


def _early(runs: Runs, library: str) -> str:
    if not runs.of("share", library):
        return ""
    return f"{runs.total('early', 'share', library)} of {runs.total('frames', 'share', library)}"


def _stop(runs: Runs, library: str, **wanted: Any) -> str:
    return plain(runs.spread("slowest_ms", "stop", library, **wanted))


def _waiting(runs: Runs, library: str, amount: int) -> str:
    return factor(runs.growth("cpu_us", "waiting", library, amount, 100))


def _faulty(runs: Runs, library: str, metric: str) -> str:
    if not runs.of("faulty", library):
        return ""
    return f"{runs.total(metric, 'faulty', library)} of {runs.total('requests', 'faulty', library)}"


def _delivered(runs: Runs, library: str, row: str, case: str) -> str:
    return plain(runs.spread("ms", row, library, case=case))


def _lossy_wrong(runs: Runs, library: str) -> str:
    found = [run for row in ("lossy", "dead") for run in runs.of(row, library)]
    return f"{sum(run['lies'] for run in found)} of {sum(run['requests'] for run in found)}" if found else ""


def _unfed(runs: Runs, library: str, **wanted: Any) -> str:
    found = runs.of("watched", library, **wanted)
    return f"{100 * found[0]['unfed']:.1f} % ({100 * found[0]['allowed']:.1f} %)" if found else ""


def _idle(runs: Runs, library: str, **wanted: Any) -> str:
    return percent(runs.spread("core", "idle", library, **wanted), 2)


def _memory(runs: Runs, library: str) -> str:
    found = runs.of("memory", library)
    if not found:
        return ""
    minute, end = found[0]["minute"], found[0]["end"]
    return (
        f"{minute['kilobytes']} kB, {end['kilobytes']} kB after {found[0]['seconds'] / 60:.0f} min "
        f"({minute['blocks']}, {end['blocks']} blocks)"
    )


def _place(run: Run) -> tuple[int, int, int, str, int]:
    return run["baudrate"], run["units"], run["amount"], run.get("case", ""), run["repetition"]


def libraries_of(runs: Runs) -> list[str]:
    """This library first, then the floor, then peers."""
    rest = [library for library in runs.libraries if library not in (OURS, FLOOR)]
    return [library for library in (OURS, FLOOR) if library in runs.libraries] + rest
