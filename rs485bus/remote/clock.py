"""What the service's clock says, as far as a client can tell. Pure."""

from __future__ import annotations

import math
from collections import deque

_SAMPLES = 64
DRIFT = 2e-4
"""By how much two clocks may differ in speed."""


class RemoteClock:
    """Learns from answers: each was made after its request was sent, and before it came in.

    Times without a name are the client's own.
    """

    def __init__(self) -> None:
        self._bounds: deque[tuple[float, float, float]] = deque(maxlen=_SAMPLES)
        """When something was learnt, and how far the service's clock was ahead: at least, and at most."""

    def reset(self) -> None:
        """The service was started again, with another clock."""
        self._bounds.clear()

    @property
    def known(self) -> bool:
        """Whether anything was learnt."""
        return bool(self._bounds)

    def learn(self, service_time: float, sent_at: float | None, received_at: float) -> None:
        """An answer said what time it was there. `sent_at` is None where it may have been made for somebody else."""
        most = math.inf if sent_at is None else service_time - sent_at
        self._bounds.append((received_at, service_time - received_at, most))

    def offset(self, at: float) -> tuple[float, float]:
        """How far the service's clock is ahead at a moment, in seconds; and by how much that may be wrong."""
        low, high = self._range(at)
        return (low + high) / 2, max(0.0, high - low) / 2

    def now(self, at: float) -> float:
        """What the service's clock says at a moment, at the earliest: nothing passes for newer than it is."""
        return at + self._range(at)[0]

    def _range(self, at: float) -> tuple[float, float]:
        if not self._bounds:
            return 0.0, float("inf")
        return (
            max(low - DRIFT * (at - when) for when, low, _ in self._bounds),
            min(high + DRIFT * (at - when) for when, _, high in self._bounds),
        )
