"""A plan as a picture. It needs the extra `plot` (matplotlib)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rs485bus.extras import brought_by
from rs485bus.planning.plan import PairPlan

with brought_by("plot", "matplotlib", "Pictures need"):
    from matplotlib.figure import Figure

_FITS, _TOO_MUCH, _POLLS = "#2ca02c", "#d62728", "#1f77b4"


def picture(pair: PairPlan, by_rate: Sequence[PairPlan], by_count: Sequence[PairPlan], title: str) -> Figure:
    """How one pair does at other baud rates, and with more drives.

    Args:
        pair: the plan.
        by_rate: the same drives at other rates.
        by_count: more and fewer drives of the same kinds.
        title: stands above.
    """
    figure = Figure(figsize=(12, 7), layout="constrained")
    rates, counts, shares, margins = figure.subplots(2, 2).flat
    _polls(rates, [f"{plan.line.baudrate:,}" for plan in by_rate], by_rate)
    rates.set_xlabel("bit/s")
    _polls(counts, [str(len(plan.drives)) for plan in by_count], by_count)
    counts.set_xlabel("drives of these kinds")
    _shares(shares, pair)
    _margins(margins, pair)
    figure.suptitle(title, fontsize=10, x=0.01, ha="left")
    return figure


def _polls(axes: Any, names: Sequence[str], plans: Sequence[PairPlan]) -> None:
    colours = [_FITS if plan.fits else _TOO_MUCH for plan in plans]
    axes.bar(names, [plan.poll_rate for plan in plans], color=colours)
    axes.set_ylabel("all positions, times a second")
    axes.set_title("green fits, red does not", fontsize=8)
    axes.tick_params(axis="x", labelsize=7)
    waits = axes.twinx()
    waits.plot(names, [1000 * plan.stop_wait for plan in plans], ".-", color=_POLLS)
    waits.set_ylabel("worst wait of a stop (ms)", color=_POLLS)
    waits.set_ylim(bottom=0)


def _shares(axes: Any, pair: PairPlan) -> None:
    names = ("standing,\nfed", "all moving", "positions asked\n10 times a second")
    polled = min(1.0, 10 * pair.cycle)
    busy = (pair.busy_standing, pair.busy_moving, polled)
    axes.bar(names, [100 * share for share in busy], color=_POLLS)
    axes.axhline(100, color=_TOO_MUCH, linewidth=1)
    axes.set_ylabel("of the time the pair is taken (%)")


def _margins(axes: Any, pair: PairPlan) -> None:
    guarded = [(drive, margin) for drive in pair.drives if (margin := pair.margin(drive)) is not None]
    axes.set_title("what is left of each watchdog's time in the worst case (ms)", fontsize=8)
    if not guarded:
        axes.text(0.5, 0.5, "no drive is guarded", ha="center", va="center", transform=axes.transAxes)
        axes.set_axis_off()
        return
    names = [f"{'+'.join(drive.axes)} ({1000 * (drive.watchdog or 0):g} ms)" for drive, _ in guarded]
    colours = [_FITS if margin >= 0 else _TOO_MUCH for _, margin in guarded]
    axes.barh(names, [1000 * margin for _, margin in guarded], height=min(0.8, 0.15 * len(names)), color=colours)
    axes.axvline(0, color="#333333", linewidth=1)
