"""TL-R integrated steppers: TLC and TLO 42, 57, 60 and 86."""

from rs485bus.devices.tlr.alarms import Alarm
from rs485bus.devices.tlr.homing import Homing
from rs485bus.devices.tlr.ports import PATHS_BY_INPUTS, SPEED_PATHS_BY_INPUTS, SWITCHES
from rs485bus.devices.tlr.stepper import TlrStatus, TlrStepper, Version
from rs485bus.devices.tlr.tables import Path, SpeedPath
from rs485bus.devices.tlr.values import (
    BaudRate,
    DiFunction,
    DoFunction,
    HomingMode,
    LimitStop,
    OperatingMode,
    PathMode,
    PathTrigger,
    Ports,
    SerialFormat,
)

__all__ = [
    "PATHS_BY_INPUTS",
    "SPEED_PATHS_BY_INPUTS",
    "SWITCHES",
    "Alarm",
    "BaudRate",
    "DiFunction",
    "DoFunction",
    "Homing",
    "HomingMode",
    "LimitStop",
    "OperatingMode",
    "Path",
    "PathMode",
    "PathTrigger",
    "Ports",
    "SerialFormat",
    "SpeedPath",
    "TlrStatus",
    "TlrStepper",
    "Version",
]
