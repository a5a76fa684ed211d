"""The values that MKS registers take, by name. Source: MKS RTU V1.0.9, the section named at each."""

from __future__ import annotations

import enum


class Model(enum.Enum):
    """The drives of the family."""

    SERVO28D = "28D"
    SERVO35D = "35D"
    SERVO42D = "42D"
    SERVO57D = "57D"

    @property
    def max_current(self) -> int:
        """The highest working current, in mA (3.2.3)."""
        return 5200 if self is Model.SERVO57D else 3000

    @property
    def has_outputs(self) -> bool:
        """Whether it has IN_2, OUT_1 and OUT_2 (1.2)."""
        return self is Model.SERVO57D


class WorkMode(enum.IntEnum):
    """What commands the motor, and how it is driven (3.2.2). The bus moves it in the SR modes only."""

    CR_OPEN = 0
    CR_CLOSE = 1
    CR_VFOC = 2
    SR_OPEN = 3
    SR_CLOSE = 4
    SR_VFOC = 5

    @property
    def is_serial(self) -> bool:
        return self >= WorkMode.SR_OPEN

    @property
    def max_rpm(self) -> int:
        """The highest speed, in rpm (7.1)."""
        return (400, 1500, 3000)[self % 3]


class Reported(enum.IntEnum):
    """What a drive reports. A value that the manual does not name is none of the members, and no error."""

    @classmethod
    def _missing_(cls, value: object) -> Reported | None:
        if not isinstance(value, int):
            return None
        member = int.__new__(cls, value)
        member._name_ = f"UNDEFINED_{value}"
        member._value_ = value
        return member


class Status(Reported):
    """What the motor does (7.2.1)."""

    QUERY_FAILED = 0
    STOPPED = 1
    SPEEDING_UP = 2
    SLOWING_DOWN = 3
    FULL_SPEED = 4
    HOMING = 5
    CALIBRATING = 6


class Homed(Reported):
    """How a homing stands (3.1.7)."""

    UNDER_WAY = 0
    DONE = 1
    NOT_DONE = 2


class MotionDirection(enum.IntEnum):
    """The direction byte of 0xF6 and 0xFD (8.1, 9.1.1). The other way round than in `ParameterDirection`.

    The example of 9.1.3 calls 0 clockwise; the tables of both sections say counter-clockwise, and 6.3 and 6.4 agree.
    """

    CCW = 0
    CW = 1


class ParameterDirection(enum.IntEnum):
    """The direction in 0x86, 0x90 and 0x9A (3.2.7, 5.3.2, 5.3.4)."""

    CW = 0
    CCW = 1


class Level(enum.IntEnum):
    """The level at which an input is active."""

    LOW = 0
    HIGH = 1


class EnableLevel(enum.IntEnum):
    """When the En input enables the motor (3.2.6)."""

    LOW = 0
    HIGH = 1
    ALWAYS = 2


class HoldingCurrent(enum.IntEnum):
    """The current at standstill, as a part of the working current (3.2.4)."""

    PERCENT_10 = 0
    PERCENT_20 = 1
    PERCENT_30 = 2
    PERCENT_40 = 3
    PERCENT_50 = 4
    PERCENT_60 = 5
    PERCENT_70 = 6
    PERCENT_80 = 7
    PERCENT_90 = 8


class BaudRate(enum.IntEnum):
    """The codes of 0x8A (3.2.10). The manual prints 25000 for code 3, and 256000 as code 7."""

    BAUD_9600 = 1
    BAUD_19200 = 2
    BAUD_25000 = 3
    BAUD_38400 = 4
    BAUD_57600 = 5
    BAUD_115200 = 6
    BAUD_256000 = 7

    @property
    def baudrate(self) -> int:
        return int(self.name.removeprefix("BAUD_"))


class HomingMode(enum.IntEnum):
    """What ends a homing (5.3.3)."""

    SWITCH = 0
    STOP = 1
    SINGLE_TURN = 2


class GoHome(enum.IntEnum):
    """What 0x91 executes (5.3.6)."""

    ORIGIN = 1
    """Look for the origin."""
    COORDINATE = 2
    """Go straight to coordinate zero."""


class SingleTurn(enum.IntEnum):
    """How a single-turn homing goes (5.3.4)."""

    OFF = 0
    BY_DIRECTION = 1
    NEAREST = 2


class ZeroPoint(enum.IntEnum):
    """What 0x9A does with the zero of the turn (5.3.4)."""

    CLEAR = 0
    SET_HERE = 1
    KEEP = 2


class OutputMask(enum.IntEnum):
    """Whether 0x36 writes an output (4.2)."""

    LEAVE = 0
    WRITE = 1
    HOLD = 2


class Boot(enum.IntEnum):
    """What 0x50 does (3.6)."""

    ENTER_BOOT = 1
    ENTER_SILENCE = 2
    LEAVE_SILENCE = 3


class PowerOnRun(enum.IntEnum):
    """What 0xFF does with the running speed command (8.3)."""

    SAVE = 0xC8
    CLEAR = 0xCA


class Inputs(enum.IntFlag):
    """The I/O ports (4.1). With remapped limits, bit 0 is En and bit 1 is Dir."""

    IN_1 = 1
    IN_2 = 2
    OUT_1 = 4
    OUT_2 = 8
