"""Setting the parameters of a ZLAC8015D, and keeping them. Source: ZLAC8015D RS485 V1.06, 4. Pure."""

from __future__ import annotations

from typing import Any, Final, TypeVar

from rs485bus.arguments import flag, instance
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.frames import write
from rs485bus.devices.zlac.known import KnownZlac
from rs485bus.devices.zlac.values import Brake
from rs485bus.errors import NotSupported
from rs485bus.motion.plan import Ask, Plan, Stand
from rs485bus.wire.registers import Register

T = TypeVar("T")

_SET_ELSEWHERE: Final[tuple[Register[Any], ...]] = (
    *(r.WATCHDOG, r.CLEAR_POSITION, r.RESET_ZERO, r.MODE, r.CONTROL, r.SYNCHRONY, r.SAVE_WRITES),
    *(r.NODE_ID, r.BAUD_RATE, r.RESTORE),
    *(register for twin in r.CONTROLS if twin is not r.QUICK_STOP_TIME for register in (twin.left, twin.right)),
)
"""What the facade writes itself, or what changes who answers."""


def check_parameter(drive: KnownZlac, register: Register[T], value: T, save: bool) -> None:
    """Raise `LimitExceeded` or `NotSupported` for what is not to be set."""
    flag("save", save)
    instance("register", register, Register, "registers.QUICK_STOP_TIME.of(Side.LEFT)").raw(value)
    if register.access == "r" or register in _SET_ELSEWHERE:
        raise NotSupported(
            f"{drive.name}: {register.name} (0x{register.address:04X}) cannot be set, or not as a parameter. If it "
            f"must be, bus.unit({drive.address}) writes any register."
        )


def write_parameter(drive: KnownZlac, register: Register[T], value: T, save: bool) -> Plan[None]:
    """Set a parameter. To be saved it is written while 0x2010 is 1, and nothing else is: the EEPROM takes every write
    then, and not for ever."""
    flagged = save and register.address not in r.SAVED
    drive.setup = None  # it may be one that positions or speeds depend on
    try:
        if flagged:
            yield Ask(write(drive.address, r.SAVE_WRITES, True))
        yield Ask(write(drive.address, register, value))
    except Exception:
        if flagged:
            yield Ask(write(drive.address, r.SAVE_WRITES, False))
        raise
    if flagged:
        yield Ask(write(drive.address, r.SAVE_WRITES, False))


def set_brakes(drive: KnownZlac, left: Brake, right: Brake) -> Plan[None]:
    """Open or close the external brakes of standing wheels (3.6)."""
    yield Stand(whole=True)
    yield Ask(write(drive.address, r.BRAKE.left, left))
    yield Ask(write(drive.address, r.BRAKE.right, right))
