"""The registers of TL-R drives. Source: TL-R manual, 3.5, and the section named at each.

PA numbers are hexadecimal, and are the addresses: PA_04E is 0x4E, 78. All are read by function 03 and written by 06 or
16 (4.1 to 4.3). 32-bit values have their high word first. What is written holds until the drive is switched off, unless
`Auxiliary.SAVE` was executed.
"""

from __future__ import annotations

from typing import Any, Final

from rs485bus.devices.tlr.values import (
    Auxiliary,
    BaudRate,
    ControlWord,
    DiFunction,
    DoFunction,
    HomingMode,
    LimitStop,
    OperatingMode,
    PathMode,
    PathTrigger,
    Ports,
    SerialFormat,
    StatusWord,
)
from rs485bus.wire.registers import I16, I32, U16, Block, Register, Repeat

MAX_RPM: Final = 3000
MAX_RAMP_MS: Final = 2000
LEAST_PULSES: Final = 400
"""A turn, at the coarsest subdivision."""
INPUTS: Final = 5
OUTPUTS: Final = 2
PATHS: Final = 16
"""Of each kind. 1.1 speaks of 15, the tables have 0 to 15."""


def _rpm(name: str, address: int) -> Register[int]:
    return Register(name, U16, "rpm", 0, MAX_RPM, address=address)


def _signed_rpm(name: str, address: int) -> Register[int]:
    return Register(name, I16, "rpm", -MAX_RPM, MAX_RPM, address=address)


def _ramp(name: str, address: int) -> Register[int]:
    return Register(name, U16, "ms", 0, MAX_RAMP_MS, address=address)


def _pulses(name: str, address: int) -> Register[int]:
    return Register(name, I32, "pulses", address=address)


def _plain(name: str, address: int, unit: str = "") -> Register[int]:
    return Register(name, U16, unit, address=address)


def _block(name: str, *registers: Register[Any]) -> Block:
    """Registers that follow one another."""
    return Block(name, registers[0].address, registers, count=sum(register.count for register in registers))


def _registers(*blocks: Block) -> tuple[Register[Any], ...]:
    return tuple(field for block in blocks for field in block.fields if isinstance(field, Register))


# Monitoring (3.5.1). The columns of the two versions are swapped there; the names are taken.
SOFTWARE_VERSION: Final[Register[int]] = Register("software version", U16, address=0x01, access="r")
HARDWARE_VERSION: Final[Register[int]] = Register("hardware version", U16, address=0x02, access="r")
STATUS: Final[Register[StatusWord]] = Register("status", U16, into=StatusWord, address=0x04, access="r")
ALARM: Final[Register[int]] = Register("alarm", U16, address=0x05, access="r")
INPUT_STATES: Final[Register[Ports]] = Register("inputs", U16, into=Ports, address=0x06, access="r")
OUTPUT_STATES: Final[Register[Ports]] = Register("outputs", U16, into=Ports, address=0x07, access="r")
# Of an open loop the commanded position, of a closed one that of the encoder.
POSITION: Final[Register[int]] = Register("position", I32, "pulses", address=0x08, access="r")
SPEED: Final[Register[int]] = Register("speed", I16, "rpm", address=0x0A, access="r")

# Inputs and outputs (2.2.2, 3.5.2)
INPUT_POLARITY: Final[Register[Ports]] = Register("normally closed inputs", U16, "", 0, 127, into=Ports, address=0x10)
INPUT_FUNCTIONS: Final[tuple[Register[DiFunction], ...]] = tuple(
    Register(f"function of DI{port}", U16, into=DiFunction, address=0x11 + port) for port in range(INPUTS)
)
INPUT_FILTER: Final[Register[int]] = Register("input filter", U16, "", 0, 1024, address=0x1A)
OUTPUT_POLARITY: Final[Register[Ports]] = Register("normally closed outputs", U16, "", 0, 7, into=Ports, address=0x1B)
OUTPUT_FUNCTIONS: Final[tuple[Register[DoFunction], ...]] = tuple(
    Register(f"function of DO{port}", U16, into=DoFunction, address=0x1C + port) for port in range(OUTPUTS)
)
FORCED_OUTPUTS: Final[Register[Ports]] = Register("forced outputs", U16, "", 0, 7, into=Ports, address=0x1F)

# The drive (2.2.4, 3.5.3)
STATION: Final[Register[int]] = Register("station", U16, "", 0, 254, address=0x20)
SERIAL_FORMAT: Final[Register[SerialFormat]] = Register("serial format", U16, into=SerialFormat, address=0x21)
DIRECTION: Final[Register[bool]] = Register("reversed direction", U16, low=0, high=1, into=bool, address=0x22)
SUBDIVISION: Final[Register[int]] = Register("subdivision", U16, "pulses/turn", LEAST_PULSES, 51200, address=0x23)
LIMIT_STOP: Final[Register[LimitStop]] = Register("limit stop", U16, into=LimitStop, address=0x24)
SOFT_LIMITS_ON: Final[Register[bool]] = Register("soft limits", U16, low=0, high=1, into=bool, address=0x25)
PATH_TRIGGER: Final[Register[PathTrigger]] = Register("path trigger", U16, into=PathTrigger, address=0x26)
BAUD_RATE: Final[Register[BaudRate]] = Register("baud rate", U16, into=BaudRate, address=0x28)

# Motion (3.1, 3.4, 3.5.3)
JOG_SPEED: Final = _signed_rpm("jog speed", 0x30)
JOG_UP: Final = _ramp("jog acceleration time", 0x31)
JOG_DOWN: Final = _ramp("jog deceleration time", 0x32)
START_SPEED: Final = _rpm("start speed", 0x33)
MOVE_UP: Final = _ramp("acceleration time", 0x34)
MOVE_DOWN: Final = _ramp("deceleration time", 0x35)
MOVE_SPEED: Final = _rpm("speed", 0x36)
TARGET: Final = _pulses("target", 0x37)
HOMING_MODE: Final[Register[HomingMode]] = Register("homing mode", U16, into=HomingMode, address=0x40)
HOMING_SPEED: Final = _rpm("homing speed", 0x41)
HOMING_CREEP: Final = _rpm("homing creep speed", 0x42)
HOMING_RAMP: Final = _ramp("homing ramp", 0x43)  # INTEGER16 in 3.4.1, of which the range 0..2000 leaves no negative
HOME_OFFSET: Final = _pulses("home offset", 0x44)
POSITIVE_SOFT_LIMIT: Final = _pulses("positive soft limit", 0x46)
NEGATIVE_SOFT_LIMIT: Final = _pulses("negative soft limit", 0x48)
PATH_MODE: Final[Register[PathMode]] = Register("path mode", U16, into=PathMode, address=0x4A)
CONTROL: Final[Register[ControlWord]] = Register(
    "control word", U16, "", 0, 127, into=ControlWord, address=0x4E, repeat=Repeat.VERIFY
)
AUXILIARY: Final[Register[Auxiliary]] = Register("auxiliary control", U16, into=Auxiliary, address=0x4F)

# Manufacturer parameters (3.5.6)
OPERATING_MODE: Final[Register[OperatingMode]] = Register("operating mode", U16, into=OperatingMode, address=0x100)
ENCODER_RESOLUTION: Final = _plain("encoder resolution", 0x101)
MAX_CURRENT: Final = _plain("maximum current", 0x102, "mA")
CLOSED_LOOP_CURRENT: Final = _plain("closed-loop maximum current ratio", 0x103)
BASE_CURRENT: Final = _plain("base current ratio", 0x104)
OPEN_LOOP_CURRENT: Final = _plain("open-loop maximum current ratio", 0x105)
LOCK_CURRENT: Final = _plain("lock current ratio", 0x106)
LOCK_TIME: Final = _plain("lock time", 0x107)
LOW_PASS: Final = _plain("low-pass filter", 0x109)
POSITION_ERROR: Final = _plain("position error threshold", 0x10A)
POSITION_ACCURACY: Final = _plain("positioning accuracy threshold", 0x10B)
POSITION_TIME: Final = _plain("positioning completion time", 0x10C)
AVERAGE_FILTER: Final = _plain("average filter", 0x10D)
CURRENT_LOOP_RATIO: Final = _plain("current loop gain ratio", 0x10E)
CURRENT_LOOP_KP: Final = _plain("current loop Kp", 0x10F)
CURRENT_LOOP_KI: Final = _plain("current loop Ki", 0x110)
CURRENT_LOOP_KC: Final = _plain("current loop Kc", 0x111)
SPEED_KP1: Final = _plain("speed Kp1", 0x112)
SPEED_KV1: Final = _plain("speed Kv1", 0x113)
SPEED_NODE_1: Final = _plain("speed node 1", 0x114)
SPEED_KP2: Final = _plain("speed Kp2", 0x115)
SPEED_KV2: Final = _plain("speed Kv2", 0x116)
SPEED_NODE_2: Final = _plain("speed node 2", 0x117)  # described as node 1 once more
SPEED_FEEDFORWARD: Final = _plain("speed feedforward", 0x118)
POSITION_INTEGRATION: Final = _plain("position integration", 0x119)

# What is read or written together
TELEMETRY: Final = _block("telemetry", STATUS, ALARM, INPUT_STATES, OUTPUT_STATES, POSITION, SPEED)
ALL_INPUT_FUNCTIONS: Final = _block("input functions", *INPUT_FUNCTIONS)
JOG: Final = _block("jog", JOG_SPEED, JOG_UP, JOG_DOWN)
POSITIONING: Final = _block("positioning", START_SPEED, MOVE_UP, MOVE_DOWN, MOVE_SPEED, TARGET)
HOMING: Final = _block("homing", HOMING_MODE, HOMING_SPEED, HOMING_CREEP, HOMING_RAMP, HOME_OFFSET)
SOFT_LIMITS: Final = _block("soft limits", POSITIVE_SOFT_LIMIT, NEGATIVE_SOFT_LIMIT)


def _position_path(path: int) -> Block:
    """Five registers of every six (3.5.4)."""
    first = 0x50 + 6 * path
    return _block(
        f"path {path}",
        _pulses(f"target of path {path}", first),
        _rpm(f"speed of path {path}", first + 2),
        _ramp(f"acceleration time of path {path}", first + 3),
        _ramp(f"deceleration time of path {path}", first + 4),
    )


def _speed_path(path: int) -> Block:
    """Three registers each (3.5.5)."""
    first = 0xB0 + 3 * path
    return _block(
        f"speed path {path}",
        _signed_rpm(f"speed of speed path {path}", first),
        _ramp(f"acceleration time of speed path {path}", first + 1),
        _ramp(f"deceleration time of speed path {path}", first + 2),
    )


POSITION_PATHS: Final = tuple(_position_path(path) for path in range(PATHS))
SPEED_PATHS: Final = tuple(_speed_path(path) for path in range(PATHS))

MONITORING: Final[tuple[Register[Any], ...]] = (
    SOFTWARE_VERSION,
    HARDWARE_VERSION,
    STATUS,
    ALARM,
    INPUT_STATES,
    OUTPUT_STATES,
    POSITION,
    SPEED,
)
"""All that can only be read."""
COMMANDS: Final[tuple[Register[Any], ...]] = (CONTROL, AUXILIARY)
"""What acts when it is written."""
SETTINGS: Final[tuple[Register[Any], ...]] = (
    INPUT_POLARITY,
    *INPUT_FUNCTIONS,
    INPUT_FILTER,
    OUTPUT_POLARITY,
    *OUTPUT_FUNCTIONS,
    FORCED_OUTPUTS,
    STATION,
    SERIAL_FORMAT,
    DIRECTION,
    SUBDIVISION,
    LIMIT_STOP,
    SOFT_LIMITS_ON,
    PATH_TRIGGER,
    BAUD_RATE,
    *_registers(JOG, POSITIONING, HOMING, SOFT_LIMITS),
    PATH_MODE,
    *_registers(*POSITION_PATHS, *SPEED_PATHS),
)
"""All that is kept and may be written."""
MANUFACTURER: Final[tuple[Register[Any], ...]] = (
    OPERATING_MODE,
    ENCODER_RESOLUTION,
    MAX_CURRENT,
    CLOSED_LOOP_CURRENT,
    BASE_CURRENT,
    OPEN_LOOP_CURRENT,
    LOCK_CURRENT,
    LOCK_TIME,
    LOW_PASS,
    POSITION_ERROR,
    POSITION_ACCURACY,
    POSITION_TIME,
    AVERAGE_FILTER,
    CURRENT_LOOP_RATIO,
    CURRENT_LOOP_KP,
    CURRENT_LOOP_KI,
    CURRENT_LOOP_KC,
    SPEED_KP1,
    SPEED_KV1,
    SPEED_NODE_1,
    SPEED_KP2,
    SPEED_KV2,
    SPEED_NODE_2,
    SPEED_FEEDFORWARD,
    POSITION_INTEGRATION,
)
"""What the manufacturer has set for the motor."""
