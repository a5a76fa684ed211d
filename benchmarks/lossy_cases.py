"""The cases of the rows `lossy` and `dead`: what goes wrong, how many units, and what must be reached."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.lossy_line import Lossy
from benchmarks.setting import Setting
from benchmarks.tasks.lossy import COUNT


@dataclass(frozen=True, slots=True)
class Case:
    """One case.

    With `together` each unit has a caller of its own, else they are asked in turn.
    `most_ms` is what a delivered answer may take; `of_ideal` is the least share of an ideal repetition, `of_clean` how
    much more it may take than with the same turnarounds and no loss. 0 where nothing is promised.
    """

    lossy: Lossy
    units: int = 3
    together: bool = False
    most_ms: float = 0.0
    of_ideal: float = 0.0
    of_clean: float = 0.0
    clean: str = ""

    @property
    def ideal_ms(self) -> float:
        """Milliseconds a delivered answer takes a client that knows at once that a frame was lost."""
        setting = Setting(units=self.units)
        line = setting.line
        transaction = line.airtime(8 + 5 + 2 * COUNT) + setting.turnaround + line.t35
        arrives = (1 - self.lossy.requests_lost) * (1 - self.lossy.replies_lost)
        return 1000 * transaction / arrives


LOSSY: dict[str, Case] = {
    "0 %": Case(Lossy(), most_ms=5.5),
    "1 % of replies": Case(Lossy(replies_lost=0.01)),
    "2 % of replies": Case(Lossy(replies_lost=0.02), most_ms=6.0),
    "5 % of replies": Case(Lossy(replies_lost=0.05), most_ms=6.8),
    "10 % of replies": Case(Lossy(replies_lost=0.1), most_ms=8.5),
    "5 % of replies, together": Case(Lossy(replies_lost=0.05), together=True, most_ms=6.8),
    "5 % of requests": Case(Lossy(requests_lost=0.05), most_ms=6.8),
    "1 % of replies, one unit": Case(Lossy(replies_lost=0.01), units=1, of_ideal=0.8),
    "5 % of replies, one unit": Case(Lossy(replies_lost=0.05), units=1, of_ideal=0.8),
    "10 % of replies, one unit": Case(Lossy(replies_lost=0.1), units=1, of_ideal=0.8),
    "30 % of replies, eight units": Case(Lossy(replies_lost=0.3), units=8, together=True, of_ideal=0.65),
    "varied turnaround": Case(Lossy(spread=True, slow=0.01)),
    "varied turnaround, 5 %": Case(
        Lossy(spread=True, slow=0.01, replies_lost=0.05), of_clean=1.35, clean="varied turnaround"
    ),
    "5 % late, requests missed": Case(Lossy(late=0.05), most_ms=32.0),
    "5 % late, requests queued": Case(Lossy(late=0.05, busy="queued"), most_ms=32.0),
}

DEAD: dict[str, Case] = {
    "one of eight dead": Case(Lossy(dead=8), units=8, together=True),
    "one of eight dead, a gateway says 0B": Case(Lossy(dead=8, gateway=True), units=8, together=True),
}

CASES: dict[str, Case] = LOSSY | DEAD
