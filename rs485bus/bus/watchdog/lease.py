"""A lease: an application that is alive renews it in time; one that does not has its devices stopped. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from rs485bus.bus.owner import Owner
from rs485bus.bus.units.adapter import DeviceAdapter


class Lease:
    """The lease of one entry of a watchdog block.

    When it lapses, the devices get nothing but stops until they stand (polls would feed them too), and move only after
    the lease was renewed and they were enabled again.

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
            owner.stops.stops_only(unit)
            owner.stops.halt(unit, device.motion, emergency=False)
            device.interrupted(0.0, unit.locked)
