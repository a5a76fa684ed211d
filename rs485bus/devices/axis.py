"""The axis that all families make, by its former place."""

from rs485bus.motion.axis import Axis

__all__ = ["Axis"]
