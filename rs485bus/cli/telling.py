"""Captures on a terminal: each exchange in a line, and the statistics at the end."""

from __future__ import annotations

import json
from collections.abc import Collection
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from rs485bus.bus.capture_lines import Drive, Entry, Exchange, Stray
from rs485bus.capture.explanation import Words, words_of
from rs485bus.capture.statistics import Summary

_STYLES = {"stop": "bold magenta", "feed": "green", "start": "cyan", "confirm": "magenta"}


class Teller:
    """Prints what happens on a pair.

    Args:
        console: where to.
        families: of the drives that are known, by address. It may grow.
        hexadecimal: show the bytes, too.
        errors_only: only what went wrong.
        units: only these; all where there are none.
    """

    def __init__(
        self,
        console: Console,
        families: dict[int, str],
        *,
        hexadecimal: bool = False,
        errors_only: bool = False,
        units: Collection[int] = (),
    ) -> None:
        self._console = console
        self._families = families
        self._hexadecimal = hexadecimal
        self._errors_only = errors_only
        self._units = units

    def wants(self, exchange: Exchange, words: Words) -> bool:
        """Whether it is to be shown."""
        return (words.error or not self._errors_only) and (not self._units or exchange.address in self._units)

    def tell(self, entry: Entry) -> None:
        """Print an entry, if it is wanted."""
        if isinstance(entry, Exchange):
            self.exchange(entry)
        elif isinstance(entry, Stray):
            self.stray(entry)
        elif isinstance(entry, Drive):
            self._console.print(f"Unit {entry.address} speaks as {entry.family} drives do.", markup=False)

    def exchange(self, exchange: Exchange) -> None:
        """Print an exchange, if it is wanted."""
        family = self._families.get(exchange.address)
        words = words_of(exchange, family)
        if not self.wants(exchange, words):
            return
        mark = "!" if words.error else "r" if exchange.repeated else " "
        unit = f"{exchange.address or 'all':>3} {family or '':4}"
        text = f"{mark}{exchange.at:11.4f} {unit} {words.purpose:7} {words.asked}"
        if words.answered:
            text += f" -> {words.answered}"
        text += f"  [{1000 * exchange.latency:.1f} ms{f', attempt {exchange.attempt}' if exchange.repeated else ''}]"
        self._line(text, "bold red" if words.error else _STYLES.get(words.purpose, ""))
        if exchange.skipped:
            self._line(f"{'':13}{exchange.skipped} bytes came meanwhile that belong to nothing", "yellow")
        if self._hexadecimal:
            frames = f"{exchange.request.hex(' ').upper()} -> {exchange.reply.hex(' ').upper() or '-'}"
            self._line(f"{'':13}{frames}", "dim")

    def stray(self, stray: Stray) -> None:
        """Print bytes that are no frame."""
        if self._units:
            return
        shown = stray.data[:32].hex(" ").upper() + (" ..." if len(stray.data) > 32 else "")
        self._line(f"!{stray.at:11.4f} {len(stray.data)} bytes that are no frame: {shown}", "yellow")

    def summary(self, summary: Summary) -> None:
        """Print the statistics."""
        table = Table(box=None, padding=(0, 1, 0, 0), header_style="bold")
        table.add_column("unit", justify="right")
        table.add_column("family")
        for heading in ("asked", "replies", "refused", "silent", "again", "median", "99 %", "max ms", "load"):
            table.add_column(heading, justify="right")
        for address, unit in summary.units.items():
            times = (unit.latency(quantile) for quantile in (0.5, 0.99, 1.0))
            table.add_row(
                str(address or "all"),
                self._families.get(address, ""),
                *map(str, (unit.requests, unit.replies, unit.refused, unit.unanswered, unit.repeated)),
                *("-" if time is None else f"{1000 * time:.1f}" for time in times),
                f"{unit.airtime / summary.seconds:.1%}" if summary.seconds else "-",
            )
        self._console.print(table)
        self._line(
            f"{summary.frames} frames in {summary.seconds:.3f} s; bytes on the pair {summary.load:.1%} of the time, "
            f"{summary.busiest:.1%} in the busiest second."
        )
        if summary.by_purpose:
            said = ", ".join(f"{count} {name}" for name, count in sorted(summary.by_purpose.items()))
            self._line(f"Sent for: {said}.")
        self._line(
            "asked: requests; silent: not answered; again: repetitions; median, 99 %, max: latency of replies in ms."
        )
        for count, what in (
            (summary.stray_bytes, "bytes belonged to no frame (noise, a wrong baud rate, damaged frames)"),
            (summary.unasked, "frames came that nobody had asked for (late replies, or another master)"),
            (summary.dropped, "records are missing: the disk was too slow"),
        ):
            if count:
                self._line(f"{count} {what}.", "yellow")

    def _line(self, text: str, style: str = "") -> None:
        if self._console.is_terminal:
            self._console.print(Text(text, style=style), soft_wrap=True)
        else:
            self._console.out(text, highlight=False)


def as_json(exchange: Exchange, family: str | None) -> dict[str, Any]:
    """An exchange for programs."""
    words = words_of(exchange, family)
    return {
        "at": round(exchange.at, 6),
        "unit": exchange.address,
        "family": family,
        "for": words.purpose,
        "attempt": exchange.attempt,
        "asked": words.asked,
        "answered": words.answered,
        "error": words.error,
        "outcome": exchange.outcome,
        "latency": round(exchange.latency, 6),
        "request": exchange.request.hex(),
        "reply": exchange.reply.hex(),
    }


def summary_json(summary: Summary, families: dict[int, str]) -> dict[str, Any]:
    """The statistics for programs. Times are seconds."""

    def time(value: float | None) -> float | None:
        return None if value is None else round(value, 6)

    return {
        "seconds": round(summary.seconds, 6),
        "frames": summary.frames,
        "load": round(summary.load, 5),
        "busiest_second": round(summary.busiest, 5),
        "sent_for": summary.by_purpose,
        "stray_bytes": summary.stray_bytes,
        "unasked": summary.unasked,
        "dropped": summary.dropped,
        "units": [
            {
                "address": address,
                "family": families.get(address),
                "requests": unit.requests,
                "replies": unit.replies,
                "refused": unit.refused,
                "no_reply": unit.unanswered,
                "repeated": unit.repeated,
                "latency_median": time(unit.latency(0.5)),
                "latency_99": time(unit.latency(0.99)),
                "latency_longest": time(unit.latency(1.0)),
                "airtime": round(unit.airtime, 6),
            }
            for address, unit in summary.units.items()
        ],
    }


def print_json(value: Any) -> None:
    """Print a value as JSON."""
    print(json.dumps(value, ensure_ascii=False, indent=1))
