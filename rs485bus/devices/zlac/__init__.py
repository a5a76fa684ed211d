"""ZLAC8015D: two hub motors on one address."""

from rs485bus.devices.zlac.differential import DifferentialDrive
from rs485bus.devices.zlac.odometry import Odometry, OdometrySample, Pose
from rs485bus.devices.zlac.setup import ZlacSetup
from rs485bus.devices.zlac.status import WheelStatus, ZlacStatus
from rs485bus.devices.zlac.values import Brake, ControlMode, Fault, ShaftState, Side
from rs485bus.devices.zlac.zlac import Zlac8015d

__all__ = [
    "Brake",
    "ControlMode",
    "DifferentialDrive",
    "Fault",
    "Odometry",
    "OdometrySample",
    "Pose",
    "ShaftState",
    "Side",
    "WheelStatus",
    "Zlac8015d",
    "ZlacSetup",
    "ZlacStatus",
]
