"""The plant of the relative moves: six shafts on one pair, how far each is sent, and what came of it."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from rs485bus.sim.mks import SimMks
from rs485bus.sim.noise import Noise
from rs485bus.sim.tlr import SimTlr
from rs485bus.sim.virtual_line import VirtualLine
from rs485bus.sim.zlac import SimZlac

STEP = 1 / 32
"""Turns: a whole number of counts for each of the drives. What is sent is a multiple of it, and nothing is rounded."""
MOST_STEPS = 16
SLACK = 0.004
"""Turns by which a shaft may stand off."""
SHAFTS = ("mks 1", "mks 2", "tlr 3", "tlr 4", "zlac 5 left", "zlac 5 right")


class Plant:
    """Two MKS, two TL-R and a ZLAC on a pair that loses frames.

    Args:
        lost: the probability with which a request is lost, and that with which a reply is.
        seed: makes it reproducible.
    """

    def __init__(self, lost: float, seed: int) -> None:
        self.mks = (SimMks(1), SimMks(2))
        self.tlr = (SimTlr(3), SimTlr(4))
        self.zlac = SimZlac(5, watchdog=0)
        noise = Noise(lost_request=lost, lost_reply=lost)
        self.line = VirtualLine(*self.mks, *self.tlr, self.zlac, noise=noise, seed=seed)
        turns: list[Callable[[float], float]] = [
            *(drive.shaft for drive in self.mks),
            *(drive.shaft for drive in self.tlr),
        ]
        turns += [lambda now: self.zlac.shafts(now)[0], lambda now: self.zlac.shafts(now)[1]]
        self._turns = dict(zip(SHAFTS, turns, strict=True))

    def turns(self, name: str, now: float) -> float:
        """Where a shaft really is."""
        return self._turns[name](now)


def ways(name: str, moves: int, seed: int) -> Iterator[float]:
    """How far a shaft is sent, in turns, move by move: the same for whoever sends it."""
    rng = random.Random(f"{seed}/{name}")
    for _ in range(moves):
        yield rng.choice((-1, 1)) * rng.randint(1, MOST_STEPS) * STEP


@dataclass(slots=True)
class Tally:
    """What came of some moves."""

    moves: int = 0
    acknowledged: int = 0
    failed: int = 0
    """Moves of which the caller was told that they had not been done, or that nobody knows."""
    off: int = 0
    """Acknowledged moves that left their shaft further off its sum than before."""
    shafts: int = 0
    astray: int = 0
    """Shafts that in the end do not stand where the sum of their acknowledged moves says."""
    worst: float = 0.0
    """Turns by which the worst of them is off."""
    seconds: float = 0.0
    """Virtual time."""
    errors: dict[str, int] = field(default_factory=dict)
    """How often each error was told."""

    def add(self, other: Tally) -> None:
        """Put others' results to these."""
        for name in ("moves", "acknowledged", "failed", "off", "shafts", "astray", "seconds"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.worst = max(self.worst, other.worst)
        for error, count in other.errors.items():
            self.errors[error] = self.errors.get(error, 0) + count


class Ledger:
    """What one shaft was told to do, against where it is.

    Args:
        tally: what is kept for all shafts.
        where: tells where the shaft is now, in turns.
    """

    def __init__(self, tally: Tally, where: Callable[[], float]) -> None:
        self._tally = tally
        self._where = where
        self._sum = where()
        self._error = 0.0
        tally.shafts += 1

    def acknowledged(self, way: float) -> None:
        """A move is said to be done."""
        tally = self._tally
        tally.moves += 1
        tally.acknowledged += 1
        self._sum += way
        error = self._where() - self._sum
        tally.off += abs(error - self._error) > SLACK
        self._error = error

    def failed(self, error: Exception) -> None:
        """A move is said not to be done, or not to be known."""
        tally, name = self._tally, type(error).__name__
        tally.moves += 1
        tally.failed += 1
        tally.errors[name] = tally.errors.get(name, 0) + 1

    def told(self, turns: float) -> None:
        """The application has asked where the shaft is, and goes on from there."""
        self._sum = turns
        self._error = self._where() - turns

    def close(self) -> None:
        """No move follows."""
        off = abs(self._where() - self._sum)
        self._tally.worst = max(self._tally.worst, off)
        self._tally.astray += off > SLACK
