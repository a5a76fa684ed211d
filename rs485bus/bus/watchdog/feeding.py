"""Which watchdog is due when, and whether the set can be fed at all. Pure.

A device has been heard since the *sending* of the last frame it acknowledged: when exactly it saw the frame is not
known, but not earlier than that. It is due when it would have been unheard for a third of its time, and earlier where
several would be due at once, since the pair carries only one feed at a time. Where nothing else waits for the pair,
those that are due soon are fed together: an idle computer wakes up once for all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from operator import attrgetter

from rs485bus.errors import WatchdogInfeasible

SHARE = 1 / 3
"""The part of a watchdog's time after which its device is due."""
TOGETHER = 1 / 12
"""The part of a watchdog's time by which its device is fed early, together with others."""
NARROW = 3 / 4
"""The part of a watchdog's time after which it was a narrow escape if the device is heard at last."""
_due = attrgetter("due")
_SOON = float("-inf")
_MUTED = float("inf")


@dataclass(slots=True)
class ArmedWatchdog:
    """One armed watchdog; all times are seconds on the owner's clock."""

    address: int
    timeout: float
    cost: float
    """How long one feed may take on the wire, if it is answered."""
    heard_at: float
    armed_at: float
    takes: float = field(init=False)
    """How long one took of late."""
    feeds: int = 0
    """Feeds sent."""
    longest: float = 0.0
    """The longest time the device was unheard."""
    failures: int = 0
    """Feeds in a row that were not answered."""
    retry_at: float = 0.0
    """Not to be fed before, because a feed just failed."""
    escaped: bool = False
    """It was heard only in the last quarter of its time, once."""

    due: float = field(init=False)

    def __post_init__(self) -> None:
        self.takes = self.cost
        self.heard(self.heard_at)

    def heard(self, since: float) -> None:
        """It acknowledged a frame that was sent at `since`."""
        self.heard_at = since
        self.due = since + SHARE * self.timeout

    @property
    def over(self) -> float:
        """When the device trips unless it is heard."""
        return self.heard_at + self.timeout


class Feeding:
    """The armed watchdogs of one bus."""

    __slots__ = ("_company", "_over_at", "_planned", "_watches", "look_at", "on_escape", "slack")

    def __init__(self) -> None:
        self._watches: dict[int, ArmedWatchdog] = {}
        self._planned: dict[int, ArmedWatchdog] = {}
        self._company: list[ArmedWatchdog] = []
        """What may be fed together with one that was due, the earliest due last."""
        self.look_at = float("inf")
        """When to ask for `due` again. Hearing a device only ever puts that off, so it is not kept exact."""
        self._over_at = float("inf")
        self.slack = float("inf")
        """How long one request may take the wire, in seconds, lest a device trips."""
        self.on_escape: Callable[[ArmedWatchdog], None] | None = None
        """Told of each device, once, that was heard only in the last quarter of its time: `longest` says when."""

    def get(self, address: int) -> ArmedWatchdog | None:
        return self._watches.get(address)

    def all(self) -> list[ArmedWatchdog]:
        return list(self._watches.values())

    def with_planned(self) -> dict[int, ArmedWatchdog]:
        """What is armed, and what is about to be, by address."""
        return {**self._watches, **self._planned}

    @property
    def armed(self) -> bool:
        """Whether any watchdog is."""
        return bool(self._watches)

    def plan(self, watches: Iterable[ArmedWatchdog], slack: float) -> None:
        """They are about to be armed: nothing may take the wire for longer than `slack` from now on."""
        self._planned.update((watch.address, watch) for watch in watches)
        self.slack = slack

    def arm(self, watch: ArmedWatchdog) -> None:
        self._planned.pop(watch.address, None)
        self._watches[watch.address] = watch
        self.look_at = self._over_at = _SOON

    def disarm(self, address: int) -> None:
        """It is not armed any more, or will not be."""
        self._watches.pop(address, None)
        self._planned.pop(address, None)
        if not self._watches and not self._planned:
            self.slack = float("inf")

    def heard(self, address: int, since: float) -> None:
        """The device acknowledged a frame that was sent at `since`."""
        watch = self._watches.get(address)
        if watch is not None and since > watch.heard_at:
            watch.longest = max(watch.longest, since - watch.heard_at)
            watch.heard(since)
            if watch.longest > NARROW * watch.timeout and not watch.escaped:
                watch.escaped = True
                if self.on_escape is not None:
                    self.on_escape(watch)
            watch.failures = 0
            if watch.retry_at != _MUTED:
                watch.retry_at = 0.0

    def fed(self, address: int, took: float) -> None:
        """A feed was answered, and took the wire for so many seconds."""
        watch = self._watches.get(address)
        if watch is not None:
            watch.takes += (took - watch.takes) / 4

    def failed(self, address: int, now: float, cost: float) -> None:
        """A feed was not answered. The first repetition goes at once, later ones leave the others room."""
        watch = self._watches.get(address)
        if watch is not None and watch.retry_at != _MUTED:
            watch.failures += 1
            watch.retry_at = now if watch.failures == 1 else now + cost
            self.look_at = min(self.look_at, watch.retry_at)

    def mute(self, address: int) -> None:
        """Do not feed the device until it is unmuted."""
        watch = self._watches.get(address)
        if watch is not None:
            watch.retry_at = _MUTED

    def unmute(self, address: int) -> None:
        """Feed it again, if it was muted."""
        watch = self._watches.get(address)
        if watch is not None and watch.retry_at == _MUTED:
            watch.retry_at = 0.0
            self.look_at = _SOON

    def due(self, now: float) -> ArmedWatchdog | None:
        """The watch to feed now, the earliest due first; None while there is time."""
        if now < self.look_at:
            return None
        start, before, first = float("inf"), 0.0, None
        watches = sorted(self._watches.values(), key=_due)
        for watch in watches:
            at = watch.retry_at
            if at <= now:
                # The last moment at which this one and all due before it can still be fed in time, one by one.
                at = watch.due - before
                before += watch.takes
                first = first or watch
                if at <= now:
                    self._company = watches[::-1]
                    return first
            if at < start:
                start = at
        self.look_at = start
        return None

    def soon(self, now: float) -> ArmedWatchdog | None:
        """The watch to feed now though there is time, because others were just fed; None if there is none."""
        while self._company:
            watch = self._company[-1]
            early = watch.due - TOGETHER * watch.timeout
            if early <= now and watch.retry_at <= now and self._watches.get(watch.address) is watch:
                return watch
            self._company.pop()
        return None

    def next_at(self, now: float) -> float:
        """When the next watch is to be fed, if nothing else waits for the wire."""
        return self.look_at if self.soon(now) is None and self.due(now) is None else now

    def overdue(self, now: float) -> list[ArmedWatchdog]:
        """The watches whose time is over."""
        if now < self._over_at:
            return []
        self._over_at = min((watch.over for watch in self._watches.values() if watch.over > now), default=float("inf"))
        return [watch for watch in self._watches.values() if watch.over <= now]

    @property
    def over_at(self) -> float:
        """When to ask for `overdue` again; not kept exact either."""
        return self._over_at


def admit(watches: Iterable[ArmedWatchdog], attempts: Iterable[float], longest: float) -> float:
    """Refuse a set of watches that cannot be fed in time; return how long the wire may be taken at once, in seconds.

    Args:
        watches: all that would be armed, those armed already included.
        attempts: how long a failed attempt takes, of each device on the bus.
        longest: how long the wire can be taken by something that cannot be interrupted.

    Raises:
        WatchdogInfeasible: one feed each, the two slowest failed attempts and `longest` do not fit between the time
            a device is due and the time it trips.
    """
    watches = list(watches)
    feeds = sum(watch.cost for watch in watches)
    failed = sum(sorted(attempts)[-2:])
    shortest = min(watches, key=lambda watch: watch.timeout)
    available = (1 - SHARE) * shortest.timeout
    needed = feeds + failed + longest
    if needed <= available:
        return available - feeds - failed
    plural = "" if len(watches) == 1 else "s"
    raise WatchdogInfeasible(
        f"{len(watches)} watchdog{plural} cannot be fed in time: one feed each takes {1000 * feeds:.0f} ms, the two "
        f"slowest failed attempts {1000 * failed:.0f} ms, the longest transaction {1000 * longest:.0f} ms, in all "
        f"{1000 * needed:.0f} ms. Unit {shortest.address} trips {1000 * available:.0f} ms after it is due (two "
        f"thirds of its {1000 * shortest.timeout:g} ms). Use longer watchdogs, fewer devices, a faster line or a "
        "shorter reply_timeout.",
        {"feeds": feeds, "failed": failed, "longest": longest, "needed": needed, "available": available},
    )
