"""What a ZLAC8015D reports of itself. Source: ZLAC8015D RS485 V1.06, 4."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.telemetry import Half, StatusWord
from rs485bus.devices.zlac.values import Brake, Fault, InputFunction, Inputs, Outputs, ShaftState, Side
from rs485bus.motion.sample import AxisStatus


@dataclass(frozen=True, slots=True)
class WheelStatus(AxisStatus):
    """One wheel."""

    shaft: ShaftState
    """By the half of the status word that `status_word_left` gives it."""
    running: bool
    """By the same half."""
    faults: Fault
    position: float
    """In the axis' units."""
    rpm: float
    torque: int
    """mA, positive the way the axis is."""
    temperature: int
    """°C, of the motor."""
    hall: int
    """1..6; 0 and 7 mean a fault of the Hall sensors."""
    brake: Brake
    """What its external brake is told (B0, B1)."""

    @property
    def enabled(self) -> bool:  # type: ignore[override] # it is computed
        """Whether the motor is energised."""
        return self.shaft is ShaftState.LOCKED

    @property
    def moving(self) -> bool:
        return self.running

    @property
    def faulty(self) -> bool:
        return bool(self.faults)

    @property
    def fault(self) -> str:
        """Its errors, each with what to do about it."""
        return self.faults.describe()


@dataclass(frozen=True, slots=True)
class ZlacStatus:
    """A drive and its wheels, the wheels at one moment."""

    left: WheelStatus
    right: WheelStatus
    word: StatusWord
    """The status word, for both readings of its halves."""
    bus_voltage: float
    """V"""
    temperature: float
    """°C, of the drive."""
    inputs: Inputs
    """The levels of X0 and X1."""
    outputs: Outputs
    emergency_stop_input: bool
    """Whether an input that stops the drive is active."""

    @property
    def enabled(self) -> bool:
        """Whether both wheels are held."""
        return self.word.enabled

    @property
    def faults(self) -> Fault:
        """The errors of both wheels."""
        return self.left.faults | self.right.faults


BLOCKS = (r.REPORT, r.PORTS, r.TERMINALS)
"""What is read for a status."""


def status_from(
    blocks: Sequence[Sequence[Any]], left: Literal["low", "high"], counts: Sequence[float], signs: Sequence[int]
) -> ZlacStatus:
    """The status in what `BLOCKS` read.

    Args:
        blocks: their values.
        left: which half of the status word is the left wheel's.
        counts: of the drive to one unit of each wheel.
        signs: 1 or -1 for each wheel.
    """
    (_, voltage, word, *rest), (inputs, outputs), (reversed_, x0, x1, _, *brakes) = blocks
    hall, temperature, faults, position, rpm, torque = (rest[at : at + 2] for at in range(0, 12, 2))
    status = StatusWord(word)
    wheels = []
    for at, side in enumerate(Side):
        half: Half = status.of(side, left)
        wheels.append(
            WheelStatus(
                shaft=half.shaft,
                running=half.running,
                faults=faults[at],
                position=signs[at] * position[at] / counts[at],
                rpm=signs[at] * round(rpm[at], 1),
                torque=signs[at] * torque[at],
                temperature=temperature[at],
                hall=hall[at],
                brake=brakes[at],
            )
        )
    return ZlacStatus(
        left=wheels[0],
        right=wheels[1],
        word=status,
        bus_voltage=round(voltage, 2),
        temperature=round(rest[-1], 1),
        inputs=inputs,
        outputs=outputs,
        emergency_stop_input=_emergency_input(inputs ^ reversed_, x0, x1),
    )


def _emergency_input(active: Inputs, x0: InputFunction, x1: InputFunction) -> bool:
    functions = ((Inputs.X0, x0), (Inputs.X1, x1))
    return any(bit in active and function is InputFunction.EMERGENCY_STOP for bit, function in functions)
