"""The virtual drives of `--sim`, where no plant file names others: one of each family."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rs485bus.plant.families import families
from rs485bus.sim import SimDevice

VIRTUAL = "/dev/ttyUSB0"
"""What the port of a plant file is called that was made of virtual drives."""
BAUDRATE = 115200
USUAL: Mapping[str, Sequence[int]] = {"mks": (1, 2), "tlr": (3,), "zlac": (4,)}


def virtual_drives(drives: Mapping[str, Sequence[int]] | None = None) -> list[SimDevice]:
    """Some virtual drives, by family and address, that are set to `BAUDRATE`."""
    found = []
    for family, addresses in (drives or USUAL).items():
        for address in addresses:
            simulate = families()[family].simulate
            assert simulate is not None
            drive = simulate(address, {})
            drive.baudrate = BAUDRATE
            found.append(drive)
    return found
