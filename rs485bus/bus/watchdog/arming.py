"""Arming watchdogs: measure, admit, set. Pure: a procedure that the owner drives, and that can be cancelled.

Whoever is cancelled while it waits for one loses nothing but its wait: it says so, and then releases what was armed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median

from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.bus.stopping.halt import Procedure
from rs485bus.bus.units.adapter import DeviceAdapter, WatchdogRegister
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.watchdog.armed import ArmedWatchdog
from rs485bus.bus.watchdog.reckoning import LOST, admit
from rs485bus.bus.watchdog.settings import check_watchdog, look_at, patient, set_watchdog
from rs485bus.errors import WatchdogInfeasible

_MEASURED_AGAIN = 2
"""How often each device is asked once more, where what the first answers took would not be admitted: one of them may
have been slow by chance."""


@dataclass(slots=True)
class Armed:
    """How arming ended."""

    failed: list[Job] = field(default_factory=list)
    """What was not answered, or was refused."""
    infeasible: WatchdogInfeasible | None = None
    """Why they cannot be fed in time. Then nothing was armed."""


class Arming:
    """The arming of some devices.

    Args:
        owner: the bus.
        devices: what to arm.
        timeout: seconds.
        only_feed: write nothing: feed each device by the time that its register holds, if it is on.
    """

    def __init__(
        self, owner: Owner, devices: Sequence[DeviceAdapter], timeout: float, *, only_feed: bool = False
    ) -> None:
        self._owner = owner
        self._devices = devices
        self._timeout = timeout
        self._only_feed = only_feed
        self._cancelled = False
        self._took: dict[int, list[float]] = {device.address: [] for device in devices}
        self._job: Job | None = None

    def cancel(self) -> None:
        """Begin nothing new. What is on the wire is waited for; then it ends."""
        self._cancelled = True
        if self._job is not None:
            self._owner.cancel(self._job, self._owner.now)

    @property
    def _is_over(self) -> bool:
        return self._cancelled or self._owner.gate.closing

    def run(self) -> Procedure[Armed]:
        """Measure how long each device takes to answer, admit them, and arm them one by one."""
        owner, ended = self._owner, Armed()
        if not (yield from self._measure(ended)):
            return ended
        try:
            admit_watchdogs(owner, self._devices, self._timeout, self.turnarounds)
        except WatchdogInfeasible:
            for _ in range(_MEASURED_AGAIN):
                if not (yield from self._measure(ended)):
                    return ended
            try:
                admit_watchdogs(owner, self._devices, self._timeout, self.turnarounds)
            except WatchdogInfeasible as error:
                ended.infeasible = error
                return ended
        try:
            for device in self._devices:
                job = None if self._is_over else (yield from self._arm(device))
                if job is not None and job.outcome is not Outcome.REPLY:
                    ended.failed.append(job)
        finally:
            for device in self._devices:
                if owner.feeding.get(device.address) is None:
                    owner.feeding.disarm(device.address)  # it counts no more
        return ended

    def _measure(self, ended: Armed) -> Procedure[bool]:
        """Ask each device something harmless. False if one does not answer, or it was cancelled."""
        for device in self._devices:
            if self._is_over:
                return False
            request = self._owner.units[device.address].reads()[0]
            job = self._job = patient(self._owner, request)
            yield job
            self._job = None
            if job.outcome is not Outcome.REPLY:
                ended.failed.append(job)
                return False
            if job.answered_since == job.sent_at:
                air = self._owner.pair.line.airtime(len(request.adu) + request.length)
                self._took[device.address].append(max(0.0, job.ended_at - job.sent_at - air))
        return not self._is_over

    @property
    def turnarounds(self) -> dict[int, float]:
        """Seconds that each device took before it answered, by address."""
        return {address: median(took) for address, took in self._took.items() if took}

    def _arm(self, device: DeviceAdapter) -> Procedure[Job | None]:
        """Arm one device. Returns the job that tells whether it is armed; None if it was cancelled."""
        arming = _feed if self._only_feed else arm_one
        steps = arming(self._owner, device, self._timeout, self.turnarounds.get(device.address))
        sent: object = None
        while True:
            try:
                job = steps.send(sent)
            except StopIteration as end:
                self._job = None
                result: Job = end.value
                return result
            self._job = job if isinstance(job, Job) else None
            sent = yield job


def admit_watchdogs(
    owner: Owner,
    devices: Iterable[DeviceAdapter],
    timeout: float,
    turnarounds: Mapping[int, float] | None = None,
) -> None:
    """Refuse to arm what cannot be fed in time. What is admitted is to be armed at once: it counts from now on.

    Arguments and errors as for `check_feasible`.
    """
    owner.feeding.plan(check_feasible(owner, devices, timeout, turnarounds))


def check_feasible(
    owner: Owner,
    devices: Iterable[DeviceAdapter],
    timeout: float,
    turnarounds: Mapping[int, float] | None = None,
) -> list[ArmedWatchdog]:
    """Refuse what cannot be fed in time; return the watchdogs as they would be armed.

    Args:
        owner: the bus.
        devices: what is to be armed.
        timeout: seconds.
        turnarounds: seconds that each device takes before it answers, by address. None where that was not measured
            yet: refused is then only what could not be fed however quickly they answer.

    Raises:
        WatchdogInfeasible: with the numbers.
    """
    quick = turnarounds or {}
    planned = {
        device.address: owner.watchdogs.make(
            owner.units[device.address], timeout, owner.now, quick.get(device.address, 0.0)
        )
        for device in devices
    }
    watches = list((owner.feeding.with_planned() | planned).values())
    attempts = [watch.attempt for watch in watches for _ in range(LOST)]
    longest = max(owner.feeding.turnaround, *(watch.occupies for watch in watches))
    admit(watches, attempts, longest, measured=turnarounds is not None)
    return list(planned.values())


def arm(owner: Owner, devices: Sequence[DeviceAdapter], timeout: float) -> Procedure[list[Job]]:
    """Set the watchdogs of some devices and feed them from then on. Returns the jobs that failed; none if all is well.

    Admission comes first (`admit_watchdogs`).
    """
    failed = []
    for device in devices:
        job = yield from arm_one(owner, device, timeout)
        if job.outcome is not Outcome.REPLY:
            owner.feeding.disarm(device.address)
            failed.append(job)
    return failed


def arm_one(owner: Owner, device: DeviceAdapter, timeout: float, turnaround: float | None = None) -> Procedure[Job]:
    """Set the watchdog of one device and feed it from then on; keep what it was set to before, for its release."""
    watchdog, unit = device.watchdog, owner.units[device.address]
    assert watchdog is not None
    milliseconds = check_watchdog(device, timeout)
    job = yield from look_at(owner, watchdog)
    if not unit.may_be_armed:
        unit.former = _held(watchdog, unit, job)
    held = None if job is None or job.outcome is not Outcome.REPLY else watchdog.decode(job.reply)
    if job is None or job.outcome is Outcome.REPLY:
        if held != milliseconds:
            before, unit.may_be_armed = unit.may_be_armed, True  # whatever it answers
            job = yield from set_watchdog(owner, watchdog, milliseconds)
            if job.outcome is Outcome.REFUSED and not job.unanswered:
                unit.may_be_armed = before  # nothing was done
        else:
            unit.may_be_armed = True
    assert job is not None
    if job.outcome is Outcome.REPLY:
        # What the first attempt wrote may be armed since then.
        owner.feeding.arm(owner.watchdogs.make(unit, timeout, min(job.sent_at, job.answered_since), turnaround))
        unit.rearm = None
    return job


def _held(watchdog: WatchdogRegister, unit: UnitState, job: Job | None) -> int | None:
    """What its register holds, as far as that is known."""
    if job is None:
        return unit.watchdog_ms
    return watchdog.decode(job.reply) if job.outcome is Outcome.REPLY else None


def _feed(owner: Owner, device: DeviceAdapter, timeout: float, turnaround: float | None = None) -> Procedure[Job]:
    """Feed a device by what its register holds. Nothing is written."""
    watchdog, unit = device.watchdog, owner.units[device.address]
    assert watchdog is not None
    job = yield from look_at(owner, watchdog)
    assert job is not None
    if job.outcome is Outcome.REPLY:
        milliseconds = watchdog.decode(job.reply)
        if milliseconds != watchdog.off:
            owner.feeding.arm(owner.watchdogs.make(unit, milliseconds / 1000, job.answered_since, turnaround))
        unit.rearm = None
    return job
