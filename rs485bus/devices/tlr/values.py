"""The values that TL-R registers take, by name. Source: TL-R manual, the section named at each."""

from __future__ import annotations

import enum


class StatusWord(enum.IntFlag):
    """What the drive reports of itself (3.1.3, 3.5.1)."""

    IN_POSITION = 1
    HOMED = 2
    RUNNING = 4
    FAULT = 8
    ENABLED = 16
    """Reported, but not relied on: whether drives keep it up to date is not certain."""
    POSITIVE_SOFT_LIMIT = 32
    NEGATIVE_SOFT_LIMIT = 64


class ControlWord(enum.IntFlag):
    """What 0x4E starts and ends (3.1.3)."""

    NONE = 0
    POSITION = 1
    ABSOLUTE = 2
    INTERRUPT = 4
    """Give up the positioning under way for the new one; without it the new one is ignored."""
    JOG = 8
    HOME = 16
    STOP = 32
    EMERGENCY_STOP = 64


class Auxiliary(enum.IntEnum):
    """What 0x4F carries out (3.5.3)."""

    NONE = 0
    FACTORY_RESET = 0x0100
    SAVE = 0x0200
    CLEAR_ALARM = 0x0300
    CLEAR_POSITION = 0x0400
    ENABLE = 0x0500
    RELEASE = 0x0600


class DiFunction(enum.IntEnum):
    """What an input does (2.2.2). The list of 3.5.2 ends before the last one; 7 and 8 are not described anywhere."""

    NONE = 0
    ORIGIN = 1
    POSITIVE_LIMIT = 2
    NEGATIVE_LIMIT = 3
    RELEASE = 4
    STOP = 5
    EMERGENCY_STOP = 6
    JOG_POSITIVE = 9
    JOG_NEGATIVE = 10
    HOME = 11
    POSITION_TRIGGER = 12
    SPEED_TRIGGER = 13
    SELECT_0 = 14
    SELECT_1 = 15
    SELECT_2 = 16
    SELECT_3 = 17

    @property
    def moves(self) -> bool:
        """Whether such an input sets the motor in motion."""
        return DiFunction.JOG_POSITIVE <= self <= DiFunction.SPEED_TRIGGER


class DoFunction(enum.IntEnum):
    """What an output tells (2.2.2). 3.5.2 prints the range 0..3 for the same list."""

    NONE = 0
    ALARM = 1
    RUNNING = 2
    HOMED = 3
    IN_POSITION = 4
    BRAKE_RELEASE = 5
    FORCED_1 = 9
    FORCED_2 = 10
    FORCED_3 = 11
    """No bit is described for it; the range 0..7 of the register leaves the third one."""


class Ports(enum.IntFlag):
    """Inputs or outputs, a bit each (3.5.1). There are five inputs and two outputs; 3.5.1 lists a third output."""

    PORT_0 = 1
    PORT_1 = 2
    PORT_2 = 4
    PORT_3 = 8
    PORT_4 = 16


class HomingMode(enum.IntEnum):
    """How the origin is found (3.4.2)."""

    NEGATIVE_LIMIT = 17
    POSITIVE_LIMIT = 18
    POSITIVE_ORIGIN = 24
    NEGATIVE_ORIGIN = 29
    HERE = 35
    """The origin is where it stands."""

    @property
    def needs(self) -> DiFunction | None:
        """The input without which it never ends."""
        return _NEEDED.get(self)


_NEEDED = {
    HomingMode.NEGATIVE_LIMIT: DiFunction.NEGATIVE_LIMIT,
    HomingMode.POSITIVE_LIMIT: DiFunction.POSITIVE_LIMIT,
    HomingMode.POSITIVE_ORIGIN: DiFunction.ORIGIN,
    HomingMode.NEGATIVE_ORIGIN: DiFunction.ORIGIN,
}


class SerialFormat(enum.IntEnum):
    """Data bits, parity and stop bits (3.5.3)."""

    N1 = 0
    N2 = 1
    E1 = 2
    O1 = 3


class BaudRate(enum.IntEnum):
    """The codes of PA_028 (2.2.4, 3.5.3). It counts while SW5 is on; else the drive talks at 115200."""

    BAUD_115200 = 0
    BAUD_38400 = 1
    BAUD_19200 = 2
    BAUD_9600 = 3

    @property
    def baudrate(self) -> int:
        return int(self.name.removeprefix("BAUD_"))


class LimitStop(enum.IntEnum):
    """What a limit switch does to the motor (3.5.3)."""

    RAMP = 0
    EMERGENCY = 1


class PathTrigger(enum.IntEnum):
    """What a path triggered by an input does to a positioning under way (3.2.2). The control word's bit has it the
    other way round."""

    INTERRUPT = 0
    IGNORE = 1


class PathMode(enum.IntEnum):
    """What the targets of paths are (3.2.2)."""

    RELATIVE = 0
    ABSOLUTE = 1


class OperatingMode(enum.IntEnum):
    """How the motor is driven (3.5.6). A change counts after a power cycle."""

    OPEN_LOOP = 1
    CLOSED_LOOP = 2


class ExceptionCode(enum.IntEnum):
    """How the drive says no (4.4). 04 is a failure of the device elsewhere."""

    ILLEGAL_ADDRESS = 2
    ILLEGAL_DATA = 3
    EXECUTION_DENIED = 4
