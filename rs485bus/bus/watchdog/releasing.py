"""Releasing watchdogs: stop, see it stand, restore. Pure: procedures that the owner drives.

They are the bus' own: a caller that is cancelled while it waits for one loses nothing but its wait.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence

from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.endings import Endings
from rs485bus.bus.schedule.job import Outcome
from rs485bus.bus.stopping.halt import Halt, Halted, Procedure
from rs485bus.bus.units.adapter import DeviceAdapter, WatchdogRegister
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.watchdog.settings import set_watchdog


def release(owner: Owner, devices: Sequence[DeviceAdapter]) -> Procedure[list[Halted]]:
    """Stop some devices, see each stand, and restore their watchdogs to what they were.

    All are stopped before the first is confirmed, and each is restored as soon as it stands. What is not seen standing
    stays armed, and is not fed any more. A watchdog that was on before it was armed is on again, and goes on being fed
    if it can be read; one that was never armed is left as it is. Returns how each ended up.
    """
    if not devices:
        return []
    halts = [owner.stops.halt(owner.units[device.address], device.motion, emergency=False) for device in devices]
    endings: Endings[Halted] = Endings(len(devices))
    for place, (device, halt) in enumerate(zip(devices, halts, strict=True)):
        ended = endings.ending(place)
        owner.start(_release_one(owner, device, halt), ended, functools.partial(_not_released, device, halt, ended))
    halted: list[Halted] = yield endings
    return halted


def _not_released(device: DeviceAdapter, halt: Halt, ended: Callable[[Halted], None], error: Exception) -> None:
    """What releases a device has failed: it stands only where it was seen to."""
    ended(Halted(device.address, device.family, False, halt.stops) if halt.told is None else halt.told)


def _release_one(owner: Owner, device: DeviceAdapter, halt: Halt) -> Procedure[Halted]:
    unit = owner.units[device.address]
    halted: Halted = yield halt
    if not halted.standing:
        owner.stops.stops_only(unit)
    elif device.watchdog is not None and unit.may_be_armed:
        yield from _restore(owner, unit, device, device.watchdog)
    unit.rearm = None
    return halted


def _restore(owner: Owner, unit: UnitState, device: DeviceAdapter, watchdog: WatchdogRegister) -> Procedure[None]:
    """Set the watchdog of a standing device to what it was before it was armed, once."""
    if unit.restoring is not None:
        yield unit.restoring
        return
    restoring = unit.restoring = Endings[None](1)
    failed: Exception | None = None
    try:
        yield from _set_back(owner, unit, device, watchdog)
    except Exception as error:
        owner.feeding.mute(device.address)  # it stays armed, as far as is known
        failed = error
    unit.restoring = None
    restoring.ending(0)(None)
    if failed is not None:
        raise failed


def _set_back(owner: Owner, unit: UnitState, device: DeviceAdapter, watchdog: WatchdogRegister) -> Procedure[None]:
    former = watchdog.off if unit.former is None else unit.former
    watch = owner.feeding.get(device.address)
    if watch is None or former != round(watch.timeout * 1000):
        job = yield from set_watchdog(owner, watchdog, former)
        if job.outcome is not Outcome.REPLY:
            owner.feeding.mute(device.address)
            return
        if former == watchdog.off or watchdog.read() is None:
            owner.feeding.disarm(device.address)
        else:
            unit.ledger = None
            owner.feeding.arm(owner.watchdogs.make(unit, former / 1000, job.sent_at))
    unit.may_be_armed = False
    unit.former = None


def restore_late(owner: Owner, unit: UnitState) -> None:
    """A device stands whose block was left before it did: now its watchdog is restored."""
    if unit.attached is not None and unit.attached.watchdog is not None:
        owner.start(_restore(owner, unit, unit.attached, unit.attached.watchdog), lambda _: None)


def left_armed(owner: Owner, devices: Iterable[DeviceAdapter]) -> list[DeviceAdapter]:
    """Of those that were released, and stand: those whose watchdog may still be armed all the same, and is not fed."""
    return [device for device in devices if owner.units[device.address].may_be_armed and not device.motion.may_move]
