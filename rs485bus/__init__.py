"""An asyncio bus manager for motor drives that share one RS-485 pair."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rs485bus.bus.bus import Bus
    from rs485bus.bus.config import BusConfig
    from rs485bus.bus.handle import Handle
    from rs485bus.bus.opening import open_bus
    from rs485bus.bus.record import BusStats, Record
    from rs485bus.bus.schedule.job import Urgency
    from rs485bus.bus.unit import Unit
    from rs485bus.bus.watchdog.guarding import EmergencyReport
    from rs485bus.devices.mks import MksServo
    from rs485bus.devices.tlr import TlrStepper
    from rs485bus.devices.zlac import DifferentialDrive, Zlac8015d
    from rs485bus.motion.axis import Axis
    from rs485bus.motion.group.axis_group import AxisGroup, GroupMove
    from rs485bus.motion.move import Move, MoveState
    from rs485bus.plant import Plant
    from rs485bus.wire.registers import Repeat
    from rs485bus.wire.timing import LineSettings

__version__ = "0.1.0"

__all__ = [
    "Axis",
    "AxisGroup",
    "Bus",
    "BusConfig",
    "BusStats",
    "DifferentialDrive",
    "EmergencyReport",
    "GroupMove",
    "Handle",
    "LineSettings",
    "MksServo",
    "Move",
    "MoveState",
    "Plant",
    "Record",
    "Repeat",
    "TlrStepper",
    "Unit",
    "Urgency",
    "Zlac8015d",
    "open_bus",
]

_HOMES = {
    "Axis": "motion.axis",
    "AxisGroup": "motion.group.axis_group",
    "Bus": "bus.bus",
    "BusConfig": "bus.config",
    "BusStats": "bus.record",
    "DifferentialDrive": "devices.zlac",
    "EmergencyReport": "bus.watchdog.guarding",
    "GroupMove": "motion.group.axis_group",
    "Handle": "bus.handle",
    "LineSettings": "wire.timing",
    "MksServo": "devices.mks",
    "Move": "motion.move",
    "MoveState": "motion.move",
    "Plant": "plant",
    "Record": "bus.record",
    "Repeat": "wire.registers",
    "TlrStepper": "devices.tlr",
    "Unit": "bus.unit",
    "Urgency": "bus.schedule.job",
    "Zlac8015d": "devices.zlac",
    "open_bus": "bus.opening",
}
"""In which module each name is defined. It is loaded when the name is first asked for."""
_MODULES = (
    "arguments",
    "blocking",
    "bus",
    "compat",
    "devices",
    "errors",
    "motion",
    "plant",
    "sim",
    "transport",
    "wire",
)


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        value = getattr(import_module(f"rs485bus.{_HOMES[name]}"), name)
    elif name in _MODULES:
        value = import_module(f"rs485bus.{name}")
    else:
        raise AttributeError(f"module 'rs485bus' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*(name for name in globals() if name.startswith("__")), *__all__, *_MODULES])
