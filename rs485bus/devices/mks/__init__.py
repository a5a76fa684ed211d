"""MKS SERVO28D/35D/42D/57D."""

from rs485bus.devices.mks.homing import SingleTurnHoming, StopHoming, SwitchHoming
from rs485bus.devices.mks.servo import MksServo, MksStatus
from rs485bus.devices.mks.values import Level, Model, MotionDirection, ParameterDirection, WorkMode

__all__ = [
    "Level",
    "MksServo",
    "MksStatus",
    "Model",
    "MotionDirection",
    "ParameterDirection",
    "SingleTurnHoming",
    "StopHoming",
    "SwitchHoming",
    "WorkMode",
]
