"""Virtual drives for a test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from rs485bus.pytest_plugin.clock import VirtualClock
from rs485bus.sim import SimDevice, SimMks, SimTlr, SimUnit, SimZlac, VirtualLine

D = TypeVar("D", bound=SimDevice)


class VirtualDrives:
    """Puts drives on a virtual line, and says whether they stand. Made by the fixture `virtual_drives`."""

    def __init__(self, line: VirtualLine, clock: VirtualClock) -> None:
        self._line = line
        self._clock = clock

    def mks(self, address: int, **options: Any) -> SimMks:
        """An MKS SERVO at an address, 1..247. Options are those of `SimMks`."""
        return self.add(SimMks(address, **options))

    def zlac(self, address: int, **options: Any) -> SimZlac:
        """A ZLAC8015D with two wheels at an address, 1..127. Options are those of `SimZlac`."""
        return self.add(SimZlac(address, **options))

    def tlr(self, address: int, **options: Any) -> SimTlr:
        """A TL-R stepper at a station, 1..247. Options are those of `SimTlr`."""
        return self.add(SimTlr(address, **options))

    def unit(self, address: int, registers: Mapping[int, int]) -> SimUnit:
        """Any other device at an address, 1..247, with holding registers."""
        return self.add(SimUnit(address, dict(registers)))

    def add(self, device: D) -> D:
        """Any virtual device, one of your own, say."""
        if any(other.address == device.address for other in self._line.pair.devices):
            raise ValueError(f"there is a device at address {device.address} already")
        self._line.pair.devices.append(device)
        return device

    def turning(self) -> list[str]:
        """The motors that turn now, by family and address: empty where all stand."""
        now, names = self._clock.time(), []
        for device in self._line.pair.devices:
            if isinstance(device, SimMks | SimTlr):
                motors = [device.moving(now)]
            elif isinstance(device, SimZlac):
                motors = [wheel.motor.moving(now) for wheel in device.wheels]
            else:
                motors = []
            names += [f"{type(device).__name__.removeprefix('Sim').upper()} {device.address}"] * any(motors)
        return names
