"""What a ZLAC8015D reports of itself. Source: ZLAC8015D RS485 V1.06, 4."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.driver import ZlacDriver
from rs485bus.devices.zlac.hub import HubMotor
from rs485bus.devices.zlac.telemetry import StatusWord
from rs485bus.devices.zlac.values import Brake, Fault, InputFunction, Inputs, Outputs, ShaftState


@dataclass(frozen=True, slots=True)
class WheelStatus:
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


async def read_status(driver: ZlacDriver, *wheels: HubMotor) -> ZlacStatus:
    """Ask a drive for what it reports of its two wheels and of itself."""
    _, voltage, word, *rest = await driver.read_block(r.REPORT, Urgency.POLL)
    inputs, outputs = await driver.read_block(r.PORTS, Urgency.POLL)
    reversed_, x0, x1, _, *brakes = await driver.read_block(r.TERMINALS, Urgency.POLL)
    hall, temperature, faults, position, rpm, torque = (rest[at : at + 2] for at in range(0, 12, 2))
    status = StatusWord(word)
    seen = []
    for at, wheel in enumerate(wheels):
        half = status.of(wheel.side, driver.options.status_word_left)
        sign = -1 if wheel.reverse else 1
        seen.append(
            WheelStatus(
                shaft=half.shaft,
                running=half.running,
                faults=faults[at],
                position=sign * position[at] / wheel.counts_per_turn * wheel.units_per_turn,
                rpm=sign * round(rpm[at], 1),
                torque=sign * torque[at],
                temperature=temperature[at],
                hall=hall[at],
                brake=brakes[at],
            )
        )
    left, right = seen
    return ZlacStatus(
        left=left,
        right=right,
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
