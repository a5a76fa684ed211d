"""Arming and releasing watchdogs, and stopping everything. Pure: procedures that the owner drives.

They are the bus' own: a caller that is cancelled while it waits for one loses nothing but its wait.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.burst import takes
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.stopping.halt import Halted, Procedure
from rs485bus.bus.units.adapter import DeviceAdapter, WatchdogRegister
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.watchdog.feeding import ArmedWatchdog, admit
from rs485bus.errors import LimitExceeded, NotSupported
from rs485bus.wire.frames import Request
from rs485bus.wire.timing import LineSettings

_RETRIES = 3
"""How often setting a watchdog is repeated: one that stays on though it should be off trips in the next program."""


@dataclass(frozen=True, slots=True)
class EmergencyReport:
    """How each device ended up after an emergency stop."""

    devices: tuple[Halted, ...]

    @property
    def all_standing(self) -> bool:
        """Every device was read to stand. If not: look at the machine, use the hard-wired stop."""
        return all(device.standing for device in self.devices)

    def __str__(self) -> str:
        if not self.devices:
            return "no device was attached"
        return ", ".join(
            f"{device.family} {device.address} {'standing' if device.standing else 'NOT CONFIRMED STANDING'}"
            for device in self.devices
        )


def check_watchdog(attached: DeviceAdapter, timeout: float) -> int:
    """The milliseconds that a device's watchdog is set to for `timeout` seconds.

    Raises:
        NotSupported: it has none.
        LimitExceeded: its register cannot hold the time.
    """
    watchdog = attached.watchdog
    if watchdog is None:
        raise NotSupported(
            f"{attached.family} {attached.address} has no watchdog: it does not notice when the host is gone. "
            "Cut its power by a safety relay that something else watches."
        )
    milliseconds = round(timeout * 1000) if math.isfinite(timeout) else 0
    if not 1 <= milliseconds <= watchdog.highest:
        raise LimitExceeded(
            f"A watchdog of {timeout:g} s is outside 0.001..{watchdog.highest / 1000:.10g} s for "
            f"{attached.family} {attached.address}."
        )
    return milliseconds


def admit_watchdogs(owner: Owner, devices: Iterable[DeviceAdapter], timeout: float) -> None:
    """Refuse to arm what cannot be fed in time. Raises `WatchdogInfeasible` with the numbers.

    What is admitted is to be armed at once: it counts from now on.
    """
    line, config = owner.pair.line, owner.config
    planned = {device.address: _watch(line, device, timeout, owner.now) for device in devices}
    watches = owner.feeding.with_planned() | planned
    attempts = [
        line.budget(len(request.adu), unit.reply_timeout, request.length)
        for unit in owner.units
        if unit.attached is not None
        for request in unit.attached.reads()[:1]
    ]
    owner.feeding.plan(planned.values(), admit(watches.values(), attempts, config.turnaround))


def arm(owner: Owner, devices: Sequence[DeviceAdapter], timeout: float) -> Procedure[list[Job]]:
    """Set the watchdogs of some devices and feed them from then on. Returns the jobs that failed; none if all is well.

    Where it can be read, what the watchdog was set to before is kept for `release`. Admission comes first
    (`admit_watchdogs`).
    """
    failed = []
    for device in devices:
        watchdog = device.watchdog
        assert watchdog is not None
        unit = owner.units[device.address]
        milliseconds = check_watchdog(device, timeout)
        job = yield from _look_at(watchdog)
        if job is not None and job.outcome is Outcome.REPLY and unit.former is None:
            unit.former = watchdog.decode(job.reply)
        if job is None or (job.outcome is Outcome.REPLY and watchdog.decode(job.reply) != milliseconds):
            unit.rearm = timeout  # from now on it may be armed, whatever it answers
            job = yield from _set(watchdog, milliseconds)
        if job.outcome is not Outcome.REPLY:
            owner.feeding.disarm(device.address)
            failed.append(job)
            continue
        watch = _watch(owner.pair.line, device, timeout, job.sent_at)
        # What the first attempt wrote may be armed since then.
        watch.heard(job.answered_since)
        owner.feeding.arm(watch)
        unit.rearm = timeout
    return failed


def _look_at(watchdog: WatchdogRegister) -> Procedure[Job | None]:
    """Read what a watchdog is set to. None where that cannot be read."""
    request = watchdog.read()
    if request is None:
        return None
    job = Job(request, internal=True)
    yield job
    return job


def _set(watchdog: WatchdogRegister, milliseconds: int) -> Procedure[Job]:
    """Set a watchdog, and read it back where that can be done. Returns the job that tells whether it is set."""
    write = Job(watchdog.write(milliseconds), internal=True, retries=_RETRIES)
    yield write
    if write.outcome is not Outcome.REPLY:
        return write
    back = yield from _look_at(watchdog)
    if back is None or back.outcome is not Outcome.REPLY:
        return back or write
    if watchdog.decode(back.reply) != milliseconds:
        write.outcome = Outcome.REFUSED  # it said yes and did not do it
    return write


def release(owner: Owner, devices: Sequence[DeviceAdapter]) -> Procedure[list[Halted]]:
    """Stop some devices, see each stand, and restore their watchdogs to what they were.

    All are stopped before the first is confirmed. What is not seen standing stays armed, and is not fed any more. A
    watchdog that was on before it was armed is on again, and goes on being fed; one that was never armed is left as it
    is. Returns how each ended up.
    """
    halts = [owner.halt(owner.units[device.address], device.motion, emergency=False) for device in devices]
    halted: list[Halted] = []
    for device, halt in zip(devices, halts, strict=True):
        unit = owner.units[device.address]
        ended: Halted = yield halt
        halted.append(ended)
        if not ended.standing:
            owner.stops_only(unit)
        elif device.watchdog is not None and _may_be_armed(owner, unit):
            yield from _restore(owner, unit, device, device.watchdog)
    return halted


def _may_be_armed(owner: Owner, unit: UnitState) -> bool:
    """Whether its watchdog was armed here and not restored since; perhaps it tripped, and is not fed any more."""
    return unit.rearm is not None or owner.feeding.get(unit.address) is not None


def _restore(owner: Owner, unit: UnitState, device: DeviceAdapter, watchdog: WatchdogRegister) -> Procedure[None]:
    """Set the watchdog of a standing device to what it was before it was armed."""
    former = watchdog.off if unit.former is None else unit.former
    watch = owner.feeding.get(device.address)
    if watch is None or former != round(watch.timeout * 1000):
        job = yield from _set(watchdog, former)
        if job.outcome is not Outcome.REPLY:
            owner.feeding.mute(device.address)
            return
        if former == watchdog.off:
            owner.feeding.disarm(device.address)
            unit.former = None
        else:
            owner.feeding.arm(_watch(owner.pair.line, device, former / 1000, job.sent_at))
    unit.rearm = None


class Lease:
    """An application that is alive says so in time; one that does not has its devices stopped.

    From then on they get nothing but stops until they stand (polls would feed them too), and move only after the
    lease was renewed and they were enabled again.

    Args:
        owner: the bus.
        devices: what is stopped.
        seconds: how long it holds.
    """

    def __init__(self, owner: Owner, devices: Sequence[DeviceAdapter], seconds: float) -> None:
        self._owner = owner
        self._devices = devices
        self._seconds = seconds
        self._until = 0.0
        self._running = False

    def renew(self, now: float) -> None:
        """It holds from now on."""
        self._until = now + self._seconds
        for device in self._devices:
            self._owner.units[device.address].lapsed = False
        if not self._running:
            self._running = True
            self._owner.at(self._until, self._check)

    def end(self) -> None:
        """It is not needed any more."""
        self._until = float("inf")
        for device in self._devices:
            self._owner.units[device.address].lapsed = False

    def _check(self) -> None:
        owner = self._owner
        if self._until > owner.now:
            if self._until < float("inf"):
                owner.at(self._until, self._check)
            return
        self._running = False
        for device in self._devices:
            unit = owner.units[device.address]
            unit.lapsed = True
            unit.locked = f"its lease of {self._seconds:g} s was not renewed"
            owner.stops_only(unit)
            owner.halt(unit, device.motion, emergency=False)
            device.interrupted(0.0, unit.locked)


def left_armed(owner: Owner, devices: Iterable[DeviceAdapter]) -> list[DeviceAdapter]:
    """Of those that were released, and stand: those whose watchdog may still be armed all the same, and is not fed."""
    return [
        device for device in devices if owner.units[device.address].rearm is not None and not device.motion.may_move
    ]


def shut_down(owner: Owner, leave_running: bool) -> Procedure[list[Halted]]:
    """Stop all that may move, and release all that is armed. Returns how each device ended up.

    Args:
        owner: the bus.
        leave_running: turn the watchdogs off, but leave the motors turning.
    """
    devices = []
    for unit in owner.units:
        device = unit.attached
        armed = _may_be_armed(owner, unit)
        if device is None or not (armed or device.motion.may_move):
            continue
        if not leave_running:
            devices.append(device)
        elif armed and device.watchdog is not None:
            yield Job(device.watchdog.write(device.watchdog.off), internal=True)
    return (yield from release(owner, devices))


def emergency_stop(owner: Owner) -> Procedure[EmergencyReport]:
    """Latch, flush, stop every device as fast as it can, and see each stand."""
    owner.gate.latched = True
    units = [unit for unit in owner.units if unit.attached is not None]
    # What may be moving goes first.
    units.sort(key=lambda unit: not (unit.attached is not None and unit.attached.motion.may_move))
    for request in _broadcast_stops(owner, units):
        owner.submit(Job(request, urgency=Urgency.STOP, internal=True, retries=0), owner.now)
    halts = []
    for unit in units:
        assert unit.attached is not None
        unit.locked = "an emergency stop was made"
        owner.stops_only(unit)
        halts.append(owner.halt(unit, unit.attached.motion, emergency=True))
    # The first stop is on its way before the others are told: a long queue takes a while.
    yield owner.now + 0.001
    owner.flush(Reason.EMERGENCY)
    halted = []
    for halt in halts:
        halted.append((yield halt))  # noqa: PERF401 - a comprehension cannot yield
    return EmergencyReport(tuple(halted))


def _broadcast_stops(owner: Owner, units: list[UnitState]) -> list[Request]:
    """The family broadcasts that stop something and hurt nobody."""
    everyone = [unit.attached for unit in owner.units if unit.address]
    known = [attached for attached in everyone if attached is not None]
    if len(known) < len(everyone):
        return []  # what an unknown device would make of it, nobody knows
    requests = {}
    for unit in units:
        assert unit.attached is not None
        request = unit.attached.broadcast_stop()
        if request is not None and all(other.family == unit.attached.family for other in known if other.hears(request)):
            requests[request.adu] = request
    return list(requests.values())


def _watch(line: LineSettings, device: DeviceAdapter, timeout: float, now: float) -> ArmedWatchdog:
    feed = device.reads()[0]
    cost = takes(line, 2 * line.t35, feed)
    return ArmedWatchdog(device.address, timeout, cost, heard_at=now, armed_at=now)
