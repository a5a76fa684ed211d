"""A paced line that loses frames, with units that are late, busy or dead. Every read is answered with its own number.

    python -m benchmarks.lossy_line '{"setting": {"units": 3}, "lossy": {"replies_lost": 0.05}}'

Everything else is as in `benchmarks.line`. On SIGTERM it prints what it counted and what each number stood for.
"""

from __future__ import annotations

import bisect
import json
import os
import random
import sys
from dataclasses import asdict, dataclass
from operator import attrgetter
from typing import Any

from benchmarks.line import PacedLine, serve
from benchmarks.orphans import end_with_parent
from benchmarks.setting import Setting

_ends = attrgetter("ends")


@dataclass(frozen=True, slots=True, kw_only=True)
class Lossy:
    """What goes wrong on the line. Probabilities are those of one request; times are seconds.

    Args:
        requests_lost: the unit does not hear the request.
        replies_lost: the unit answers, and nobody hears it.
        late: the unit answers between `late_from` and `late_to` later.
        busy: what a unit does with a request that comes while it is late or slow: "missed", or "queued" (answered
            after).
        spread: the turnaround varies between half and twice the setting's, evenly.
        slow: the unit takes 80 ms instead.
        dead: this unit never answers; 0 for none.
        gateway: for the dead unit a gateway answers after 80 ms with exception 0B.
    """

    requests_lost: float = 0.0
    replies_lost: float = 0.0
    late: float = 0.0
    late_from: float = 0.25
    late_to: float = 0.6
    busy: str = "missed"
    spread: bool = False
    slow: float = 0.0
    dead: int = 0
    gateway: bool = False


_SLOW = 0.08
_GATEWAY_WAITS = 0.08


class LossyLine(PacedLine):
    """The line and the units on it.

    Args:
        setting: how it is set.
        lossy: what goes wrong.
        seed: makes chance reproducible.
        spin: as for `PacedLine`.
    """

    def __init__(self, setting: Setting, lossy: Lossy, seed: int, *, spin: bool = True) -> None:
        super().__init__(setting, spin=spin)
        self._lossy = lossy
        self._rng = random.Random(seed)
        self._busy_until: dict[int, int] = {}
        self.reads: list[tuple[float, int, str]] = []
        """When a unit read its registers, which unit, and what it was asked; the place is the number it answered."""
        self.lost = 0
        self.late = 0

    def counted(self) -> dict[str, object]:
        return {**super().counted(), "reads": self.reads, "lost": self.lost, "late": self.late, "writes": []}

    def answer(self, frame: bytes, starts: int) -> None:
        lossy, chance, unit = self._lossy, self._rng.random, frame[0]
        if unit == lossy.dead:
            if lossy.gateway:
                self.reply(bytes((unit, frame[1] | 0x80, 0x0B)), starts + _nanoseconds(_GATEWAY_WAITS))
            return
        busy_until = self._busy_until.get(unit, 0)
        if chance() < lossy.requests_lost or (busy_until > starts and lossy.busy == "missed"):
            self.lost += 1
            return
        varied = self._varied()
        starts = max(starts + varied, busy_until)
        is_late = chance() < lossy.late
        if is_late:
            self.late += 1
            starts += _nanoseconds(self._rng.uniform(lossy.late_from, lossy.late_to))
        body = self._body(frame, starts)
        if is_late or varied > 2 * self._turnaround or starts == busy_until:
            # It answers in the order in which it is asked, one after the other.
            self._busy_until[unit] = starts + (len(body) + 2) * self._character + self._silence
        if chance() < lossy.replies_lost:
            self.lost += 1
            return
        self.reply(body, starts)

    def reply(self, body: bytes, starts: int) -> None:
        super().reply(body, starts)
        last = self._replies.pop()
        bisect.insort(self._replies, last, key=_ends)

    def _body(self, frame: bytes, reads_at: int) -> bytes:
        if frame[1] not in (3, 4):
            return frame[:6]
        serial = len(self.reads)
        self.reads.append((reads_at / 1e9, frame[0], frame[1:-2].hex()))
        return frame[:2] + bytes((2 * frame[5],)) + (serial.to_bytes(4, "big") + bytes(2 * frame[5]))[: 2 * frame[5]]

    def _varied(self) -> int:
        """How much later than usual a unit begins to answer."""
        if self._rng.random() < self._lossy.slow:
            return _nanoseconds(_SLOW) - self._turnaround
        if self._lossy.spread:
            return round(self._rng.uniform(-0.5, 1.0) * self._turnaround)
        return 0


def _nanoseconds(seconds: float) -> int:
    return round(seconds * 1e9)


def options(setting: Setting, lossy: Lossy, seed: int, core: int | None) -> dict[str, Any]:
    """What the process is told."""
    return {"setting": asdict(setting), "lossy": asdict(lossy), "seed": seed, "core": core}


def main() -> None:
    end_with_parent()
    told = json.loads(sys.argv[1])
    core = told.get("core")
    if core is not None:
        os.sched_setaffinity(0, {core})
    setting, lossy = Setting(**told.get("setting", {})), Lossy(**told.get("lossy", {}))
    serve(LossyLine(setting, lossy, told.get("seed", 1), spin=core is not None))


if __name__ == "__main__":
    main()
