"""A virtual RS-485 line, and virtual drives on it."""

from rs485bus.sim.clock import VirtualClockLoop
from rs485bus.sim.device import SimDevice, SimUnit
from rs485bus.sim.mks import SimMks
from rs485bus.sim.mks_machine import Machine
from rs485bus.sim.modbus import ModbusData, SimModbus
from rs485bus.sim.noise import Noise
from rs485bus.sim.tlr import SimTlr
from rs485bus.sim.tlr_machine import Dip, TlrMachine
from rs485bus.sim.virtual_line import VirtualLine
from rs485bus.sim.zlac import SimZlac

__all__ = [
    "Dip",
    "Machine",
    "ModbusData",
    "Noise",
    "SimDevice",
    "SimMks",
    "SimModbus",
    "SimTlr",
    "SimUnit",
    "SimZlac",
    "TlrMachine",
    "VirtualClockLoop",
    "VirtualLine",
]
