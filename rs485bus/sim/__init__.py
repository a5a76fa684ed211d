"""A virtual RS-485 line, and virtual drives on it."""

from rs485bus.sim.clock import VirtualClockLoop
from rs485bus.sim.device import SimDevice, SimUnit
from rs485bus.sim.mks import SimMks
from rs485bus.sim.mks_machine import Machine
from rs485bus.sim.noise import Noise
from rs485bus.sim.virtual_line import VirtualLine
from rs485bus.sim.zlac import SimZlac

__all__ = ["Machine", "Noise", "SimDevice", "SimMks", "SimUnit", "SimZlac", "VirtualClockLoop", "VirtualLine"]
