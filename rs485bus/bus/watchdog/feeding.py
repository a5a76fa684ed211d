"""Which watchdog is due when, and how long its device may take to answer. Pure.

A device has been heard since the *sending* of the last frame it acknowledged: when exactly it saw the frame is not
known, but not earlier than that. It is due when it would have been unheard for a third of its time, and earlier where
several would be due at once, since the pair carries only one feed at a time. Where nothing else waits for the pair,
those that are due soon are fed together: an idle computer wakes up once for all of them.

A feed that is not answered is repeated at once. Where more fails than admission reckons with, the devices that still
answer go first: those that missed a feed get what is left, and those that missed two a half of that at most.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from operator import attrgetter

from rs485bus.bus.watchdog.armed import REVISED, REVISED_BY, ArmedWatchdog, Ledger
from rs485bus.bus.watchdog.reckoning import LOST, SHARE, Reckoning, add_up, admit, latest_start
from rs485bus.bus.watchdog.strain import Strain
from rs485bus.bus.watchdog.tempo import Tempo

__all__ = ["SHARE", "ArmedWatchdog", "Feeding", "admit"]

TOGETHER = 1 / 12
"""The part of a watchdog's time by which its device is fed early, together with others."""
NARROW = 3 / 4
"""The part of a watchdog's time after which it was a narrow escape if the device is heard at last."""
_EARLY = 1.005
"""Devices that were fed one behind the other are due one behind the other. They are begun with a little earlier than
that, so that something else may go between them."""
_due = attrgetter("due")
_takes = attrgetter("takes")
_least_wait = attrgetter("least_wait")
_longest_least_wait = attrgetter("longest_least_wait")
_SOON = float("-inf")
_MUTED = float("inf")


class Feeding:
    """The armed watchdogs of one bus.

    Args:
        turnaround: how long a broadcast may take the wire, in seconds.
    """

    __slots__ = (
        "_company",
        "_free_until",
        "_latest",
        "_live_first_until",
        "_misses",
        "_planned",
        "_rest_until",
        "_tempo",
        "_tripped",
        "_watches",
        "armed",
        "look_at",
        "on_escape",
        "on_strain",
        "over_at",
        "reckoning",
        "slack",
        "strain",
        "turnaround",
    )

    def __init__(self, turnaround: float = 0.0) -> None:
        self.turnaround = turnaround
        """How long a broadcast may take the wire, in seconds."""
        self.armed = False
        """Whether any watchdog is."""
        self._watches: dict[int, ArmedWatchdog] = {}
        self._planned: dict[int, ArmedWatchdog] = {}
        self._tripped: dict[int, Ledger] = {}
        """Of those that are not fed any more."""
        self._company: list[ArmedWatchdog] = []
        """What may be fed together with one that was due, the earliest due last."""
        self._tempo = Tempo()
        self._misses = 0
        """All failures in a row, of all of them."""
        self._live_first_until = _SOON
        """More has failed than admission reckons with, and may do so again until then."""
        self._rest_until = _SOON
        """No feed before, to a device that missed its last two."""
        self._free_until = _SOON
        """Until when the wire may be taken, at least, lest one trips that answers. Not kept exact: as `_latest`."""
        self._latest = _SOON
        """When feeding must begin, at the latest. Not kept exact: hearing a device only ever puts that off."""
        self.look_at = float("inf")
        """When to ask for `due` again. Hearing a device only ever puts that off, so it is not kept exact."""
        self.over_at = float("inf")
        """When to ask for `overdue` again; not kept exact either."""
        self.reckoning: Reckoning | None = None
        """What feeding all of them takes; None while none is armed or about to be."""
        self.strain = Strain()
        self.slack = float("inf")
        """How long one request may take the wire, in seconds, lest a device trips."""
        self.on_escape: Callable[[ArmedWatchdog], None] | None = None
        """Told of each device, once, that was heard only in the last quarter of its time: `longest` says when."""
        self.on_strain: Callable[[Reckoning, ArmedWatchdog], None] | None = None
        """Told when feeds begin to need more than was admitted; and the slowest device."""

    def get(self, address: int) -> ArmedWatchdog | None:
        return self._watches.get(address)

    def all(self) -> list[ArmedWatchdog]:
        return list(self._watches.values())

    def with_planned(self) -> dict[int, ArmedWatchdog]:
        """What is armed, and what is about to be, by address."""
        return {**self._watches, **self._planned}

    def guards_others(self, address: int) -> bool:
        """Whether any watchdog is armed but that of one address."""
        return len(self._watches) > (address in self._watches)

    # What is armed

    def plan(self, watches: Iterable[ArmedWatchdog]) -> None:
        """They are about to be armed, and count from now on."""
        self._planned.update((watch.address, watch) for watch in watches)
        self.reckon()

    def arm(self, watch: ArmedWatchdog) -> None:
        self._planned.pop(watch.address, None)
        self._tripped.pop(watch.address, None)
        self._forget(self._watches.get(watch.address))
        self._watches[watch.address] = watch
        self.armed = True
        self.look_at = self.over_at = _SOON
        self.reckon()

    def disarm(self, address: int) -> None:
        """It is not armed any more, or will not be: how long its device is unheard from now on is no matter."""
        watch = self._take_out(address)
        if watch is not None:
            watch.ledger.heard_at = None

    def trip(self, watch: ArmedWatchdog) -> None:
        """It may have stopped its device. It is not fed any more; how long the device is unheard is still noted."""
        watch.ledger.trips += 1
        self._take_out(watch.address)
        self._tripped[watch.address] = watch.ledger

    def _take_out(self, address: int) -> ArmedWatchdog | None:
        watch = self._watches.pop(address, None)
        self._forget(watch)
        self.armed = bool(self._watches)
        self._planned.pop(address, None)
        self._tripped.pop(address, None)
        self.reckon()
        return watch

    def set_timeout(self, watch: ArmedWatchdog, timeout: float) -> None:
        """The register of an armed watchdog holds another time."""
        watch.set_timeout(timeout)
        self.look_at = self.over_at = _SOON
        self.reckon()

    def reckon(self) -> None:
        """Add up anew what feeding takes, after something has changed. Told if it is more than was admitted."""
        self._latest = self._free_until = _SOON
        watches = [*self._watches.values(), *self._planned.values()]
        if not watches:
            self.reckoning, self.slack = None, float("inf")
            self.strain.ends()
            return
        for watch in self._watches.values():
            watch.cost = watch.takes
        self.reckoning = reckoning = add_up(watches, self.turnaround)
        # What was admitted is not refused because feeding takes longer now.
        self.slack = max(reckoning.slack, reckoning.longest)
        if not self._watches or reckoning.fits:
            self.strain.ends()
        elif not self.strain.holds:
            self.strain.holds = True
            if self.on_strain is not None:
                self.on_strain(reckoning, max(watches, key=_takes))

    def wait_longer(self, address: int, longer: float) -> None:
        """The answers of a device are waited for so many seconds longer from now on."""
        watch = self._watches.get(address)
        if watch is not None:
            watch.attempt += longer
            watch.occupies += longer
            self.reckon()

    # What was heard

    def heard(self, address: int, since: float, at_most: float | None = None, *, late: bool = False) -> None:
        """The device acknowledged a frame that was sent at `since`, or later, but not later than `at_most`.

        What it acknowledges `late` feeds it. But the feeds that it missed have cost their time all the same: those that
        answer in time still go before it.
        """
        at_most = since if at_most is None else at_most
        watch = self._watches.get(address)
        if watch is None:
            if self._tripped and address in self._tripped:
                self._tripped[address].heard(since, at_most)
            return
        if since > watch.heard_at:
            watch.ledger.heard(since, at_most)
            if since - watch.heard_at > NARROW * watch.timeout and not watch.escaped:
                watch.escaped = True
                if self.on_escape is not None:
                    self.on_escape(watch)
            watch.heard(since)
            if not late:
                self._misses -= watch.failures
                watch.failures = 0
            if watch.retry_at != _MUTED:
                watch.retry_at = 0.0

    def fed(self, address: int, turnaround: float) -> None:
        """A feed was answered, after so many seconds."""
        watch = self._watches.get(address)
        if watch is not None:
            self._tempo.measured(watch, watch.overhead + turnaround, self._watches.values())
            changed = watch.takes > REVISED * watch.cost + REVISED_BY or REVISED * watch.takes + REVISED_BY < watch.cost
            if changed or self._tempo.guessed:
                self._tempo.guessed = False
                self.reckon()

    def failed(self, address: int, now: float, cost: float, *, cut: bool = False) -> None:
        """A feed was not answered, and took the wire for `cost` seconds. The first repetition goes at once, later ones
        leave the others room, as far as there is time. One that was cut short for a stop tells nothing of its device,
        unless that had had time to answer."""
        watch = self._watches.get(address)
        if watch is None or watch.retry_at == _MUTED or (cut and cost < watch.least_wait):
            return
        watch.failures += 1
        self._misses += 1
        self.strain.failed()
        watch.retry_at = now
        if watch.failures >= LOST:
            to_spare = watch.over - now - watch.takes - watch.attempt
            watch.retry_at += max(0.0, min(cost, to_spare))
            if self._misses > LOST:
                self._rest_until = now + cost
        if self._misses > LOST:
            self._live_first_until = now + max(watch.timeout for watch in self._watches.values())
        self.look_at = min(self.look_at, watch.retry_at)

    def may_wait(self, address: int, now: float) -> bool:
        """Whether a feed that is on the wire may be cut short and made again, lest anything trips."""
        watch = self._watches.get(address)
        if watch is None:
            return True
        # One that has missed two feeds is hardly there.
        until = self._room(watch) if watch.failures >= LOST else min(self._room(watch), watch.over - watch.takes)
        return now + watch.attempt + self._reserve <= until

    def mute(self, address: int) -> None:
        """Do not feed the device until it is unmuted."""
        watch = self._watches.get(address)
        if watch is not None:
            self._forget(watch)
            watch.retry_at = _MUTED

    def unmute(self, address: int) -> None:
        """Feed it again, if it was muted."""
        watch = self._watches.get(address)
        if watch is not None and watch.retry_at == _MUTED:
            watch.retry_at = 0.0
            self.look_at = _SOON

    # What is due

    def due(self, now: float) -> ArmedWatchdog | None:
        """The watch to feed now, the earliest due first; None while there is time."""
        if now < self.look_at:
            return None
        as_admitted = now >= self._live_first_until
        start, before, first = float("inf"), 0.0, None
        watches = sorted(self._watches.values(), key=_due)
        for watch in watches:
            if watch.failures and not as_admitted:
                continue
            at = watch.retry_at
            if at <= now:
                # The last moment at which this one and all due before it can still be fed in time, one by one.
                at = watch.due - before
                before += _EARLY * watch.takes
                first = first or watch
                if at <= now:
                    self._company = watches[::-1]
                    return first
            if at < start:
                start = at
        if not as_admitted:
            missing, again = self._missing(now)
            if missing is not None:
                return missing
            start = min(start, again)
        self.look_at = start
        if now < self.over_at:  # else that is to be asked first
            self.over_at = min((watch.over for watch in watches), default=float("inf"))
        return None

    def _missing(self, now: float) -> tuple[ArmedWatchdog | None, float]:
        """Of the devices that missed a feed the one to feed next; or else when to ask again. More has failed than
        admission reckons with: none of the others must trip for them."""
        missing = [watch for watch in self._watches.values() if watch.failures and watch.retry_at != _MUTED]
        missing.sort(key=lambda watch: (watch.failures >= LOST, watch.over))
        room, again = self._room() - self._reserve, float("inf")
        for watch in missing:
            at = max(watch.retry_at, self._rest_until) if watch.failures >= LOST else watch.retry_at
            if at > now:
                again = min(again, at)
            elif now + watch.least_wait <= room:
                return watch, now
        return None, again

    def _room(self, but: ArmedWatchdog | None = None) -> float:
        """Until when the wire may be taken lest one of those trips that answer (but for one of them)."""
        live = [watch for watch in self._watches.values() if not watch.failures and watch is not but]
        return latest_start(live, _least_wait)

    @property
    def _reserve(self) -> float:
        """The time that admission leaves to attempts that fail."""
        return 0.0 if self.reckoning is None else self.reckoning.failed

    def wait(self, watch: ArmedWatchdog, now: float) -> float:
        """How long the wire may be taken by an attempt to feed a device, if it is not answered.

        That is all that its reply may take, as long as the others can be fed after it even if none of them answers.
        """
        if not self._misses:
            if now + watch.attempt > self._free_until:
                self._free_until = latest_start(self._watches.values(), _longest_least_wait)
            if now + watch.attempt <= self._free_until:
                return watch.attempt
        room = self._room(watch) - (self._reserve if watch.failures and now < self._live_first_until else 0.0)
        return min(max(room - now, watch.least_wait), watch.attempt)

    def soon(self, now: float) -> ArmedWatchdog | None:
        """The watch to feed now though there is time, because others were just fed; None if there is none."""
        while self._company:
            watch = self._company[-1]
            early = watch.due - TOGETHER * watch.timeout
            alive = watch.retry_at <= now and not watch.failures
            if early <= now and alive and self._watches.get(watch.address) is watch:
                return watch
            self._company.pop()
        return None

    def first(self, now: float) -> ArmedWatchdog | None:
        """As `soon`, where no other is due before that one: `due` would say nothing else, and takes longer."""
        watch = None if self._misses else self.soon(now)
        return watch if watch is not None and watch.due == min(map(_due, self._watches.values())) else None

    def next_at(self, now: float) -> float:
        """When the next watch is to be fed, if nothing else waits for the wire."""
        return self.look_at if self.soon(now) is None and self.due(now) is None else now

    def overdue(self, now: float) -> list[ArmedWatchdog]:
        """The watches whose time is over."""
        if now < self.over_at:
            return []
        self.over_at = min((watch.over for watch in self._watches.values() if watch.over > now), default=float("inf"))
        return [watch for watch in self._watches.values() if watch.over <= now]

    # What else may go, where not all is well

    @property
    def pressed(self) -> bool:
        """Whether something may trip if anything else takes the wire: feeds failed, or need more than was admitted."""
        return self._misses > 0 or self.strain.presses

    def affords(self, seconds: float, now: float) -> bool:
        """Whether the wire may be taken for so long lest a device trips that has missed two feeds at most."""
        if now + seconds > self._latest:
            hopeful = [watch for watch in self._watches.values() if watch.failures <= LOST and watch.retry_at != _MUTED]
            self._latest = latest_start(hopeful, _takes)
        return now + seconds <= self._latest

    @property
    def burst_slack(self) -> float:
        """How long a burst may take the wire, in seconds. It goes before feeds that are due: each device may be one of
        them, and one that the burst starts may have to be fed once more meanwhile."""
        return self.slack if self.reckoning is None else self.slack - self.reckoning.feeds

    def spares(self, seconds: float, now: float) -> bool:
        """As `affords`, and two attempts may fail besides, where all is well."""
        return self.affords(seconds + (0.0 if self.pressed else self._reserve), now)

    def hopeless(self, now: float) -> ArmedWatchdog | None:
        """The device that must be given up now; see `Strain`."""
        live = (watch for watch in self._watches.values() if not watch.failures and watch.retry_at != _MUTED)
        return self.strain.hopeless(live, 0.0 if self.reckoning is None else self.reckoning.longest, now)

    def _forget(self, watch: ArmedWatchdog | None) -> None:
        if watch is not None:
            self._misses -= watch.failures
            watch.failures = 0
