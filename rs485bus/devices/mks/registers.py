"""The registers of MKS SERVO28D/35D/42D/57D drives. Source: MKS RTU V1.0.9, the section named at each.

They are command codes, not memory: windows overlap, and nothing may be read or written across them (2.1). Reads are
function 04 only (2.4 names 03 for 32-bit values, every printed frame has 04). Settings cannot be read back.
"""

from __future__ import annotations

from typing import Final

from rs485bus.devices.mks.values import (
    BaudRate,
    Boot,
    EnableLevel,
    GoHome,
    HoldingCurrent,
    Homed,
    HomingMode,
    Inputs,
    Level,
    MotionDirection,
    OutputMask,
    ParameterDirection,
    PowerOnRun,
    SingleTurn,
    Status,
    WorkMode,
    ZeroPoint,
)
from rs485bus.wire.registers import I16, I32, I48, U8, U16, U32, Block, Field, Register, Repeat

COUNTS_PER_TURN: Final = 0x4000
"""Of 0x31, 0xF4 and 0xF5 (3.1.1)."""
STEPS_PER_TURN: Final = 200
"""Full steps; 0x33, 0xFD and 0xFE count these times the microsteps (9.1.3: 320,000 pulses are 100 turns at 16)."""
MAX_SPEED: Final = 3000
MAX_RUN_TIME: Final = 0x19990000
"""In units of 10 ms (8.1)."""

# Reads

ENCODER: Final = Block(  # 3.1.1; the single turn ends at 0x3FFF, though the section also prints 0x4000
    "multi-turn encoder",
    0x30,
    (Field("carry", I32, "turns"), Field("value", U16, "counts", 0, COUNTS_PER_TURN - 1)),
    count=3,
)
POSITION: Final[Register[int]] = Register("position", I48, "counts", address=0x31, access="r")  # 3.1.2
SPEED: Final[Register[int]] = Register("speed", I16, "rpm", address=0x32, access="r")  # 3.1.3
PULSES: Final[Register[int]] = Register("pulses received", U32, "pulses", address=0x33, access="r")  # 3.1.4
INPUTS: Final[Register[Inputs]] = Register("I/O ports", U16, into=Inputs, address=0x34, access="r")  # 4.1
ANGLE_ERROR: Final[Register[float]] = Register(  # 3.1.5; 51200 a turn here, 28000 in 0x9D
    "angle error", I32, "°", step=360 / 51200, address=0x39, access="r"
)
ENABLED: Final[Register[bool]] = Register("enabled", U16, into=bool, address=0x3A, access="r")  # 3.1.6
HOMED: Final = Block(  # 3.1.7
    "homing status", 0x3B, (Field("single turn", U8, into=Homed), Field("origin", U8, into=Homed)), count=1
)
STALLED: Final[Register[bool]] = Register("stalled", U16, into=bool, address=0x3E, access="r")  # 3.4.3
VERSION: Final[Register[int]] = Register("version", U32, address=0x40, access="r")  # 3.1.8
STATUS: Final[Register[Status]] = Register("motor status", U16, into=Status, address=0xF1, access="r")  # 7.2.1

# Settings. What changing them costs stands in `settings.py`.


def _switch(name: str, address: int) -> Register[bool]:
    return Register(name, U16, low=0, high=1, into=bool, address=address, access="w")


WORK_MODE: Final[Register[WorkMode]] = Register("work mode", U16, into=WorkMode, address=0x82, access="w")  # 3.2.2
CURRENT: Final[Register[int]] = Register("working current", U16, "mA", 0, 5200, address=0x83, access="w")  # 3.2.3
CURRENT_NOT_SAVED: Final = 0x8000
"""Set in the working current: use it, but do not save it (3.2.3)."""
# 3.2.5 prints no values. They stand in the low byte, so how 256 would be said is not known.
MICROSTEPS: Final[Register[int]] = Register("microsteps", U16, "", 1, 255, address=0x84, access="w")
ENABLE_LEVEL: Final[Register[EnableLevel]] = Register(  # 3.2.6
    "En level", U16, into=EnableLevel, address=0x85, access="w"
)
PULSE_DIRECTION: Final[Register[ParameterDirection]] = Register(  # 3.2.7; for the pulse interface only
    "pulse direction", U16, into=ParameterDirection, address=0x86, access="w"
)
SCREEN_OFF: Final = _switch("automatic screen-off", 0x87)  # 3.2.8
STALL_PROTECTION: Final = _switch("overcurrent protection", 0x88)  # 3.4.1
INTERPOLATION: Final = _switch("interpolation", 0x89)  # 3.2.9
BAUD_RATE: Final[Register[BaudRate]] = Register("baud rate", U16, into=BaudRate, address=0x8A, access="w")  # 3.2.10
# 3.2.11 allows 0..255; 0 is the broadcast address, and Modbus ends at 247.
ADDRESS: Final[Register[int]] = Register("address", U16, "", 1, 247, address=0x8B, access="w")
MODBUS: Final = _switch("Modbus protocol", 0x8E)  # 3.2.12
KEY_LOCK: Final = _switch("key lock", 0x8F)  # 3.2.13
HOLDING_CURRENT: Final[Register[HoldingCurrent]] = Register(  # 3.2.4
    "holding current", U16, into=HoldingCurrent, address=0x9B, access="w"
)
LIMIT_REMAP: Final = _switch("limit port remapping", 0x9E)  # 5.3.1
POWER_ON_RUN: Final[Register[PowerOnRun]] = Register(  # 8.3; only when standing
    "power-on run", U16, into=PowerOnRun, address=0xFF, access="w"
)
OUTPUTS: Final = Block(  # 4.2
    "outputs",
    0x36,
    (
        Field("OUT_2 mask", U8, into=OutputMask),
        Field("OUT_2", U8, low=0, high=1, into=bool),
        Field("OUT_1 mask", U8, into=OutputMask),
        Field("OUT_1", U8, low=0, high=1, into=bool),
    ),
    count=2,
)
HOMING: Final = Block(  # 5.3.2: three registers in five bytes, as the logged frames of 5.4, 5.5 and 6.2 have it
    "homing parameters",
    0x90,
    (
        Field("trigger level", U8, into=Level),
        Field("direction", U8, into=ParameterDirection),
        Field("homing speed", U16, "rpm", 0, MAX_SPEED),
        Field("end limit", U8, low=0, high=1, into=bool),
    ),
    count=3,
)
HOMING_TORQUE: Final = Block(  # 5.3.3
    "homing torque and offset",
    0x94,
    (
        Field("origin offset", U32, "counts"),
        Field("homing mode", U16, into=HomingMode),
        Field("homing current", U16, "mA", 0, 5200),
    ),
    count=4,
)


def _gains(name: str, address: int) -> Block:
    return Block(name, address, tuple(Field(gain, U16, "", 0, 1024) for gain in ("Kp", "Ki", "Kd", "Kv")), count=4)


PID_VFOC: Final = _gains("PID of vFOC mode", 0x96)  # 3.3.1
PID_CLOSE: Final = _gains("PID of CLOSE mode", 0x97)  # 3.3.2
WATCHDOG: Final[Register[int]] = Register("heartbeat time", U32, "ms", address=0x98, access="w")  # 3.2.14
PULSE_DIVIDER: Final = Block(  # 4.3; 57D only
    "pulse divider", 0x99, (Field("start level", U16, into=Level), Field("period", U32, "pulses")), count=3
)
SINGLE_TURN: Final = Block(  # 5.3.4; may take 1.6 s (log of 5.6)
    "single-turn homing",
    0x9A,
    (
        Field("mode", U8, into=SingleTurn),
        Field("zero point", U8, into=ZeroPoint),
        Field("homing speed", U8, "", 0, 4),
        Field("direction", U8, into=ParameterDirection),
    ),
    count=2,
)
POSITION_PROTECTION: Final = Block(  # 3.4.2; a unit of time is "approximately" 15 ms
    "position error protection",
    0x9D,
    (
        Field("reserved", U8, "", 0, 0),
        Field("enabled", U8, low=0, high=1, into=bool),
        Field("time of position error", U16, "s", step=0.015),
        Field("position error", U16, "turns", step=1 / 28000),
    ),
    count=3,
)

# Commands


def _command(name: str, address: int, repeat: Repeat) -> Register[int]:
    return Register(name, U16, "", 1, 1, address=address, access="w", repeat=repeat)


RELEASE_STALL: Final = _command("release of the stall", 0x3D, Repeat.SAFE)  # 3.4.4
FACTORY_RESET: Final = _command("factory reset", 0x3F, Repeat.NEVER)  # 3.5.1; restarts
RESTART: Final = _command("restart", 0x41, Repeat.NEVER)  # 3.5.2
BOOT: Final[Register[Boot]] = Register(  # 3.6
    "boot or silence", U16, into=Boot, address=0x50, access="w", repeat=Repeat.NEVER
)
CALIBRATE: Final = _command("calibration", 0x80, Repeat.NEVER)  # 3.2.1; restarts
GO_HOME: Final[Register[GoHome]] = Register(  # 5.3.6; every write starts it anew
    "homing", U16, into=GoHome, address=0x91, access="w", repeat=Repeat.VERIFY
)
SET_ZERO: Final = _command("zero point", 0x92, Repeat.VERIFY)  # 5.3.5
ENABLE: Final[Register[bool]] = Register(  # 7.2.2; the values are those of 0x3A
    "enable", U16, low=0, high=1, into=bool, address=0xF3, access="w"
)
EMERGENCY_STOP: Final = _command("emergency stop", 0xF7, Repeat.SAFE)  # 7.2.3

_SPEED: Final[Field[int]] = Field("speed", U16, "rpm", 0, MAX_SPEED)
_BYTE_ACC: Final[Field[int]] = Field("acceleration", U8, "", 0, 255)
_WORD_ACC: Final[Field[int]] = Field("acceleration", U16, "", 0, 255)
_DIRECTION: Final[Field[MotionDirection]] = Field("direction", U8, into=MotionDirection)

RUN: Final = Block("speed", 0xF6, (_DIRECTION, _BYTE_ACC, _SPEED), count=2, repeat=Repeat.VERIFY)  # 8.1
RUN_FOR: Final = Block(  # 8.1; the same address, four registers
    "speed for a time",
    0xF6,
    (_DIRECTION, _BYTE_ACC, _SPEED, Field("run time", U32, "10 ms", 0, MAX_RUN_TIME)),
    count=4,
    repeat=Repeat.VERIFY,
)
MOVE_PULSES: Final = Block(  # 9.1.1
    "relative move by pulses",
    0xFD,
    (_DIRECTION, _BYTE_ACC, _SPEED, Field("pulses", U32, "pulses")),
    count=4,
    repeat=Repeat.VERIFY,
)
MOVE_TO_PULSES: Final = Block(  # 9.2.1
    "absolute move by pulses",
    0xFE,
    (_WORD_ACC, _SPEED, Field("pulses", I32, "pulses")),
    count=4,
    repeat=Repeat.VERIFY,
)
MOVE_COUNTS: Final = Block(  # 9.3.1
    "relative move",
    0xF4,
    (_WORD_ACC, _SPEED, Field("counts", I32, "counts")),
    count=4,
    repeat=Repeat.VERIFY,
)
MOVE_TO_COUNTS: Final = Block(  # 9.4.1; may be changed while it runs
    "absolute move",
    0xF5,
    (_WORD_ACC, _SPEED, Field("position", I32, "counts")),
    count=4,
    repeat=Repeat.VERIFY,
)

READS: Final = (ENCODER, POSITION, SPEED, PULSES, INPUTS, ANGLE_ERROR, ENABLED, HOMED, STALLED, VERSION, STATUS)
"""All that can be read."""
SINGLE_WRITES: Final = (
    RELEASE_STALL,
    FACTORY_RESET,
    RESTART,
    BOOT,
    CALIBRATE,
    WORK_MODE,
    CURRENT,
    MICROSTEPS,
    ENABLE_LEVEL,
    PULSE_DIRECTION,
    SCREEN_OFF,
    STALL_PROTECTION,
    INTERPOLATION,
    BAUD_RATE,
    ADDRESS,
    MODBUS,
    KEY_LOCK,
    GO_HOME,
    SET_ZERO,
    HOLDING_CURRENT,
    LIMIT_REMAP,
    ENABLE,
    EMERGENCY_STOP,
    POWER_ON_RUN,
)
"""All that is written by function 06."""
BLOCK_WRITES: Final = (
    OUTPUTS,
    HOMING,
    HOMING_TORQUE,
    PID_VFOC,
    PID_CLOSE,
    WATCHDOG,
    PULSE_DIVIDER,
    SINGLE_TURN,
    POSITION_PROTECTION,
    RUN,
    RUN_FOR,
    MOVE_PULSES,
    MOVE_TO_PULSES,
    MOVE_COUNTS,
    MOVE_TO_COUNTS,
)
"""All that is written by function 16."""
