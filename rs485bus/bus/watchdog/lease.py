"""A lease: an application that is alive renews it in time; one that does not has its devices stopped. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from rs485bus.bus.owner import Owner
from rs485bus.bus.units.adapter import DeviceAdapter


class Lease:
    """The lease of one entry of a watchdog block.

    When it lapses, the devices get nothing but stops until they stand (polls would feed them too), and move only after
    the lease was renewed. Those that did not stand then must be enabled again, too.

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
        self._go_on()
        if not self._running:
            self._running = True
            self._owner.at(self._until, self._check)

    def end(self) -> None:
        """It is not needed any more."""
        self._until = float("inf")
        self._go_on()

    def _go_on(self) -> None:
        for device in self._devices:
            unit = self._owner.units[device.address]
            if unit.lapsed and unit.stood and unit.locked == self._why:
                unit.locked = ""
            unit.lapsed = unit.stood = False

    @property
    def _why(self) -> str:
        return f"its lease of {self._seconds:g} s was not renewed"

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
            unit.stood = not (device.motion.may_move or unit.locked)
            unit.locked = self._why
            owner.stops.stops_only(unit)
            owner.stops.halt(unit, device.motion, emergency=False)
            device.interrupted(0.0, unit.locked)
