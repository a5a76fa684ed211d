"""What was refused, until it would have expired: said again, it is refused again, whatever has changed since. Pure."""

from __future__ import annotations

import heapq
from typing import NamedTuple

from rs485bus.service.schema import Answer


class Refusal(NamedTuple):
    """A request that was refused, and how that was said."""

    digest: str
    answer: Answer


class Refusals:
    """Forgets by itself."""

    def __init__(self) -> None:
        self._refusals: dict[str, Refusal] = {}
        self._ends: list[tuple[float, str]] = []

    def __len__(self) -> int:
        return len(self._refusals)

    def add(self, request: str, refusal: Refusal, until: float) -> None:
        """Remember one until a time."""
        self._refusals[request] = refusal
        heapq.heappush(self._ends, (until, request))

    def get(self, request: str, now: float) -> Refusal | None:
        """How a request was refused; None if it was not."""
        while self._ends and self._ends[0][0] <= now:
            self._refusals.pop(heapq.heappop(self._ends)[1], None)
        return self._refusals.get(request)
