"""An asyncio bus manager for motor drives that share one RS-485 pair."""

from rs485bus.bus.bus import Bus
from rs485bus.bus.config import BusConfig
from rs485bus.bus.opening import open_bus
from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.mks import MksServo
from rs485bus.devices.move import Move, MoveState
from rs485bus.devices.tlr import TlrStepper
from rs485bus.devices.zlac import DifferentialDrive, Zlac8015d
from rs485bus.group import AxisGroup, GroupMove
from rs485bus.wire.registers import Repeat
from rs485bus.wire.timing import LineSettings

__version__ = "0.1.0"

__all__ = [
    "AxisGroup",
    "Bus",
    "BusConfig",
    "DifferentialDrive",
    "GroupMove",
    "LineSettings",
    "MksServo",
    "Move",
    "MoveState",
    "Repeat",
    "TlrStepper",
    "Urgency",
    "Zlac8015d",
    "open_bus",
]
