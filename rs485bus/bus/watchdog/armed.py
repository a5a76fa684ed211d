"""One armed watchdog, and what is remembered of its feeding. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

from rs485bus.bus.watchdog.reckoning import SHARE

_SLOWER = 1.25
MARGIN = 0.001
"""Seconds by which an answer may be late that is waited for as briefly as can be; and a quarter of a feed."""
REVISED, REVISED_BY = 1.25, 0.001
"""By how much a feed must take longer than was reckoned with, to reckon anew: this many times, and seconds."""


@dataclass(slots=True)
class Ledger:
    """How one device was fed, also across trips. A watchdog block keeps one for each of its devices."""

    feeds: int = 0
    """Feeds sent."""
    longest: float = 0.0
    """The longest time, in seconds, for which the device was unheard."""
    trips: int = 0
    """How often the device was unheard for its time, or may have stopped itself for another reason."""
    heard_at: float | None = None
    """Since when it is unheard, on the owner's clock; None if it was never heard."""

    def heard(self, since: float, at_most: float) -> None:
        """It acknowledged a frame that was sent at `since`, or later, but not later than `at_most`."""
        if self.heard_at is None:
            self.heard_at = since
        elif since > self.heard_at:
            if at_most - self.heard_at > self.longest:
                self.longest = at_most - self.heard_at
            self.heard_at = since

    def longest_until(self, now: float) -> float:
        """The longest time for which it was unheard until now."""
        return self.longest if self.heard_at is None else max(self.longest, now - self.heard_at)


@dataclass(slots=True)
class ArmedWatchdog:
    """One armed watchdog; all times are seconds on the owner's clock."""

    address: int
    timeout: float
    cost: float
    """How long one feed takes the wire, if it is answered. Admission reckons with it."""
    heard_at: float
    armed_at: float
    overhead: float = 0.0
    """The part of that in which the device is not waited for: the bytes, and the silences."""
    attempt: float = 0.0
    """How long one feed takes the wire, if it is not answered. After a failure it may be a longer read."""
    occupies: float = 0.0
    """How long the longest request of its facade may take the wire."""
    ledger: Ledger = field(default_factory=Ledger)
    takes: float = field(init=False)
    """How long one feed is expected to take."""
    known: float = field(init=False)
    """How long it took of late, a single slow one left out."""
    latest: float = field(init=False)
    """How long the latest one took."""
    guessed: bool = False
    """What it is expected to take was concluded from feeds of other devices."""
    failures: int = 0
    """Feeds in a row that were not answered."""
    retry_at: float = 0.0
    """Not to be fed before, because a feed just failed."""
    escaped: bool = False
    """It was heard only in the last quarter of its time, once."""

    due: float = field(init=False)
    """When it is to be fed."""
    over: float = field(init=False)
    """When the device trips unless it is heard."""

    def __post_init__(self) -> None:
        self.takes = self.known = self.latest = self.cost
        self.ledger.heard(self.heard_at, self.heard_at)
        self.heard(self.heard_at)

    def heard(self, since: float) -> None:
        """It acknowledged a frame that was sent at `since`."""
        self.heard_at = since
        self.due = since + SHARE * self.timeout
        self.over = since + self.timeout

    def measured(self, took: float) -> None:
        """One feed took so many seconds."""
        took, self.latest = min(took, max(self.latest, self.known)), took
        # A device that has become slow is known to be slow at once, and to be quick again by and by.
        self.known += (took - self.known) * (1.0 if took > _SLOWER * self.known else 0.25)
        self.takes, self.guessed = self.known, False

    def set_timeout(self, timeout: float) -> None:
        """Its register holds another time."""
        self.timeout = timeout
        self.heard(self.heard_at)

    @property
    def feeds(self) -> int:
        """Feeds sent."""
        return self.ledger.feeds

    @property
    def longest(self) -> float:
        """The longest time the device was unheard."""
        return self.ledger.longest

    @property
    def least_wait(self) -> float:
        """How long a feed must have the wire, at the least, to be answered."""
        return min(1.25 * self.takes + MARGIN, max(self.attempt, self.takes))

    @property
    def longest_least_wait(self) -> float:
        """How long that can become before the feeds of all devices are added up anew."""
        takes = REVISED * self.cost + REVISED_BY
        wait, longest = 1.25 * takes + MARGIN, self.attempt if self.attempt > takes else takes
        return wait if wait < longest else longest
