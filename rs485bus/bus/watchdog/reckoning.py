"""Whether armed watchdogs can be fed in time. All of that is reckoned here. Pure.

The wire carries one transaction at a time, and none is interrupted. So a device that is due may have to wait for one
transaction, burst or turnaround, for one feed of every other device, and for what a lossy line makes of that: two
attempts that are not answered. All that must fit between the moment it is due and the moment it trips.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Protocol

from rs485bus.errors import WatchdogInfeasible

SHARE = 1 / 3
"""The part of a watchdog's time after which its device is due."""
MOST = 0.6
"""The part of the wire that feeds may take. The rest belongs to what the devices are there for."""
LOST = 2
"""How many attempts in a row may fail, of whichever devices, without a trip."""
_over = attrgetter("over")


class Fed(Protocol):
    """An armed watchdog, as it is reckoned with. All times are seconds."""

    @property
    def address(self) -> int: ...

    @property
    def timeout(self) -> float:
        """The time without a frame after which it trips."""

    @property
    def cost(self) -> float:
        """How long one feed takes the wire, if it is answered."""

    @property
    def attempt(self) -> float:
        """How long one feed takes the wire, if it is not answered."""

    @property
    def occupies(self) -> float:
        """How long the longest request of its device's facade may take the wire."""

    @property
    def over(self) -> float:
        """When it trips unless it is heard."""


@dataclass(frozen=True, slots=True)
class Reckoning:
    """What feeding a set of watchdogs takes, and what there is. All times are seconds."""

    count: int
    feeds: float
    """One feed of each device."""
    failed: float
    """The two slowest attempts that may fail."""
    longest: float
    """The longest time for which the wire must be left to something else."""
    available: float
    """The time between the moment a device is due and the moment it trips, of the shortest watchdog."""
    share: float
    """The part of the wire that feeds take."""
    shortest: tuple[int, float]
    """The address and the time of the shortest watchdog."""

    @property
    def slack(self) -> float:
        """How long the wire may be taken at once."""
        return self.available - self.feeds - self.failed

    @property
    def fits(self) -> bool:
        """Whether the set can be fed, and its devices used beside that."""
        return self.longest <= self.slack and self.share <= MOST

    @property
    def numbers(self) -> dict[str, float]:
        """What was added up."""
        return {
            "feeds": self.feeds,
            "failed": self.failed,
            "longest": self.longest,
            "needed": self.feeds + self.failed + self.longest,
            "available": self.available,
            "share": self.share,
        }

    def __str__(self) -> str:
        address, timeout = self.shortest
        told = (
            f"one feed each takes {1000 * self.feeds:.0f} ms, the two slowest failed attempts {1000 * self.failed:.0f} "
            f"ms, the longest transaction {1000 * self.longest:.0f} ms, in all {1000 * self.numbers['needed']:.0f} ms. "
            f"Unit {address} trips {1000 * self.available:.0f} ms after it is due (two thirds of its "
            f"{1000 * timeout:g} ms)"
        )
        if self.share > MOST:
            told += f". Feeds would take {self.share:.0%} of the wire, and may take {MOST:.0%}"
        return told


def reckon(watches: Iterable[Fed], attempts: Iterable[float], longest: float) -> Reckoning:
    """Add up what feeding some watchdogs takes.

    Args:
        watches: all of them, at least one.
        attempts: how long each attempt takes that may fail.
        longest: how long the wire must be left to something else that cannot be interrupted.
    """
    watches = list(watches)
    shortest = min(watches, key=lambda watch: watch.timeout)
    return Reckoning(
        count=len(watches),
        feeds=sum(watch.cost for watch in watches),
        failed=sum(sorted(attempts)[-LOST:]),
        longest=longest,
        available=(1 - SHARE) * shortest.timeout,
        share=sum(watch.cost / (SHARE * watch.timeout) for watch in watches),
        shortest=(shortest.address, shortest.timeout),
    )


def add_up(watches: Sequence[Fed], turnaround: float) -> Reckoning:
    """As `reckon`, from what each device may take.

    Args:
        watches: all of them, at least one.
        turnaround: how long a broadcast may take the wire, in seconds.
    """
    attempts = [watch.attempt for watch in watches for _ in range(LOST)]
    return reckon(watches, attempts, max(turnaround, *(watch.occupies for watch in watches)))


def admit(watches: Iterable[Fed], attempts: Iterable[float], longest: float, *, measured: bool = False) -> float:
    """Refuse a set of watchdogs that cannot be fed in time; return how long the wire may be taken at once, in seconds.

    Args:
        watches: all that would be armed, those armed already included.
        attempts: how long each attempt takes that may fail.
        longest: how long the wire can be taken by something that cannot be interrupted.
        measured: how long the devices take to answer was measured. Before that nothing is known of the share.

    Raises:
        WatchdogInfeasible: one feed each, the two slowest failed attempts and `longest` do not fit between the time
            a device is due and the time it trips; or feeds would take too much of the wire.
    """
    reckoning = reckon(watches, attempts, longest)
    if reckoning.fits or (not measured and reckoning.longest <= reckoning.slack):
        return reckoning.slack
    plural = "" if reckoning.count == 1 else "s"
    raise WatchdogInfeasible(
        f"{reckoning.count} watchdog{plural} cannot be fed in time: {reckoning}. Use longer watchdogs, fewer devices, "
        "a faster line or a shorter reply_timeout.",
        reckoning.numbers,
    )


def latest_start(watches: Iterable[Fed], takes: Callable[[Fed], float]) -> float:
    """The latest time at which feeding may begin so that none trips: one by one, the earliest deadline first."""
    latest, before = float("inf"), 0.0
    for watch in sorted(watches, key=_over):
        before += takes(watch)
        if watch.over - before < latest:
            latest = watch.over - before
    return latest
