"""All addresses of a pair: who owes a reply, who is lost, and what the line loses. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rs485bus.bus.config import BusConfig
from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.schedule.job import Job, Urgency
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.bus.units.probing import IDLE_EVERY, IDLE_SHARE, ProbeBudget
from rs485bus.bus.units.reachability import share_lost
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.errors import AddressInUse
from rs485bus.wire.exceptions import ACCEPTED
from rs485bus.wire.frames import Request


class _ByAddress(dict[int, UnitState]):
    """The units by address; one that is asked for first is there then."""

    __slots__ = ("_args",)

    def __init__(self, *args: Any) -> None:
        super().__init__()
        self._args = args

    def __missing__(self, address: int) -> UnitState:
        unit = self[address] = UnitState(address, *self._args)
        return unit


class UnitStates:
    """All addresses that were ever asked or attached.

    Args:
        config: how the bus behaves.
        in_order: replies come in the order of the requests.
        late_reply_window: seconds an unanswered request may still be answered after its time.
        native: each reply tells for certain which request it answers.
    """

    __slots__ = ("_idling", "_in_passing", "_offline_after", "by_address", "doubted", "listening", "lost", "owing")

    def __init__(self, config: BusConfig, in_order: bool, late_reply_window: float, *, native: bool = False) -> None:
        self._offline_after = config.offline_after
        self.by_address = _ByAddress(in_order, config.reply_timeout, late_reply_window, native)
        self.owing: set[UnitState] = set()
        """Those that may owe a reply."""
        self.lost: set[UnitState] = set()
        self.doubted: set[UnitState] = set()
        """Those that left something unanswered that they may never answer."""
        self.listening = ProbeBudget()
        self._idling = ProbeBudget(IDLE_SHARE, 0.0)
        self._in_passing: UnitState | None = None
        """The unit that is looked for only because nothing else waits for the pair."""

    def __getitem__(self, address: int) -> UnitState:
        return self.by_address[address]

    def __iter__(self) -> Iterator[UnitState]:
        return iter(list(self.by_address.values()))

    def late(self, now: float) -> list[PendingReplies]:
        """What may still arrive, from whomever."""
        if not self.owing:
            return []
        for unit in self.owing:
            unit.expire(now)
        self.owing = {unit for unit in self.owing if unit.late}
        return [unit.late for unit in self.owing]

    @property
    def devices(self) -> list[DeviceAdapter]:
        """The devices attached."""
        return [unit.attached for unit in self.by_address.values() if unit.attached is not None]

    def attach(self, attached: DeviceAdapter) -> None:
        """A device takes its address.

        Raises:
            AddressInUse: there is one already.
        """
        unit = self[attached.address]
        if unit.attached is not None:
            raise AddressInUse(
                f"Address {attached.address} has a facade already ({unit.attached.family}). "
                "Use that one in all places; two would not know of each other's moves."
            )
        unit.attach(attached)

    def family(self, address: int) -> str | None:
        """The family of the device attached at an address; None if there is none, or for the broadcast address."""
        attached = self[address].attached if address else None
        return None if attached is None else attached.family

    def owes(self, unit: UnitState, job: Job, deadline: float) -> None:
        """The job's latest attempt got no reply within its budget, or one that says that it was accepted only."""
        unit.late.unanswered(job, deadline + unit.late_reply_window, accepted=job.code == ACCEPTED)
        self.owing.add(unit)

    def tell_sent(self, job: Job, at: float) -> None:
        """Tell the devices that a write concerns that it goes out."""
        for unit in self if job.is_broadcast else (self[job.address],):
            if unit.attached is not None and (not job.is_broadcast or unit.hears(job.request)):
                unit.tell(unit.attached.on_sent, job.request, at)

    def answered(self, unit: UnitState, request: Request, now: float) -> None:
        """The unit answered a request: it is not offline."""
        if unit.asked_in_vain:
            unit.ends_silence(now)
        if request is not unit.answers.latest:
            unit.answers.add(request)
        if unit.reach.answered():
            self.lost.discard(unit)
        if self.doubted:
            self.doubted.discard(unit)

    def heard(self, unit: UnitState, now: float) -> None:
        """The unit gave a sign of life that answers nothing that is waited for."""
        if unit.asked_in_vain:
            unit.ends_silence(now)
        if unit.reach.heard(now):
            self.lost.discard(unit)

    def unanswered(self, unit: UnitState, job: Job, now: float) -> None:
        """The job's latest attempt was not answered in its time."""
        listened, request = now - job.sent_at, job.request
        if not job.internal:
            unit.answers.missed(request)
        if unit.reach.offline:
            self._idling.spend(listened, now)
            if unit is not self._in_passing:
                self.listening.spend(listened, now)
            self._in_passing = None
        elif job is not unit.question and job.urgency is not Urgency.STOP and unit.may_never_answer(request):
            unit.reach.doubted(now, listened)
            if unit.reach.in_doubt and unit.halt is None:  # one that is being stopped is asked anyway
                self.doubted.add(unit)
        else:
            flapping = sum(other.reach.flaps(now) for other in self.by_address.values())
            unit.reach.unanswered(now, listened, flapping, self._share_lost())

    def missed(self, unit: UnitState, now: float) -> None:
        """A request to the unit ended without an answer."""
        if unit.reach.missed(now, self._offline_after):
            self.lost.add(unit)
            self.doubted.discard(unit)

    def to_probe(self, now: float, *, idle: bool = False) -> UnitState | None:
        """The unit to look for now; None while there is none, or no time to spend on it.

        `idle`: nothing else waits for the pair.
        """
        if not (self.lost or self.doubted) or self.to_probe_at(now, idle=idle) > now:
            return None
        if self.doubted:
            unit = self.doubted.pop()
            unit.reach.asked_for_what_it_answers()
            return unit
        # Whoever was looked for goes behind the others.
        if self.to_probe_at(now) > now:
            unit = self._in_passing = min(self.lost, key=lambda unit: unit.reach.probed_at)
        else:
            unit, self._in_passing = min(self.lost, key=lambda unit: unit.reach.probe_at), None
            unit.reach.probe_at = now
        unit.reach.probed_at = now
        return unit

    def to_probe_at(self, now: float, *, idle: bool = False) -> float:
        """When to look for a unit."""
        if self.doubted:
            return now
        if not self.lost:
            return float("inf")
        busy_at = max(self.listening.free_at(now), min(unit.reach.probe_at for unit in self.lost))
        if not idle:
            return busy_at
        oldest = min(unit.reach.probed_at for unit in self.lost)
        return min(busy_at, max(self._idling.free_at(now), oldest + IDLE_EVERY))

    def _share_lost(self) -> float:
        """What the line loses, by what all units were asked of late."""
        counts = [unit.reach.loss.counts for unit in self.by_address.values()]
        return share_lost(sum(lost for lost, _ in counts), sum(answered for _, answered in counts))
