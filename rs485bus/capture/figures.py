"""Pictures of what happened on a pair. They need the extra `plot` (matplotlib).

from rs485bus.capture.figures import timeline

timeline(bus)                                  # in a notebook: what the bus remembers
timeline(load("cell.jsonl")).savefig("cell.svg")
save(timeline(capture), "cell.html", capture)
"""

from __future__ import annotations

import html
import io
import math
import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Final

from rs485bus.bus.capture_lines import Exchange
from rs485bus.capture.explanation import Words, words_of
from rs485bus.capture.reading import Capture, Remembers, capture_of
from rs485bus.capture.statistics import summarise
from rs485bus.capture.traces import Point, Trace, traces
from rs485bus.extras import brought_by

with brought_by("plot", "matplotlib", "Pictures need"):
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

_COLOURS: Final = {
    "stop": "#d62728",
    "start": "#17becf",
    "feed": "#2ca02c",
    "confirm": "#e377c2",
    "command": "#ff7f0e",
    "poll": "#1f77b4",
}
_UNANSWERED, _STRAY, _GRID, _INK = "#111111", "#8c564b", "#dddddd", "#333333"
_PALETTE: Final = ("#1f77b4", "#ff7f0e", "#2ca02c", "#9467bd", "#8c564b", "#e377c2", "#17becf", "#bcbd22")
_MANY = 4000
"""Exchanges from which on they are drawn as pixels, also in an SVG."""
_BINS = 200
_SHORTEST_BIN = 0.02
"""Seconds over which the load is averaged, at the least: some transactions."""
FORMATS: Final = (".svg", ".png", ".pdf", ".html")


def timeline(
    source: Capture | Remembers, *, begin: float | None = None, end: float | None = None, title: str = ""
) -> Figure:
    """What happened on a pair, over time.

    A lane for each unit shows requests, the waiting, replies, what was not answered, repetitions, stops and feeds, with
    the silences between them. Below stand the latency, the load, and of each axis its position, speed, targets and
    set-points.

    Args:
        source: a capture; or a bus, or the blocking face of one, of which the latest 256 transactions are shown.
        begin, end: seconds since the capture began; None for all of it.
        title: stands above it.

    Raises:
        ValueError: nothing happened in that time.
    """
    whole = source if isinstance(source, Capture) else capture_of(source)
    capture = whole.between(begin, end)
    if not capture.exchanges and not capture.strays:
        raise ValueError("nothing happened on the pair in that time: there is nothing to draw")
    low, high = capture.span
    low, high = low if begin is None else begin, high if end is None else end
    axes = [part for trace in traces(whole) if (part := trace.between(low, high))]
    units = sorted({exchange.address for exchange in capture.exchanges})
    moving = [trace for trace in axes if trace.positions or trace.targets]
    turning = [trace for trace in axes if trace.measured_speeds or trace.set_points]
    heights = [max(1.2, 0.42 * (len(units) + bool(capture.strays)) + 0.4), 1.5, 1.1]
    heights += [1.7] * (bool(moving) + bool(turning))
    figure = Figure(figsize=(13, sum(heights) + 0.9), layout="constrained")
    grid = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False)[:, 0]
    _lanes(grid[0], capture, units)
    _latencies(grid[1], capture, units)
    _load(grid[2], capture)
    rest = list(grid[3:])
    if moving:
        _axes(rest.pop(0), moving, "position (turns)", lambda one: one.positions, lambda one: one.targets, "target")
    if turning:
        _axes(
            rest.pop(0),
            turning,
            "speed (rpm)",
            lambda one: one.measured_speeds,
            lambda one: one.set_points,
            "set-point",
        )
    margin = 0.01 * (high - low) or 0.001
    grid[0].set_xlim(low - margin, high + margin)
    grid[-1].set_xlabel(f"seconds since {capture.header.started.replace('T', ' ').split('.')[0]} UTC")
    figure.suptitle(title or _about(capture), fontsize=10, x=0.01, ha="left")
    return figure


def save(figure: Figure, path: str | os.PathLike[str], capture: Capture | None = None) -> None:
    """Write a figure, as the path's ending says: .svg, .png, .pdf or .html.

    A page (.html) holds the picture, which can be enlarged there, and with a capture its statistics.

    Raises:
        ValueError: the ending is none of them.
    """
    path = Path(path)
    check_format(path)
    if path.suffix.lower() == ".html":
        path.write_text(_page(figure, path.stem, capture), encoding="utf-8")
        return
    figure.savefig(path, dpi=130, metadata={"Date": None} if path.suffix.lower() == ".svg" else None)


def check_format(path: Path) -> None:
    """Raise `ValueError` for a path whose ending says no format."""
    if path.suffix.lower() not in FORMATS:
        raise ValueError(f"{path.name!r} says no format: its name must end in {', '.join(FORMATS)}")


def _about(capture: Capture) -> str:
    header, summary = capture.header, summarise(capture)
    line = header.line
    failed = sum(unit.unanswered + unit.refused for unit in summary.units.values())
    return (
        f"{header.port}, {line.baudrate} bit/s 8{line.parity}{line.stopbits}: {summary.frames} frames, "
        f"{summary.load:.0%} load, {failed} requests not answered or refused"
    )


def _lanes(axes: Any, capture: Capture, units: Sequence[int]) -> None:
    line = capture.header.line
    lanes = {address: at for at, address in enumerate(units)}
    many = len(capture.exchanges) > _MANY
    sent: dict[str, list[Any]] = {}
    replies: dict[str, list[Any]] = {}
    waits: list[Any] = []
    marks: dict[str, list[tuple[float, float]]] = {
        "no answer": [],
        "refused": [],
        "repetition": [],
        "stop": [],
        "feed": [],
    }
    for exchange in capture.exchanges:
        words = words_of(exchange, capture.families.get(exchange.address))
        lane = float(lanes[exchange.address])
        out = exchange.at + line.airtime(len(exchange.request))
        back = exchange.ended - line.airtime(len(exchange.reply))
        if exchange.request:
            sent.setdefault(words.purpose, []).append([(exchange.at, lane), (out, lane)])
            waits.append([(out, lane), (max(out, back), lane)])
        if exchange.reply:
            replies.setdefault(words.purpose, []).append([(max(out, back), lane), (exchange.ended, lane)])
        for mark in _marks(exchange, words):
            marks[mark].append((exchange.at, lane))
    usual: dict[str, Any] = {"capstyle": "butt", "rasterized": many}
    axes.add_collection(LineCollection(waits, colors="#c8c8c8", linewidths=1.2, **usual))
    for purpose, lines in sent.items():
        axes.add_collection(LineCollection(lines, colors=_COLOURS[purpose], linewidths=11, **usual))
    for purpose, lines in replies.items():
        axes.add_collection(LineCollection(lines, colors=_COLOURS[purpose], linewidths=6, alpha=0.75, **usual))
    _draw_marks(axes, marks, many)
    names = [f"{address or 'all'} {capture.families.get(address, '')}".strip() for address in units]
    if capture.strays:
        lane = len(units)
        lines = [[(stray.at, lane), (max(stray.ended, stray.at + line.character), lane)] for stray in capture.strays]
        axes.add_collection(LineCollection(lines, colors=_STRAY, linewidths=9, **usual))
        names.append("no frame")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(axis="y", color=_GRID, linewidth=0.5)
    axes.set_axisbelow(True)
    purposes = [purpose for purpose in _COLOURS if purpose in sent]
    keys = [Line2D([], [], color=_COLOURS[purpose], linewidth=6, label=purpose) for purpose in purposes]
    keys += [_key(mark) for mark, points in marks.items() if points and mark != "feed"]
    _legend(axes, keys)


def _marks(exchange: Exchange, words: Words) -> Iterable[str]:
    if words.purpose in ("stop", "feed"):
        yield words.purpose
    if words.error:
        yield "refused" if exchange.outcome == "refused" else "no answer"
    if exchange.repeated:
        yield "repetition"


_MARKS: Final[dict[str, dict[str, Any]]] = {
    "no answer": {"marker": "x", "color": _UNANSWERED, "markersize": 6, "markeredgewidth": 1.6},
    "refused": {"marker": "D", "color": _UNANSWERED, "markersize": 5, "fillstyle": "none"},
    "repetition": {"marker": "|", "color": _INK, "markersize": 13, "markeredgewidth": 1.4},
    "stop": {"marker": "v", "color": _COLOURS["stop"], "markersize": 7},
    "feed": {"marker": "^", "color": _COLOURS["feed"], "markersize": 4},
}
_SHIFT: Final = {"stop": -0.36, "feed": 0.36}
"""By how much of a lane a mark stands above or below the frames."""


def _draw_marks(axes: Any, marks: dict[str, list[tuple[float, float]]], many: bool) -> None:
    for mark, points in marks.items():
        if points:
            times, lanes = zip(*points, strict=True)
            shifted = [lane + _SHIFT.get(mark, 0.0) for lane in lanes]
            axes.plot(times, shifted, linestyle="none", rasterized=many, zorder=4, **_MARKS[mark])


def _key(mark: str) -> Line2D:
    return Line2D([], [], linestyle="none", label=mark, **_MARKS[mark])


def _latencies(axes: Any, capture: Capture, units: Sequence[int]) -> None:
    keys = []
    for at, address in enumerate(units):
        mine = [each for each in capture.exchanges if each.address == address and each.outcome == "reply"]
        if not mine:
            continue
        colour = _PALETTE[at % len(_PALETTE)]
        times, latencies = [each.ended for each in mine], [1000 * each.latency for each in mine]
        axes.plot(times, latencies, ".", markersize=2.5, color=colour, rasterized=len(mine) > _MANY)
        keys.append(Line2D([], [], color=colour, linewidth=3, label=f"unit {address}"))
    lost = [each for each in capture.exchanges if each.failed and each.outcome != "refused" and each.request]
    if lost:
        axes.plot([each.ended for each in lost], [1000 * each.latency for each in lost], "x", color=_UNANSWERED)
        keys.append(_key("no answer"))
    highest = max((1000 * each.latency for each in capture.exchanges), default=1.0)
    if highest > 20 * min((1000 * each.latency for each in capture.exchanges), default=1.0):
        axes.set_yscale("log")
    axes.set_ylabel("latency (ms)")
    axes.grid(color=_GRID, linewidth=0.5)
    _legend(axes, keys)


def _load(axes: Any, capture: Capture) -> None:
    line = capture.header.line
    begin, end = capture.span
    width = max((end - begin) / _BINS, _SHORTEST_BIN)
    bins = math.ceil((end - begin) / width) or 1
    busy = [0.0] * bins
    for exchange in capture.exchanges:
        out = exchange.at, exchange.at + line.airtime(len(exchange.request))
        back = exchange.ended - line.airtime(len(exchange.reply)), exchange.ended
        for first, last in (out, back):
            _share_out(busy, (first - begin) / width, (last - begin) / width)
    times = [begin + width * at for at in range(bins + 1)]
    axes.stairs([min(100.0, 100 * share) for share in busy], times, fill=True, color="#9ecae1")
    axes.set_ylim(0, 100)
    axes.set_ylabel("load (%)")
    axes.grid(color=_GRID, linewidth=0.5)


def _share_out(busy: list[float], first: float, last: float) -> None:
    """Add a time on the pair, in bins from the begin, to the bins that it lies in."""
    at = int(max(first, 0.0))
    while at < min(last, len(busy)):
        busy[at] += max(0.0, min(last, at + 1) - max(first, at))
        at += 1


def _axes(
    axes: Any,
    shown: Sequence[Trace],
    label: str,
    actual: Callable[[Trace], list[Point]],
    told: Callable[[Trace], list[Point]],
    what: str,
) -> None:
    keys = []
    for at, trace in enumerate(shown):
        colour = _PALETTE[at % len(_PALETTE)]
        points, wanted = actual(trace), told(trace)
        if points:
            times, values = zip(*points, strict=True)
            axes.plot(times, values, "-", color=colour, linewidth=1.2, marker=".", markersize=2.5)
        if wanted:
            times, values = zip(*wanted, strict=True)
            axes.step(times, values, where="post", color=colour, linewidth=0.8, linestyle=":")
            axes.plot(times, values, "o", color=colour, markersize=4, fillstyle="none")
        name = f"{trace.name} ({trace.assumed})" if trace.assumed else trace.name
        keys.append(Line2D([], [], color=colour, linewidth=3, label=name))
    if any(told(trace) for trace in shown):
        keys.append(Line2D([], [], color=_INK, linestyle=":", marker="o", fillstyle="none", markersize=4, label=what))
    axes.set_ylabel(label)
    axes.grid(color=_GRID, linewidth=0.5)
    _legend(axes, keys)


def _legend(axes: Any, keys: Sequence[Line2D]) -> None:
    """Beside the picture, where it hides nothing."""
    if keys:
        axes.legend(
            handles=keys, loc="upper left", bbox_to_anchor=(1.0, 1.02), fontsize=7, frameon=False, borderaxespad=0.3
        )


def _page(figure: Figure, title: str, capture: Capture | None) -> str:
    picture = io.StringIO()
    figure.savefig(picture, format="svg", metadata={"Date": None})
    svg = picture.getvalue()
    svg = svg[svg.index("<svg") :]
    return _PAGE.format(title=html.escape(title), picture=svg, table="" if capture is None else _table(capture))


def _table(capture: Capture) -> str:
    rows = []
    summary = summarise(capture)
    for address, unit in summary.units.items():
        times = (unit.latency(quantile) for quantile in (0.5, 0.99, 1.0))
        cells = [address or "all", capture.families.get(address, ""), unit.requests, unit.replies, unit.refused]
        cells += [unit.unanswered, unit.repeated, *("-" if each is None else f"{1000 * each:.1f}" for each in times)]
        rows.append("<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in cells) + "</tr>")
    return _TABLE.format(rows="".join(rows))


_TABLE = """<table><tr><th>unit</th><th>family</th><th>requests</th><th>replies</th><th>refused</th><th>no reply</th>
<th>repeated</th><th>median (ms)</th><th>99 %</th><th>longest</th></tr>{rows}</table>"""

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>
body {{ font: 14px system-ui, sans-serif; margin: 1em; }}
#box {{ overflow: auto; border: 1px solid #ccc; max-height: 85vh; }}
#box svg {{ width: 100%; height: auto; display: block; }}
table {{ border-collapse: collapse; margin-top: 1em; }}
td, th {{ border: 1px solid #ccc; padding: .2em .6em; text-align: right; }}
</style></head><body><h1>{title}</h1>
<label>enlarge <input type="range" min="100" max="2000" value="100" id="zoom"></label>
<div id="box">{picture}</div>{table}
<script>
document.getElementById("zoom").addEventListener("input", event => {{
  document.querySelector("#box svg").style.width = event.target.value + "%";
}});
</script></body></html>
"""
