"""What can go wrong on a virtual line, each with a probability."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Faults of a line and of the devices on it. Probabilities are 0..1, once a request or a reply.

    Raises:
        ValueError: a probability outside 0..1, or a time below 0.
    """

    lost_request: float = 0.0
    """The device never sees the request."""
    lost_reply: float = 0.0
    """The device does what it was asked, and its reply is lost."""
    flipped: float = 0.0
    """One to three bits of the reply arrive inverted."""
    flipped_request: float = 0.0
    """One to three bits of the request arrive inverted."""
    torn: float = 0.0
    """Only the beginning of the reply arrives."""
    late: float = 0.0
    """The reply comes late, by up to `late_by` seconds."""
    late_by: float = 0.4
    duplicated: float = 0.0
    """The reply comes twice, the copy right after it."""
    stray: float = 0.0
    """Up to eight stray bytes come before the reply."""
    foreign: float = 0.0
    """A frame from somebody else comes glued before the reply."""
    hang: float = 0.0
    """The device stops listening, for up to `hang_for` seconds."""
    hang_for: float = 2.0
    echo: bool = False
    """The adapter returns what is sent."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("late_by", "hang_for"):
                if value < 0:
                    raise ValueError(f"{field.name} {value} is below 0 s")
            elif not 0 <= value <= 1:
                raise ValueError(f"{field.name} {value} is outside 0..1")


def babble(seconds: float, gaps_every: float, seed: int = 1) -> Iterator[float]:
    """The intervals between bytes that nobody sends, for so many seconds: 0.5 to 1.6 ms, and now and then a gap of 3 to
    6 ms."""
    rng = random.Random(seed)
    since = 0.0
    while seconds > 0:
        gap = since > gaps_every * rng.uniform(0.5, 1.5)
        interval = rng.uniform(0.003, 0.006) if gap else rng.uniform(0.0005, 0.0016)
        since = 0.0 if gap else since + interval
        seconds -= interval
        yield interval
