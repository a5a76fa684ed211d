"""What is told of how watchdogs are fed: reports, and warnings in the log."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from rs485bus.bus.watchdog.armed import ArmedWatchdog
from rs485bus.bus.watchdog.reckoning import SHARE, Reckoning

_log = logging.getLogger("rs485bus")


@dataclass(frozen=True, slots=True)
class WatchReport:
    """How one device was fed. Times are seconds."""

    address: int
    timeout: float
    feeds: int
    """Frames sent to feed it."""
    saved: int
    """Frames that other traffic made unnecessary."""
    longest: float
    """The longest time for which it was unheard."""
    trips: int = 0
    """How often it was unheard for its time: it may have stopped itself then."""

    @property
    def margin(self) -> float:
        """The part of its time that was left when it was unheard for longest; below 0 where it may have tripped."""
        return 1 - self.longest / self.timeout


def feeds_expected(seconds: float, timeout: float) -> int:
    """How many feeds a device gets in so many seconds if nobody else talks to it."""
    return int(seconds / (SHARE * timeout))


def warn_of(escape: ArmedWatchdog) -> None:
    """Log that a device was heard only just before its watchdog would have stopped it."""
    _log.warning(
        "unit %d was unheard for %.3f s of the %g s of its watchdog: a margin of %.0f %%, and %d feeds were sent. "
        "It nearly tripped. Use a longer watchdog, and look in bus.stats for what is lost; an event loop that is "
        "blocked feeds nothing.",
        escape.address,
        escape.longest,
        escape.timeout,
        100 * (1 - escape.longest / escape.timeout),
        escape.feeds,
    )


def warn_of_off(address: int) -> None:
    """Log that a write has turned a watchdog off inside of its block."""
    _log.warning(
        "the watchdog of unit %d was turned off by a write, inside of its watchdog block: it stops nothing any more "
        "until a block is entered again.",
        address,
    )


def warn_of_strain(reckoning: Reckoning, slowest: ArmedWatchdog) -> None:
    """Log that feeding takes more than was admitted."""
    _log.warning(
        "the watchdogs can hardly be fed any more: %s. Unit %d is the slowest, with %.0f ms a feed. Everything else "
        "has one turn in three now, and where that is too much the slowest is stopped. Use longer watchdogs, or find "
        "out why it is slow.",
        reckoning,
        slowest.address,
        1000 * slowest.takes,
    )
