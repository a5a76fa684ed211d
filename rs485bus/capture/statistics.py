"""What a capture adds up to: of each unit, and of the pair. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

from rs485bus.bus.capture_lines import Exchange
from rs485bus.capture.reading import Capture


@dataclass(slots=True)
class UnitSummary:
    """What one unit was asked, and how it answered."""

    requests: int = 0
    replies: int = 0
    refused: int = 0
    unanswered: int = 0
    repeated: int = 0
    airtime: float = 0.0
    """Seconds for which bytes to it and from it were on the pair."""
    latencies: list[float] = field(default_factory=list, repr=False)
    """Seconds from the begin of a request to the end of its reply, in order."""

    def latency(self, quantile: float) -> float | None:
        """The latency that this share of the replies did not exceed; None if there was no reply."""
        if not self.latencies:
            return None
        ordered = sorted(self.latencies)
        return ordered[min(len(ordered) - 1, round(quantile * (len(ordered) - 1)))]


@dataclass(slots=True)
class Summary:
    """A capture in numbers."""

    seconds: float
    frames: int
    load: float
    """The share of the time in which bytes were on the pair."""
    units: dict[int, UnitSummary]
    by_purpose: dict[str, int]
    stray_bytes: int
    unasked: int
    """Frames that nobody had asked for: late replies, or another master's."""
    dropped: int
    busiest: float
    """The highest load of any whole second."""


def summarise(capture: Capture) -> Summary:
    """Add a capture up."""
    line = capture.header.line
    begin, end = capture.span
    units: dict[int, UnitSummary] = {}
    by_purpose: dict[str, int] = {}
    unasked = 0
    stray = sum(len(each.data) for each in capture.strays)
    seconds: dict[int, float] = {}
    for exchange in capture.exchanges:
        unit = units.setdefault(exchange.address, UnitSummary())
        airtime = line.airtime(len(exchange.request) + len(exchange.reply))
        unit.airtime += airtime
        seconds[int(exchange.at - begin)] = seconds.get(int(exchange.at - begin), 0.0) + airtime
        stray += exchange.skipped
        if not exchange.request:
            unasked += 1
            continue
        if exchange.urgency:
            by_purpose[exchange.urgency] = by_purpose.get(exchange.urgency, 0) + 1
        _count(unit, exchange)
    span = end - begin
    load = sum(unit.airtime for unit in units.values()) / span if span else 0.0
    whole = [share for second, share in seconds.items() if second + 1 <= span]
    return Summary(
        seconds=span,
        frames=sum(bool(each.request) + bool(each.reply) for each in capture.exchanges),
        load=load,
        units=dict(sorted(units.items())),
        by_purpose=by_purpose,
        stray_bytes=stray,
        unasked=unasked,
        dropped=capture.dropped,
        busiest=min(1.0, max([load, *whole])),
    )


def _count(unit: UnitSummary, exchange: Exchange) -> None:
    unit.requests += not exchange.repeated
    unit.repeated += exchange.repeated
    if exchange.outcome == "reply":
        unit.replies += 1
        unit.latencies.append(exchange.latency)
    elif exchange.outcome == "refused":
        unit.refused += 1
    elif exchange.failed:
        unit.unanswered += 1
