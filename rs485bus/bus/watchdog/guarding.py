"""The emergency stop: everything is stopped, and seen to stand. Pure: a procedure that the owner drives."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.job import Job, Reason, Urgency
from rs485bus.bus.stopping.halt import Halted, Procedure
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.watchdog.arming import admit_watchdogs, arm
from rs485bus.bus.watchdog.lease import Lease
from rs485bus.bus.watchdog.releasing import left_armed, release
from rs485bus.bus.watchdog.settings import check_watchdog
from rs485bus.wire.frames import Request

_log = logging.getLogger("rs485bus")

__all__ = [
    "EmergencyReport",
    "Lease",
    "admit_watchdogs",
    "arm",
    "check_watchdog",
    "emergency_stop",
    "left_armed",
    "release",
]


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
        owner.stops.stops_only(unit)
        halts.append(owner.stops.halt(unit, unit.attached.motion, emergency=True))
    # The first stop is on its way before the others are told: a long queue takes a while.
    yield owner.now + 0.001
    owner.flush(Reason.EMERGENCY)
    halted = []
    for halt in halts:
        halted.append((yield halt))  # noqa: PERF401 - a comprehension cannot yield
    return EmergencyReport(tuple(halted))


def _broadcast_stops(owner: Owner, units: list[UnitState]) -> list[Request]:
    """The family broadcasts that stop something and hurt nobody."""
    everyone = [unit for unit in owner.units if unit.address]
    if any(unit.attached is None for unit in everyone):
        return []  # what an unknown device would make of it, nobody knows
    requests = {}
    for unit in units:
        assert unit.attached is not None
        try:
            request = unit.attached.broadcast_stop()
            others = (other for other in everyone if owner.units.family(other.address) != unit.attached.family)
            if request is not None and not any(other.hears(request) for other in others):
                requests[request.adu] = request
        except Exception:  # each is stopped by itself all the same
            _log.exception("%s %d cannot be stopped by a broadcast", unit.attached.family, unit.address)
    return list(requests.values())
