"""The picture: share of the wire, CPU, stops and wrong answers, library by library."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.clients.registry import FLOOR, LIBRARIES, OURS
from benchmarks.report import machine
from benchmarks.summary import Runs, Spread, libraries_of

_COLOURS = {
    OURS: "#0b6e4f",
    FLOOR: "#999999",
    "pymodbus": "#c8553d",
    "minimalmodbus": "#588ccc",
    "anymodbus": "#b08bc9",
    "tmodbus": "#e0a458",
}
_BREAKS = "//"


def draw(runs: Runs, path: Path) -> None:
    """Draw it, as SVG or whatever the path's ending says. Needs matplotlib (`rs485bus[plot]`)."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "rs485bus", "font.size": 9})
    figure, axes = plt.subplots(2, 2, figsize=(11, 7), layout="constrained")
    _shares(runs, axes[0][0])
    _cpu(runs, axes[0][1])
    _stops(runs, axes[1][0])
    _wrong(runs, axes[1][1])
    about = machine()
    figure.suptitle(
        f"One RS-485 line, one machine, one run: {about['processor']}, Python {about['python']}", fontsize=9
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
    plt.close(figure)


def _bars(axes: Any, places: list[str], bars: dict[str, list[Spread | None]]) -> None:
    width = 0.8 / max(1, len(bars))
    for index, (library, spreads) in enumerate(bars.items()):
        there = [(at + (index + 0.5) * width - 0.4, spread) for at, spread in enumerate(spreads) if spread is not None]
        if not there:
            continue
        middles = [spread.median for _, spread in there]
        error = [[s.median - s.low for _, s in there], [s.high - s.median for _, s in there]]
        hatch = "" if LIBRARIES[library].keeps_silence else _BREAKS
        axes.bar(
            [x for x, _ in there],
            middles,
            width,
            yerr=error,
            color=_COLOURS.get(library, "#444444"),
            hatch=hatch,
            label=library,
            error_kw={"lw": 0.7},
        )
    axes.set_xticks(range(len(places)), places)
    axes.spines[["top", "right"]].set_visible(False)


def _shares(runs: Runs, axes: Any) -> None:
    rates = runs.values("baudrate", "share")
    bars = {
        library: [_percent(runs.spread("share", "share", library, baudrate=rate)) for rate in rates]
        for library in libraries_of(runs)
    }
    _bars(axes, [f"{rate} baud" for rate in rates], bars)
    axes.axhline(100, color="black", lw=0.8)
    axes.set_title("Share of what the wire allows, % (hatched: breaks the t3.5 silence)")
    if rates:
        axes.legend(fontsize=7, ncols=3, loc="lower left")


def _cpu(runs: Runs, axes: Any) -> None:
    rates = runs.values("baudrate", "share")
    bars = {
        library: [runs.ratio("cpu_us", "share", library, "pymodbus", baudrate=rate) for rate in rates]
        for library in libraries_of(runs)
        if library != FLOOR
    }
    _bars(axes, [f"{rate} baud" for rate in rates], bars)
    axes.axhline(1, color="black", lw=0.8)
    axes.set_title("CPU a request, pymodbus = 1 (the floor spins and is left out)")


def _stops(runs: Runs, axes: Any) -> None:
    queued = runs.values("amount", "stop")
    bars = {
        library: [runs.spread("slowest_ms", "stop", library, amount=amount) for amount in queued]
        for library in libraries_of(runs)
        if runs.of("stop", library)
    }
    _bars(axes, [f"{amount} reads queued" for amount in queued], bars)
    axes.set_yscale("log")
    axes.set_title("A stop reaches the wire after, ms (slowest)")


def _wrong(runs: Runs, axes: Any) -> None:
    there = [library for library in libraries_of(runs) if runs.of("faulty", library)]
    bars: dict[str, list[Spread | None]] = {}
    for library in there:
        requests = max(1, runs.total("requests", "faulty", library))
        shares = [1000 * runs.total(metric, "faulty", library) / requests for metric in ("lies", "twice")]
        bars[library] = [Spread(share, share, share) for share in shares]
    _bars(axes, ["wrong answers", "writes done twice"], bars)
    axes.set_title("On a faulty line, of 1000 requests")


def _percent(spread: Spread | None) -> Spread | None:
    return None if spread is None else Spread(100 * spread.median, 100 * spread.low, 100 * spread.high)
