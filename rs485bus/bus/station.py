"""What the owner knows of each address: its device, what it owes, whether it answers, whether it is being stopped."""

from __future__ import annotations

from collections.abc import Iterator

from rs485bus.bus.attached import Attached
from rs485bus.bus.job import Job
from rs485bus.bus.late import LateReplies
from rs485bus.bus.motion import NEVER
from rs485bus.bus.reach import Listening, Reach
from rs485bus.bus.stopping import Halt
from rs485bus.wire.frames import Request, read_holding


class Station:
    """One address on the pair."""

    __slots__ = (
        "address",
        "attached",
        "former",
        "guarded",
        "halt",
        "lapsed",
        "last_read",
        "late",
        "late_reply_window",
        "locked",
        "muzzled",
        "reach",
        "rearm",
        "reply_timeout",
        "silent_until",
    )

    def __init__(self, address: int, in_order: bool, reply_timeout: float, late_reply_window: float) -> None:
        self.address = address
        self.reply_timeout = reply_timeout
        self.late_reply_window = late_reply_window
        self.attached: Attached | None = None
        self.late = LateReplies(in_order)
        self.reach = Reach()
        self.halt: Halt | None = None
        """The stop that is not confirmed yet."""
        self.last_read: Request | None = None
        self.muzzled = False
        """Nothing but stops until it stands: neither polled nor fed."""
        self.silent_until = NEVER
        """No frame at all before this time."""
        self.locked = ""
        """Why it moves only after it was enabled again; empty if it need not be."""
        self.lapsed = False
        """Its lease was not renewed, nor has it been since."""
        self.rearm: float | None = None
        """The watchdog time, in seconds, to arm it with when it is."""
        self.guarded = False
        """A watchdog block holds it."""
        self.former: int | None = None
        """What its watchdog was set to before it was armed here, in ms, if that could be read."""

    def attach(self, attached: Attached | None) -> None:
        """A device is known at this address, with timing of its own if it has any."""
        self.attached = attached
        if attached is not None and attached.reply_timeout is not None:
            self.reply_timeout = attached.reply_timeout
        if attached is not None and attached.late_reply_window is not None:
            self.late_reply_window = attached.late_reply_window

    def harmless_read(self) -> Request:
        """A read to see whether anybody answers: the device's own, or the last one it was asked."""
        if self.attached is not None:
            return self.attached.reads()[0]
        return self.last_read or read_holding(self.address, 0, 1)


class Stations:
    """All addresses that were ever asked or attached.

    Args:
        in_order: replies come in the order of the requests.
        reply_timeout: seconds a device may take to answer, where it has no time of its own.
        late_reply_window: seconds an unanswered request may still be answered after that.
    """

    __slots__ = ("_args", "_by_address", "_lost", "_owing", "listening")

    def __init__(self, in_order: bool, reply_timeout: float, late_reply_window: float) -> None:
        self._args = (in_order, reply_timeout, late_reply_window)
        self._by_address: dict[int, Station] = {}
        self._owing: set[Station] = set()
        self._lost: set[Station] = set()
        self.listening = Listening()

    def __getitem__(self, address: int) -> Station:
        station = self._by_address.get(address)
        if station is None:
            station = self._by_address[address] = Station(address, *self._args)
        return station

    def __iter__(self) -> Iterator[Station]:
        return iter(list(self._by_address.values()))

    def late(self, now: float) -> list[LateReplies]:
        """What may still arrive, from whomever."""
        if not self._owing:
            return []
        for station in self._owing:
            station.late.expire(now)
        self._owing = {station for station in self._owing if station.late}
        return [station.late for station in self._owing]

    def owes(self, station: Station, job: Job, deadline: float) -> None:
        """The job's latest attempt got no reply within its budget."""
        station.late.unanswered(job, deadline + station.late_reply_window)
        self._owing.add(station)

    def answered(self, station: Station) -> None:
        """The unit answered: it is not offline."""
        if station.reach.answered():
            self._lost.discard(station)

    def unanswered(self, station: Station, job: Job, now: float) -> None:
        """The job's latest attempt was not answered in its time."""
        listened = now - job.sent_at
        if station.reach.offline:
            self.listening.spend(listened, now)
            return
        flapping = sum(other.reach.flaps(now) for other in self._by_address.values())
        if station.reach.unanswered(now, listened, flapping):
            self._lost.add(station)

    def missed(self, station: Station, now: float, limit: int) -> None:
        """A request to the unit ended without an answer."""
        if station.reach.missed(now, limit):
            self._lost.add(station)

    def to_probe(self, now: float) -> Station | None:
        """The offline unit to look for now; None while there is none, or no time to spend on it."""
        if self.to_probe_at(now) > now:
            return None
        station = min(self._lost, key=lambda station: station.reach.probe_at)
        # Whoever was looked for goes behind the others.
        station.reach.probe_at = now
        return station

    def to_probe_at(self, now: float) -> float:
        """When to look for an offline unit."""
        if not self._lost:
            return float("inf")
        return max(self.listening.free_at(now), min(station.reach.probe_at for station in self._lost))
