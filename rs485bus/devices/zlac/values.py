"""The values that ZLAC8015D registers take, by name. Source: ZLAC8015D RS485 V1.06, 4, or the section named."""

from __future__ import annotations

import enum
from typing import Final


class Side(enum.IntEnum):
    """A wheel. The value is its bit in 0x2005 and 0x2006."""

    LEFT = 1
    RIGHT = 2

    @property
    def index(self) -> int:
        """Its place in a pair."""
        return self - 1


class ControlMode(enum.IntEnum):
    """What 0x200D makes of targets. Both wheels share it."""

    UNDEFINED = 0
    """As after power-on. A drive that was in a mode and is in none has restarted."""
    POSITION_RELATIVE = 1
    POSITION_ABSOLUTE = 2
    VELOCITY = 3
    TORQUE = 4

    @property
    def is_position(self) -> bool:
        return self in (ControlMode.POSITION_RELATIVE, ControlMode.POSITION_ABSOLUTE)


class ControlWord(enum.IntEnum):
    """What 0x200E does. It is a command, no bit mask, and meant for both wheels but where it names one."""

    UNDEFINED = 0
    EMERGENCY_STOP = 0x05
    CLEAR_FAULT = 0x06
    RELEASE = 0x07
    """Called "stop" in the manual; it lets go of the shaft."""
    ENABLE = 0x08
    START_BOTH = 0x10
    START_LEFT = 0x11
    START_RIGHT = 0x12


class Synchrony(enum.IntEnum):
    """Whether positions are started one by one or together (0x200F).

    The tables of 3.2 and 4 have it the other way round; the routines of 3.2 write 0 for asynchronous control.
    """

    ASYNCHRONOUS = 0
    SYNCHRONOUS = 1


class ShaftState(enum.IntEnum):
    """Bits 7 and 6 of one half of the status word."""

    RELEASED = 0
    LOCKED = 1
    EMERGENCY_STOP = 2
    ALARM = 3


class PowerOnShaft(enum.IntEnum):
    """What the shaft does after power-on (0x2007). It is not enabled either way."""

    FREE = 0
    LOCKED = 1


class BaudRate(enum.IntEnum):
    """The codes of 0x2002."""

    BAUD_128000 = 1
    BAUD_115200 = 2
    BAUD_57600 = 3
    BAUD_38400 = 4
    BAUD_19200 = 5
    BAUD_9600 = 6


class CanBitRate(enum.IntEnum):
    """The codes of 0x200B, in kbit/s."""

    CAN_1000 = 0
    CAN_500 = 1
    CAN_250 = 2
    CAN_125 = 3
    CAN_100 = 4


class ZeroReset(enum.IntEnum):
    """Which wheels 0x2005 and 0x2006 set to zero. The second 2 of 0x2006 is 3, as in 0x2005."""

    NONE = 0
    LEFT = 1
    RIGHT = 2
    BOTH = 3


class QuickStop(enum.IntEnum):
    """How the drive stops quickly (0x2011)."""

    STOP = 5
    RAMP = 6
    JUMP = 7


class HaltReaction(enum.IntEnum):
    """What the drive does on a halt (0x2014). It stays enabled."""

    STOP = 1
    RAMP = 2
    JUMP = 3


class InputFunction(enum.IntEnum):
    """What an input does (0x2017, 0x2018). 1 to 8 do nothing."""

    NONE = 0
    NC_1 = 1
    NC_2 = 2
    NC_3 = 3
    NC_4 = 4
    NC_5 = 5
    NC_6 = 6
    NC_7 = 7
    NC_8 = 8
    EMERGENCY_STOP = 9


class OutputFunction(enum.IntEnum):
    """What an output shows (0x201C, 0x201D)."""

    NONE = 0
    ALARM = 1
    DRIVE_STATUS = 2
    TARGET_REACHED = 3


class Brake(enum.IntEnum):
    """What an external brake is told (3.6)."""

    OPEN = 0
    CLOSED = 1


class EmergencyShaft(enum.IntEnum):
    """What the emergency-stop input does to the shaft (0x2021)."""

    LOCK = 0
    RELEASE = 1


class Inputs(enum.IntFlag):
    """The inputs, as levels or as functions that are reversed (0x2003, 0x2016)."""

    X0 = 1
    X1 = 2


class Outputs(enum.IntFlag):
    """The outputs (0x2004, 0x2019). B0 and B1 are the brakes of the left and the right wheel."""

    Y0 = 1
    Y1 = 2
    B0 = 4
    B1 = 8


class Fault(enum.IntFlag):
    """The bits of 0x20A5 and 0x20A6 (3.5; the last one only in 4). They combine."""

    OVER_VOLTAGE = 0x0001
    UNDER_VOLTAGE = 0x0002
    OVER_CURRENT = 0x0004
    OVER_LOAD = 0x0008
    CURRENT_TOLERANCE = 0x0010
    FOLLOWING_ERROR = 0x0020
    VELOCITY_TOLERANCE = 0x0040
    REFERENCE_VOLTAGE = 0x0080
    EEPROM = 0x0100
    HALL = 0x0200
    MOTOR_TEMPERATURE = 0x0400
    ENCODER = 0x0800

    @property
    def spoils_position(self) -> bool:
        """Whether counts may have been lost with it."""
        return bool(self & (Fault.HALL | Fault.ENCODER))

    def describe(self) -> str:
        """Each error with what to do about it."""
        known = [f"{name} ({remedy})" for bit, (name, remedy) in REMEDIES.items() if bit in self]
        rest = self.value & ~sum(bit.value for bit in REMEDIES)
        if rest:
            known.append(f"unknown error 0x{rest:04X} (the manual does not name it)")
        return ", ".join(known)


REMEDIES: Final[dict[Fault, tuple[str, str]]] = {
    Fault.OVER_VOLTAGE: (
        "over voltage",
        "check the supply; a wheel that brakes feeds back: slow down more gently or add a brake resistor",
    ),
    Fault.UNDER_VOLTAGE: ("under voltage", "charge the battery, and check its wiring under load"),
    Fault.OVER_CURRENT: ("over current", "look for a short circuit in the motor cables, and accelerate more gently"),
    Fault.OVER_LOAD: ("over load", "free the wheel and open its brake; lower the load or raise 0x2032 and 0x2062"),
    Fault.CURRENT_TOLERANCE: ("current out of tolerance", "check the motor cables and the gains of the current loop"),
    Fault.FOLLOWING_ERROR: (
        "encoder out of tolerance",
        "the wheel did not follow: free it, accelerate more gently, or raise 0x2036 and 0x2066",
    ),
    Fault.VELOCITY_TOLERANCE: ("velocity out of tolerance", "free the wheel, and check the gains of the velocity loop"),
    Fault.REFERENCE_VOLTAGE: ("reference voltage", "the drive's electronics: switch it off and on, else replace it"),
    Fault.EEPROM: ("EEPROM", "restore the factory settings (0x2009); a worn-out EEPROM means a new drive"),
    Fault.HALL: ("Hall sensor", "check the sensor cable and plug of that motor"),
    Fault.MOTOR_TEMPERATURE: ("motor too hot", "let it cool down, and lower the load"),
    Fault.ENCODER: ("encoder", "check the encoder cable and plug of that motor"),
}
"""What each error is called, and what to do about it."""
