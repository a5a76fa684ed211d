"""MKS SERVO28D/35D/42D/57D."""

from rs485bus.devices.mks.alarms import ALARMS, Alarm, alarm
from rs485bus.devices.mks.homing import SingleTurnHoming, StopHoming, SwitchHoming
from rs485bus.devices.mks.servo import MksServo
from rs485bus.devices.mks.settings import (
    CLOSE_GAINS,
    SETTINGS,
    VFOC_GAINS,
    Gains,
    MksProfile,
    PositionProtection,
    PulseDivider,
)
from rs485bus.devices.mks.status import Encoder, Homings, MksStatus
from rs485bus.devices.mks.values import (
    BaudRate,
    EnableLevel,
    HoldingCurrent,
    Homed,
    Inputs,
    Level,
    Model,
    MotionDirection,
    OutputMask,
    ParameterDirection,
    Status,
    WorkMode,
)
from rs485bus.motion.settings import Cost, Setting

__all__ = [
    "ALARMS",
    "CLOSE_GAINS",
    "SETTINGS",
    "VFOC_GAINS",
    "Alarm",
    "BaudRate",
    "Cost",
    "EnableLevel",
    "Encoder",
    "Gains",
    "HoldingCurrent",
    "Homed",
    "Homings",
    "Inputs",
    "Level",
    "MksProfile",
    "MksServo",
    "MksStatus",
    "Model",
    "MotionDirection",
    "OutputMask",
    "ParameterDirection",
    "PositionProtection",
    "PulseDivider",
    "Setting",
    "SingleTurnHoming",
    "Status",
    "StopHoming",
    "SwitchHoming",
    "WorkMode",
    "alarm",
]
