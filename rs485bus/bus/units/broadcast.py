"""What a frame to everyone would do, asked before it is sent, whichever face sends it. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from rs485bus.bus.units.motion import Motion
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.errors import BroadcastConflict
from rs485bus.wire.frames import BROADCAST, Request


def is_broadcast(request: Request) -> bool:
    """Whether every device on the pair understands it as meant for it. A frame that is no Modbus is none."""
    return request.adu[0] == BROADCAST


def moved_by(request: Request, units: Iterable[UnitState], family: str | None) -> Motion | None:
    """All that a broadcast may set in motion; None if no known device acts on it.

    Args:
        request: the broadcast.
        units: the addresses that are known on the pair.
        family: the family that it is meant for; None for whichever it is.

    Raises:
        BroadcastConflict: it is a read, or a device of another family would act on it.
    """
    if not request.writes:
        raise BroadcastConflict(f"{request} is a read: at address 0 nobody may answer. Ask the devices one by one.")
    hearing = [unit.attached for unit in units if unit.attached is not None and unit.hears(request)]
    families = sorted({device.family for device in hearing})
    if families and families != [family or families[0]]:
        raise BroadcastConflict(
            f"Register 0x{request.register:04X} means something to {' and '.join(families)} devices on this bus"
            f"{'' if family is None else f', not only to {family}'}. Write to the devices one by one instead."
        )
    return Motion(device.motion for device in hearing) if hearing else None
