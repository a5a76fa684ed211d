"""Closing a bus: every stop is confirmed or reported, every watchdog released, before the port is closed. Pure."""

from __future__ import annotations

import logging

from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.job import Job
from rs485bus.bus.stopping.halt import Halted, Procedure
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.watchdog.releasing import release

_log = logging.getLogger("rs485bus")

_LOOK_EVERY = 0.001
_STANDS_LATER = 0.01
"""Seconds after which it is looked again whether one stands that was not seen standing yet."""
_IN_TIME = 0.1
"""Seconds before its time is over at which a closing bus tries no more."""


def shut_down(owner: Owner, leave_running: bool) -> Procedure[list[Halted]]:
    """Stop all that may move or was told to stop, release all that is armed, and wait for what is on the wire.

    What is told to stop meanwhile is waited for, too. Nothing that moves is sent from the begin on. What was stopped in
    vain, and may move, is stopped again as long as closing may take. Returns how each device ended up.

    Args:
        owner: the bus.
        leave_running: turn the watchdogs off, but leave the motors turning that nobody told to stop.
    """
    owner.gate.closing = True
    until = owner.now + owner.config.close_timeout - _IN_TIME
    halted: dict[int, Halted] = {}
    while True:
        units = [unit for unit in owner.units if _is_open(owner, unit, halted, leave_running)]
        stopping = [unit.attached for unit in units if unit.attached is not None]
        for ended in (yield from release(owner, stopping)):
            halted[ended.address] = ended
        if stopping:
            continue
        if owner.has_plain_stops:
            yield owner.now + _LOOK_EVERY
        elif owner.now < until and owner.gate.connected and _is_stopped_in_vain(owner, halted):
            yield owner.now + _STANDS_LATER  # nobody else will stop it once the port is closed
        else:
            break
    if leave_running:
        yield from _turn_off(owner)
    owner.stops.end_all()  # those that were reported in vain are tried no more
    owner.gate.closed = True
    while owner.is_sending:
        yield owner.now + _LOOK_EVERY
    return list(halted.values())


def _is_stopped_in_vain(owner: Owner, halted: dict[int, Halted]) -> bool:
    """Whether one is being stopped still of which that was reported in vain. It is told of those that stand by now."""
    goes_on = False
    for before in [ended for ended in halted.values() if not ended.standing]:
        unit = owner.units[before.address]
        goes_on = goes_on or unit.halt is not None
        if unit.halt is None and unit.attached is not None and not unit.attached.motion.may_move:
            halted[unit.address] = Halted(before.address, before.family, True, before.stops)
    return goes_on


def still_stopping(owner: Owner) -> list[Halted]:
    """How the devices ended up that may move still, or were not seen standing, when they are waited for no longer."""
    return [
        Halted(unit.address, unit.attached.family, False, 0 if unit.halt is None else unit.halt.stops)
        for unit in owner.units
        if unit.attached is not None and (unit.halt is not None or unit.attached.motion.may_move)
    ]


def _is_open(owner: Owner, unit: UnitState, halted: dict[int, Halted], leave_running: bool) -> bool:
    """Whether a unit has to be stopped yet, or seen standing."""
    if unit.attached is None:
        return False
    if unit.halt is not None and unit.halt.told is None:
        return True
    if unit.address in halted:
        return False
    moves = unit.attached.motion.may_move or _is_armed(owner, unit)
    return unit.halt is not None or (moves and not leave_running)


def _is_armed(owner: Owner, unit: UnitState) -> bool:
    return unit.may_be_armed or owner.feeding.get(unit.address) is not None


def _turn_off(owner: Owner) -> Procedure[None]:
    for unit in owner.units:
        device = unit.attached
        if device is not None and device.watchdog is not None and _is_armed(owner, unit):
            try:
                request = device.watchdog.write(device.watchdog.off)
            except Exception:
                _log.exception("the watchdog of unit %d cannot be turned off: it stays armed, unfed", unit.address)
            else:
                yield Job(request, internal=True)
