"""What a virtual MKS drive keeps, and what it understands. Source: MKS RTU V1.0.9."""

from __future__ import annotations

from typing import Any

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import Spoken, understand
from rs485bus.devices.mks.values import (
    BaudRate,
    EnableLevel,
    HoldingCurrent,
    HomingMode,
    Level,
    ParameterDirection,
    SingleTurn,
    WorkMode,
    ZeroPoint,
)
from rs485bus.errors import LimitExceeded
from rs485bus.wire.registers import Block


class Refused(Exception):
    """The drive says no inside a normal reply (2.4)."""


def factory_settings() -> dict[int, Any]:
    """What it is set to as shipped, by register: a value, or the values of a block.

    The manual prints the defaults of 0x94, 0x96, 0x97, 0x98, 0x9D and the baud rate; the others are usual ones.
    """
    return {
        r.WORK_MODE.address: WorkMode.CR_VFOC,
        r.CURRENT.address: 1600,
        r.HOLDING_CURRENT.address: HoldingCurrent.PERCENT_50,
        r.MICROSTEPS.address: 16,
        r.ENABLE_LEVEL.address: EnableLevel.LOW,
        r.PULSE_DIRECTION.address: ParameterDirection.CW,
        r.SCREEN_OFF.address: False,
        r.INTERPOLATION.address: True,
        r.KEY_LOCK.address: False,
        r.STALL_PROTECTION.address: False,
        r.LIMIT_REMAP.address: False,
        r.BAUD_RATE.address: BaudRate.BAUD_38400,
        r.MODBUS.address: True,
        r.WATCHDOG.address: 0,
        r.POWER_ON_RUN.address: None,
        r.PID_VFOC.address: (220, 100, 270, 320),
        r.PID_CLOSE.address: (200, 80, 250, 300),
        r.PULSE_DIVIDER.address: (Level.LOW, 0),
        r.POSITION_PROTECTION.address: (0, False, 0.0, 0.0),
        r.HOMING.address: (Level.LOW, ParameterDirection.CW, 60, False),
        r.HOMING_TORQUE.address: (0x2000, HomingMode.SWITCH, 400),
        r.SINGLE_TURN.address: (SingleTurn.OFF, ZeroPoint.KEEP, 2, ParameterDirection.CW),
    }


def accept(pdu: bytes) -> Spoken:
    """What a write says, its values in their ranges. Raises `Refused`."""
    try:
        spoken = understand(pdu)
        fields = spoken.what.fields if isinstance(spoken.what, Block) else (spoken.what,)
        for field, value in zip(fields, spoken.values, strict=True):
            if field is not r.CURRENT:  # its limit is the model's, and it carries a flag
                field.raw(value)
    except (ValueError, LimitExceeded):
        raise Refused from None
    return spoken
