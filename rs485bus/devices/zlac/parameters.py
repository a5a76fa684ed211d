"""Setting the parameters of a ZLAC8015D, and keeping them. Source: ZLAC8015D RS485 V1.06, 4."""

from __future__ import annotations

from typing import Any, Final, TypeVar

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.driver import ZlacDriver
from rs485bus.devices.zlac.values import Side
from rs485bus.errors import NotSupported
from rs485bus.wire.registers import Register

T = TypeVar("T")

_SET_ELSEWHERE: Final[tuple[Register[Any], ...]] = (
    *(r.WATCHDOG, r.CLEAR_POSITION, r.RESET_ZERO, r.MODE, r.CONTROL, r.SYNCHRONY, r.SAVE_WRITES),
    *(r.NODE_ID, r.BAUD_RATE, r.RESTORE),
    *(register for twin in r.CONTROLS if twin is not r.QUICK_STOP_TIME for register in (twin.left, twin.right)),
)
"""What the facade writes itself, or what changes who answers."""


def check_parameter(driver: ZlacDriver, register: Register[T], value: T) -> None:
    """Raise `LimitExceeded` or `NotSupported` for what is not to be set."""
    register.raw(value)
    if register.access == "r" or register in _SET_ELSEWHERE:
        raise NotSupported(
            f"{driver.name}: {register.name} (0x{register.address:04X}) cannot be set, or not as a parameter. If it "
            f"must be, bus.unit({driver.attached.address}) writes any register."
        )


async def write_parameter(driver: ZlacDriver, register: Register[T], value: T, save: bool) -> None:
    """Set a parameter. To be saved it is written while 0x2010 is 1, and nothing else is: the EEPROM takes every write
    then, and not for ever."""
    flagged = save and register.address not in r.SAVED
    try:
        if flagged:
            await driver.write(r.SAVE_WRITES, True)
        await driver.write(register, value)
    finally:
        driver.known = False  # it may be one that positions or speeds depend on
        if flagged:
            await driver.write(r.SAVE_WRITES, False)


async def read_parameters(driver: ZlacDriver, side: Side) -> dict[str, float]:
    """All parameters of one motor, by name, in their units."""
    parameters = {}
    for block in r.PARAMETER_BLOCKS[side]:
        values = await driver.read_block(block)
        parameters.update({field.name: value for field, value in zip(block.fields, values, strict=True)})
    return parameters
