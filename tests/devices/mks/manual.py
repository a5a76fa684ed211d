"""The frames that the manual prints, each with what it says in typed values."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read, write, write_block
from rs485bus.devices.mks.settings import CLOSE_GAINS, VFOC_GAINS
from rs485bus.devices.mks.values import (
    Boot,
    GoHome,
    HomingMode,
    Level,
    MotionDirection,
    OutputMask,
    ParameterDirection,
    PowerOnRun,
    SingleTurn,
    WorkMode,
    ZeroPoint,
)
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Block, Register

VECTORS: list[dict[str, str]] = json.loads((Path(__file__).parents[2] / "vectors" / "mks.json").read_text())
"""185 frames in the order of the manual, the five misprints corrected."""

CW, CCW = MotionDirection.CW, MotionDirection.CCW

# What each request says: what it is about, and the values it writes.
SAYS: dict[str, tuple[Register[Any] | Block, tuple[Any, ...]]] = {
    "01 04 00 30 00 03 B0 04": (r.ENCODER, ()),
    "01 04 00 31 00 03 E1 C4": (r.POSITION, ()),
    "01 04 00 32 00 01 90 05": (r.SPEED, ()),
    "01 04 00 33 00 02 81 C4": (r.PULSES, ()),
    "01 04 00 34 00 01 70 04": (r.INPUTS, ()),
    "01 04 00 39 00 02 A1 C6": (r.ANGLE_ERROR, ()),
    "01 04 00 3A 00 01 11 C7": (r.ENABLED, ()),
    "01 04 00 3B 00 01 40 07": (r.HOMED, ()),
    "01 04 00 3E 00 01 50 06": (r.STALLED, ()),
    "01 04 00 40 00 02 70 1F": (r.VERSION, ()),
    "01 04 00 F1 00 01 60 39": (r.STATUS, ()),
    "01 06 00 3D 00 01 D9 C6": (r.RELEASE_STALL, (1,)),
    "01 06 00 3F 00 01 78 06": (r.FACTORY_RESET, (1,)),
    "01 06 00 41 00 01 18 1E": (r.RESTART, (1,)),
    "01 06 00 80 00 01 49 E2": (r.CALIBRATE, (1,)),
    "01 06 00 82 00 05 E9 E1": (r.WORK_MODE, (WorkMode.SR_VFOC,)),
    "01 06 00 91 00 01 19 E7": (r.GO_HOME, (GoHome.ORIGIN,)),
    "01 06 00 91 00 02 59 E6": (r.GO_HOME, (GoHome.COORDINATE,)),
    "01 06 00 92 00 01 E9 E7": (r.SET_ZERO, (1,)),
    "01 06 00 9E 00 00 E8 24": (r.LIMIT_REMAP, (False,)),
    "01 06 00 F7 00 01 F9 F8": (r.EMERGENCY_STOP, (1,)),
    "01 06 00 FF 00 C8 B8 6C": (r.POWER_ON_RUN, (PowerOnRun.SAVE,)),
    "01 06 00 FF 00 CA 39 AD": (r.POWER_ON_RUN, (PowerOnRun.CLEAR,)),
    "01 10 00 90 00 03 05 00 00 00 64 00 78 92": (r.HOMING, (Level.LOW, ParameterDirection.CW, 100, False)),
    "01 10 00 90 00 03 05 00 00 00 64 01 B9 52": (r.HOMING, (Level.LOW, ParameterDirection.CW, 100, True)),
    "01 10 00 94 00 04 08 00 00 20 00 00 00 02 58 83 CE": (r.HOMING_TORQUE, (0x2000, HomingMode.SWITCH, 600)),
    "01 10 00 94 00 04 08 00 00 20 00 00 01 02 58 D2 0E": (r.HOMING_TORQUE, (0x2000, HomingMode.STOP, 600)),
    "01 10 00 94 00 04 08 00 00 20 00 00 02 02 58 22 0E": (r.HOMING_TORQUE, (0x2000, HomingMode.SINGLE_TURN, 600)),
    "01 10 00 9A 00 02 04 02 01 02 00 2B A4": (
        r.SINGLE_TURN,
        (SingleTurn.NEAREST, ZeroPoint.SET_HERE, 2, ParameterDirection.CW),
    ),
    "01 10 00 F6 00 02 04 00 02 01 2C DD 4C": (r.RUN, (CCW, 2, 300)),
    "01 10 00 F6 00 02 04 00 02 00 00 DD 01": (r.RUN, (CCW, 2, 0)),
    "01 10 00 FD 00 04 08 01 F0 01 2C 01 00 00 00 B8 80": (r.MOVE_PULSES, (CW, 240, 300, 0x100_0000)),
    "01 10 00 FD 00 04 08 00 F0 01 2C 01 00 00 00 79 4C": (r.MOVE_PULSES, (CCW, 240, 300, 0x100_0000)),
    "01 10 00 FD 00 04 08 00 02 01 2C 00 04 E2 00 A2 1E": (r.MOVE_PULSES, (CCW, 2, 300, 320_000)),
    "01 10 00 FD 00 04 08 00 02 00 00 00 00 00 00 3B 68": (r.MOVE_PULSES, (CCW, 2, 0, 0)),
    "01 10 00 FE 00 04 08 00 02 01 2C 00 04 E2 00 A6 1A": (r.MOVE_TO_PULSES, (2, 300, 320_000)),
    "01 10 00 FE 00 04 08 00 02 00 00 00 00 00 00 3F 6C": (r.MOVE_TO_PULSES, (2, 0, 0)),
    "01 10 00 F4 00 04 08 00 02 01 2C 00 02 80 00 77 63": (r.MOVE_COUNTS, (2, 300, 163_840)),
    "01 10 00 F4 00 04 08 00 02 00 00 00 00 00 00 27 74": (r.MOVE_COUNTS, (2, 0, 0)),
    "01 10 00 F5 00 04 08 00 02 01 2C 00 02 80 00 8A A0": (r.MOVE_TO_COUNTS, (2, 300, 163_840)),
    "01 10 00 F5 00 04 08 00 02 01 2C 09 0A 80 00 08 FE": (r.MOVE_TO_COUNTS, (2, 300, 151_683_072)),
    "01 10 00 F5 00 04 08 00 02 02 58 00 02 80 00 3A 98": (r.MOVE_TO_COUNTS, (2, 600, 163_840)),
    "01 10 00 F5 00 04 08 00 02 00 00 00 00 00 00 DA B7": (r.MOVE_TO_COUNTS, (2, 0, 0)),
}

# What the acknowledgements answer whose requests the manual does not print in full.
ANSWERS: dict[str, tuple[Register[Any] | Block, tuple[Any, ...]]] = {
    "01 06 00 50 00 01 48 1B": (r.BOOT, (Boot.ENTER_BOOT,)),
    "01 10 00 36 00 02 A1 C6": (r.OUTPUTS, (OutputMask.WRITE, True, OutputMask.LEAVE, False)),
    "01 10 00 96 00 04 21 E6": (r.PID_VFOC, (VFOC_GAINS.kp, VFOC_GAINS.ki, VFOC_GAINS.kd, VFOC_GAINS.kv)),
    "01 10 00 97 00 04 70 26": (r.PID_CLOSE, (CLOSE_GAINS.kp, CLOSE_GAINS.ki, CLOSE_GAINS.kd, CLOSE_GAINS.kv)),
    "01 10 00 99 00 03 50 27": (r.PULSE_DIVIDER, (Level.LOW, 3200)),
    "01 10 00 9D 00 03 11 E6": (r.POSITION_PROTECTION, (0, True, 1.5, 1.0)),
}

# What the answers to reads say.
READS: dict[str, tuple[Register[Any], Any]] = {
    "01 04 04 00 04 E2 00 F2 E5": (r.PULSES, 320_000),
    "01 04 06 00 00 00 1B 7F 01 F1 64": (r.POSITION, 1_801_985),
    "01 04 06 00 00 00 02 7F FF A1 23": (r.POSITION, 163_839),
    "01 04 06 00 00 00 02 80 01 61 53": (r.POSITION, 163_841),
}


def request(what: Register[Any] | Block, values: tuple[Any, ...]) -> Request:
    """The library's own request that says so, to address 1."""
    if not values:
        return read(1, what)
    if isinstance(what, Block):
        return write_block(1, what, *values)
    return write(1, what, values[0])


def logged(section: str) -> list[tuple[bytes, bytes]]:
    """The requests that a section logs, each with its reply, in their order."""
    frames = [vector for vector in VECTORS if vector["section"] == section and vector["source"] == "log"]
    requests = [bytes.fromhex(frame["hex"]) for frame in frames if frame["direction"] == "request"]
    replies = [bytes.fromhex(frame["hex"]) for frame in frames if frame["direction"] == "response"]
    return list(zip(requests, replies, strict=True))


LOGGED = list(dict.fromkeys(vector["section"] for vector in VECTORS if vector["source"] == "log"))
"""The sections that log a sequence."""
