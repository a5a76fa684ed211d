"""The registers of the ZLAC8015D. Source: ZLAC8015D RS485 V1.06, 4.

Motor parameters exist twice, left from 0x2030 and right from 0x2060 on; what controls the motors lies side by side,
left first. The manual prints 32-bit values as two rows; they are one here, high word first, and written in one frame.

The manual marks some registers as saved (`SAVED`). All others are kept beyond a power cycle only if they were
written while 0x2010 was 1; then **every** write goes to the EEPROM, speeds and targets too. An EEPROM wears out with
some hundred thousand writes: at 20 speeds a second that takes hours. So the facade keeps 0x2010 at 0 but for the
one write that is to be saved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from rs485bus.devices.zlac.values import (
    BaudRate,
    Brake,
    CanBitRate,
    ControlMode,
    ControlWord,
    EmergencyShaft,
    Fault,
    HaltReaction,
    InputFunction,
    Inputs,
    OutputFunction,
    Outputs,
    PowerOnShaft,
    QuickStop,
    Side,
    Synchrony,
    ZeroReset,
)
from rs485bus.wire.registers import I8, I16, I32, U8, U16, Block, Field, Number, Register, Repeat

T = TypeVar("T")

MAX_RPM: Final = 3000
"""What a target velocity may be at most (0x2088). 0x2008 may allow less."""
MAX_POSITION_RPM: Final = 1000
MAX_RAMP: Final = 0x7FFF
"""The longest ramp, in ms."""
MAX_ABSOLUTE: Final = 0x3FFF_FFFF
"""The highest absolute target, in counts; the lowest is its negative."""
MAX_COUNTS: Final = 0x7FFF_FFFF
"""The highest position, and the longest relative move, in counts; the lowest is its negative."""
COUNTS_PER_LINE: Final = 4
"""4096 counts a turn with 1024 lines, in every routine of 3.2."""


@dataclass(frozen=True, slots=True)
class Twin(Generic[T]):
    """What exists once for each wheel."""

    left: Register[T]
    right: Register[T]

    def of(self, side: Side) -> Register[T]:
        return self.left if side is Side.LEFT else self.right


# Both wheels


def _switch(name: str, address: int) -> Register[bool]:
    return Register(name, U16, low=0, high=1, into=bool, address=address, default=False)


WATCHDOG: Final[Register[int]] = Register(
    "communication offline time", U16, "ms", 0, 32767, address=0x2000, default=1000
)
NODE_ID: Final[Register[int]] = Register("RS485 node ID", U16, "", 1, 127, address=0x2001, default=1)
BAUD_RATE: Final[Register[BaudRate]] = Register(
    "RS485 baud rate", U16, into=BaudRate, address=0x2002, default=BaudRate.BAUD_115200
)
INPUTS: Final[Register[Inputs]] = Register("inputs", U16, into=Inputs, address=0x2003, access="r")
OUTPUTS: Final[Register[Outputs]] = Register("outputs", U16, into=Outputs, address=0x2004, access="r")
CLEAR_POSITION: Final[Register[ZeroReset]] = Register(
    "clear feedback position", U16, into=ZeroReset, address=0x2005, default=ZeroReset.NONE
)
RESET_ZERO: Final[Register[ZeroReset]] = Register(
    "reset the zero point", U16, into=ZeroReset, address=0x2006, default=ZeroReset.NONE
)
POWER_ON_SHAFT: Final[Register[PowerOnShaft]] = Register(
    "shaft after power-on", U16, into=PowerOnShaft, address=0x2007, default=PowerOnShaft.FREE
)
SPEED_LIMIT: Final[Register[int]] = Register("maximum motor speed", U16, "rpm", 1, 1000, address=0x2008, default=1000)
RESTORE: Final = _switch("restore factory settings", 0x2009)
CAN_NODE_ID: Final[Register[int]] = Register("CAN node ID", U16, "", 1, 127, address=0x200A, default=1)
CAN_BIT_RATE: Final[Register[CanBitRate]] = Register(
    "CAN bit rate", U16, into=CanBitRate, address=0x200B, default=CanBitRate.CAN_500
)
PARKING: Final = _switch("parking mode", 0x200C)
MODE: Final[Register[ControlMode]] = Register(
    "control mode", U16, into=ControlMode, address=0x200D, default=ControlMode.UNDEFINED
)
CONTROL: Final[Register[ControlWord]] = Register(
    "control word", U16, into=ControlWord, address=0x200E, default=ControlWord.UNDEFINED, repeat=Repeat.VERIFY
)
SYNCHRONY: Final[Register[Synchrony]] = Register(
    "synchronous control", U16, into=Synchrony, address=0x200F, default=Synchrony.ASYNCHRONOUS
)
SAVE_WRITES: Final = _switch("save writes to EEPROM", 0x2010)
QUICK_STOP: Final[Register[QuickStop]] = Register(
    "quick stop", U16, into=QuickStop, address=0x2011, default=QuickStop.STOP
)
# 0x2012 and 0x2013: 1 leaves operation normally, 0 does nothing.
SHUT_DOWN: Final[Register[bool]] = Register(
    "close operation", U16, low=0, high=1, into=bool, address=0x2012, default=True
)
DISABLE: Final[Register[bool]] = Register(
    "disable operation", U16, low=0, high=1, into=bool, address=0x2013, default=True
)
HALT: Final[Register[HaltReaction]] = Register(
    "halt", U16, into=HaltReaction, address=0x2014, default=HaltReaction.STOP
)
INPUTS_REVERSED: Final[Register[Inputs]] = Register(
    "inputs active low", U16, into=Inputs, low=0, high=3, address=0x2016, default=Inputs(0)
)
X0_FUNCTION: Final[Register[InputFunction]] = Register(
    "function of X0", U16, into=InputFunction, address=0x2017, default=InputFunction.EMERGENCY_STOP
)
X1_FUNCTION: Final[Register[InputFunction]] = Register(
    "function of X1", U16, into=InputFunction, address=0x2018, default=InputFunction.NONE
)
OUTPUTS_REVERSED: Final[Register[Outputs]] = Register(
    "outputs active low", U16, into=Outputs, low=0, high=15, address=0x2019, default=Outputs(0)
)
# The directory prints 0x2018 for the right brake, too; 3.6 has 0x201B, which is missing from the directory.
BRAKE: Final[Twin[Brake]] = Twin(
    Register("left brake", U16, into=Brake, address=0x201A, default=Brake.OPEN),
    Register("right brake", U16, into=Brake, address=0x201B, default=Brake.OPEN),
)
Y0_FUNCTION: Final[Register[OutputFunction]] = Register(
    "function of Y0", U16, into=OutputFunction, address=0x201C, default=OutputFunction.NONE
)
Y1_FUNCTION: Final[Register[OutputFunction]] = Register(
    "function of Y1", U16, into=OutputFunction, address=0x201D, default=OutputFunction.NONE
)
DRIVE_TEMPERATURE_LIMIT: Final[Register[float]] = Register(
    "drive temperature limit", U16, "°C", 0, 120, 0.1, address=0x201E, default=80.0
)
ALARM_SHORT_CIRCUIT: Final = _switch("short-circuit the motors in an alarm", 0x201F)
OVERLOAD_PROCESSING: Final = _switch("overload processing", 0x2020)
EMERGENCY_SHAFT: Final[Register[EmergencyShaft]] = Register(
    "shaft after the emergency-stop input", U16, into=EmergencyShaft, address=0x2021, default=EmergencyShaft.LOCK
)
SPEED_RESOLUTION: Final[Register[int]] = Register(
    "given speed resolution", U16, "1/rpm", 1, 10, address=0x2022, default=1
)

# Motor parameters

_LEFT, _RIGHT = 0x2030, 0x2060


def _parameter(
    offset: int,
    name: str,
    default: float,
    low: float = 0,
    high: float = 30000,
    unit: str = "",
    step: float = 1,
    *,
    number: Number = U16,
    right_default: float | None = None,
) -> Twin[float]:
    def make(base: int, side: str, default: float) -> Register[float]:
        return Register(f"{side} {name}", number, unit, low, high, step, address=base + offset, default=default)

    return Twin(
        make(_LEFT, "left", default), make(_RIGHT, "right", default if right_default is None else right_default)
    )


ENCODER_LINES: Final = _parameter(0x00, "encoder lines", 1024, 0, 4096)
HALL_OFFSET: Final = _parameter(0x01, "Hall offset angle", 0, -360, 360, "°", number=I16)
OVERLOAD_FACTOR: Final = _parameter(0x02, "overload factor", 200, 0, 300, "%")
RATED_CURRENT: Final = _parameter(0x03, "rated current", 15.0, 0, 15, "A", 0.1)
MAX_CURRENT: Final = _parameter(0x04, "maximum current", 30.0, 0, 30, "A", 0.1)
OVERLOAD_TIME: Final = _parameter(0x05, "overload protection time", 3000, 0, 65530, "ms", 10)
FOLLOWING_ERROR: Final = _parameter(0x06, "following error threshold", 4090, 10, 65530, "counts", 10)
VELOCITY_SMOOTHING: Final = _parameter(0x07, "velocity smoothing factor", 1000)
CURRENT_KP: Final = _parameter(0x08, "current loop Kp", 600)
CURRENT_KI: Final = _parameter(0x09, "current loop Ki", 300)
FEEDFORWARD_SMOOTHING: Final = _parameter(0x0A, "feedforward smoothing factor", 100)
TORQUE_SMOOTHING: Final = _parameter(0x0B, "torque smoothing factor", 100)
VELOCITY_KP: Final = _parameter(0x0C, "velocity loop Kp", 500)
VELOCITY_KI: Final = _parameter(0x0D, "velocity loop Ki", 100)
VELOCITY_KF: Final = _parameter(0x0E, "velocity loop Kf", 500)
POSITION_KP: Final = _parameter(0x0F, "position loop Kp", 100)
POSITION_KF: Final = _parameter(0x10, "position loop Kf", 50, right_default=1000)
START_RPM_VELOCITY: Final = _parameter(0x13, "initial velocity in velocity mode", 1, 1, 250, "rpm")
START_RPM_POSITION: Final = _parameter(0x14, "initial velocity in position mode", 1, 1, 250, "rpm")
# Printed as poles; the default of 15 is odd, so it counts pairs.
POLE_PAIRS: Final = _parameter(0x15, "pole pairs", 15, 4, 64)
MOTOR_TEMPERATURE_LIMIT: Final = _parameter(0x16, "motor temperature limit", 80.0, 0, 120, "°C", 0.1)
OBSERVER_1: Final = _parameter(0x17, "velocity observer coefficient 1", 1000)
OBSERVER_2: Final = _parameter(0x18, "velocity observer coefficient 2", 750)
OBSERVER_3: Final = _parameter(0x19, "velocity observer coefficient 3", 350)
OBSERVER_4: Final = _parameter(0x1A, "velocity observer coefficient 4", 1000)

# Control


def _control(address: int, name: str, default: int, low: int, high: int, unit: str, number: Number = U16) -> Twin[int]:
    def make(side: str, address: int) -> Register[int]:
        return Register(f"{side} {name}", number, unit, low, high, address=address, default=default)

    return Twin(make("left", address), make("right", address + number.size // 2))


ACCELERATION_TIME: Final = _control(0x2080, "acceleration time", 500, 0, MAX_RAMP, "ms")
DECELERATION_TIME: Final = _control(0x2082, "deceleration time", 500, 0, MAX_RAMP, "ms")
QUICK_STOP_TIME: Final = _control(0x2084, "quick stop deceleration time", 10, 0, MAX_RAMP, "ms")
# Printed with the unit mA/s and the default 300 ms.
TORQUE_SLOPE: Final = _control(0x2086, "torque slope", 300, 0, 0xFFFF, "mA/s")
# In units of 1/0x2022 rpm; the range is rpm.
TARGET_VELOCITY: Final = _control(0x2088, "target velocity", 0, -0x7FFF, 0x7FFF, "1/resolution rpm", I16)
TARGET_POSITION: Final = _control(0x208A, "target position", 0, -MAX_COUNTS, MAX_COUNTS, "counts", I32)
POSITION_SPEED: Final = _control(0x208E, "target speed of positions", 120, 1, MAX_POSITION_RPM, "rpm")
TARGET_TORQUE: Final = _control(0x2090, "target torque", 0, -30000, 30000, "mA", I16)

# What the drive reports


def _report(
    address: int, name: str, number: Number, unit: str = "", step: float = 1, into: Callable[[int], T] | None = None
) -> Register[T]:
    return Register(name, number, unit, step=step, into=into, address=address, access="r")


VERSION: Final[Register[int]] = _report(0x20A0, "software version", U16)
BUS_VOLTAGE: Final[Register[float]] = _report(0x20A1, "bus voltage", U16, "V", 0.01)
STATUS: Final[Register[int]] = _report(0x20A2, "status word", U16)
HALL_STATES: Final[Register[int]] = _report(0x20A3, "Hall states", U16)
MOTOR_TEMPERATURES: Final[Register[int]] = _report(0x20A4, "motor temperatures", U16)
ERRORS: Final[Twin[Fault]] = Twin(
    _report(0x20A5, "left errors", U16, into=Fault), _report(0x20A6, "right errors", U16, into=Fault)
)
POSITION: Final[Twin[int]] = Twin(
    _report(0x20A7, "left position", I32, "counts"), _report(0x20A9, "right position", I32, "counts")
)
VELOCITY: Final[Twin[float]] = Twin(
    _report(0x20AB, "left velocity", I16, "rpm", 0.1), _report(0x20AC, "right velocity", I16, "rpm", 0.1)
)
TORQUE: Final[Twin[int]] = Twin(
    _report(0x20AD, "left torque", I16, "mA", 100), _report(0x20AE, "right torque", I16, "mA", 100)
)
CONNECTED: Final[Register[int]] = _report(0x20AF, "software connected", U16)
DRIVE_TEMPERATURE: Final[Register[float]] = _report(0x20B0, "drive temperature", I16, "°C", 0.1)

# What lies together


def _pair(twin: Twin[Any]) -> tuple[Register[Any], Register[Any]]:
    return twin.left, twin.right


MOTION: Final = Block("position, velocity and torque", 0x20A7, (*_pair(POSITION), *_pair(VELOCITY), *_pair(TORQUE)), 8)
_BYTES: Final[tuple[Field[int], ...]] = (
    Field("left Hall state", U8),
    Field("right Hall state", U8),
    Field("left motor temperature", I8, "°C"),
    Field("right motor temperature", I8, "°C"),
)
STATE: Final = Block("state", 0x20A2, (STATUS, *_BYTES, *_pair(ERRORS), *MOTION.fields), 13)
"""All that moves changes, of one moment."""
REPORT: Final = Block("report", 0x20A0, (VERSION, BUS_VOLTAGE, *STATE.fields, CONNECTED, DRIVE_TEMPERATURE), 17)
PORTS: Final = Block("inputs and outputs", 0x2003, (INPUTS, OUTPUTS), 2)
TERMINALS: Final = Block(
    "terminals", 0x2016, (INPUTS_REVERSED, X0_FUNCTION, X1_FUNCTION, OUTPUTS_REVERSED, *_pair(BRAKE)), 6
)
SHAFT_AND_SPEED: Final = Block("shaft and speed", 0x2007, (POWER_ON_SHAFT, SPEED_LIMIT), 2)
MODES: Final = Block("modes", 0x200D, (MODE, CONTROL, SYNCHRONY, SAVE_WRITES), 4)

# All of them

COMMON: Final[tuple[Register[Any], ...]] = (
    *(WATCHDOG, NODE_ID, BAUD_RATE, INPUTS, OUTPUTS, CLEAR_POSITION, RESET_ZERO, POWER_ON_SHAFT, SPEED_LIMIT, RESTORE),
    *(CAN_NODE_ID, CAN_BIT_RATE, PARKING, MODE, CONTROL, SYNCHRONY, SAVE_WRITES, QUICK_STOP, SHUT_DOWN, DISABLE, HALT),
    *(INPUTS_REVERSED, X0_FUNCTION, X1_FUNCTION, OUTPUTS_REVERSED, *_pair(BRAKE), Y0_FUNCTION, Y1_FUNCTION),
    *(DRIVE_TEMPERATURE_LIMIT, ALARM_SHORT_CIRCUIT, OVERLOAD_PROCESSING, EMERGENCY_SHAFT, SPEED_RESOLUTION),
)
PARAMETERS: Final[tuple[Twin[float], ...]] = (
    *(ENCODER_LINES, HALL_OFFSET, OVERLOAD_FACTOR, RATED_CURRENT, MAX_CURRENT, OVERLOAD_TIME, FOLLOWING_ERROR),
    *(VELOCITY_SMOOTHING, CURRENT_KP, CURRENT_KI, FEEDFORWARD_SMOOTHING, TORQUE_SMOOTHING),
    *(VELOCITY_KP, VELOCITY_KI, VELOCITY_KF, POSITION_KP, POSITION_KF, START_RPM_VELOCITY, START_RPM_POSITION),
    *(POLE_PAIRS, MOTOR_TEMPERATURE_LIMIT, OBSERVER_1, OBSERVER_2, OBSERVER_3, OBSERVER_4),
)
CONTROLS: Final[tuple[Twin[int], ...]] = (
    *(ACCELERATION_TIME, DECELERATION_TIME, QUICK_STOP_TIME, TORQUE_SLOPE),
    *(TARGET_VELOCITY, TARGET_POSITION, POSITION_SPEED, TARGET_TORQUE),
)
REPORTS: Final[tuple[Register[Any], ...]] = (
    *(VERSION, BUS_VOLTAGE, STATUS, HALL_STATES, MOTOR_TEMPERATURES, *_pair(ERRORS), *_pair(POSITION)),
    *(*_pair(VELOCITY), *_pair(TORQUE), CONNECTED, DRIVE_TEMPERATURE),
)
CONTROL_BLOCK: Final = Block("control", 0x2080, tuple(side for twin in CONTROLS for side in _pair(twin)), 18)


def _parameter_block(side: Side, twins: tuple[Twin[float], ...]) -> Block:
    registers = tuple(twin.of(side) for twin in twins)
    return Block(f"{side.name.lower()} parameters", registers[0].address, registers, len(registers))


# There is a gap of two addresses behind the gains of the position loop.
_LOOPS: Final = PARAMETERS.index(POSITION_KF) + 1
PARAMETER_BLOCKS: Final = {
    side: (_parameter_block(side, PARAMETERS[:_LOOPS]), _parameter_block(side, PARAMETERS[_LOOPS:])) for side in Side
}
ALL: Final[tuple[Register[Any], ...]] = (
    *COMMON,
    *(register for twin in PARAMETERS for register in _pair(twin)),
    *(register for twin in CONTROLS for register in _pair(twin)),
    *REPORTS,
)
BY_ADDRESS: Final[dict[int, Register[Any]]] = {register.address: register for register in ALL}
SAVED: Final[frozenset[int]] = frozenset({0x2000, 0x2001, 0x2002, 0x200C, *range(0x2016, 0x2023)})
"""What the drive keeps without 0x2010, by address ("RW/S" in the manual)."""
FIRST: Final = 0x2000
LAST: Final = 0x20B0
