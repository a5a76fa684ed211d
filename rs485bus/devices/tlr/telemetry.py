"""What a drive reports of itself, of one moment. Pure. Source: TL-R manual, 3.5.1."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.alarms import alarm_of
from rs485bus.devices.tlr.values import DiFunction, Ports, StatusWord
from rs485bus.motion.state import Fact, Facts

STILL_RPM = 2
"""Up to here a motor that holds its position in a closed loop may seem to turn."""


@dataclass(frozen=True, slots=True)
class Report:
    """The registers from the status on; those that were not read are None."""

    status: StatusWord
    alarm: int | None = None
    inputs: Ports | None = None
    outputs: Ports | None = None
    position: int | None = None
    """Pulses."""
    rpm: int | None = None

    @property
    def moving(self) -> bool:
        """Whether it says that the motor runs, or reports a speed."""
        return StatusWord.RUNNING in self.status or abs(self.rpm or 0) > STILL_RPM


def report(data: bytes) -> Report:
    """The report in the payload of a read that begins at the status, as far as it goes."""
    values, at = [], 0
    for field in r.TELEMETRY.fields:
        if at + field.number.size > len(data):
            break
        values.append(field.decode(data[at:]))
        at += field.number.size
    return Report(*values)


def facts(data: bytes, functions: Sequence[int], enabled_bit: bool) -> Facts:
    """What such a payload tells of the axis.

    Args:
        data: the payload.
        functions: what the inputs do, from DI0 on; none where that is not known.
        enabled_bit: rely on status bit 4.
    """
    seen = report(data)
    told: dict[Fact, Any] = {Fact.RUNNING: seen.moving, Fact.HOMED: StatusWord.HOMED in seen.status}
    if enabled_bit:
        told[Fact.ENABLED] = StatusWord.ENABLED in seen.status
    if seen.alarm is not None:
        faulty = seen.alarm or StatusWord.FAULT in seen.status
        told[Fact.FAULT] = str(alarm_of(seen.alarm) or "a fault without an alarm") if faulty else ""
    if seen.inputs is not None:
        told[Fact.INPUTS] = seen.inputs
        told[Fact.LIMIT] = _limit(seen.status, seen.inputs, functions)
    if seen.position is not None:
        told[Fact.POSITION] = seen.position
    if seen.rpm is not None:
        told[Fact.SPEED] = float(seen.rpm)
    return told


def _limit(status: StatusWord, inputs: Ports, functions: Sequence[int]) -> str:
    """The limits that are reached, in words."""
    for limit in (StatusWord.POSITIVE_SOFT_LIMIT, StatusWord.NEGATIVE_SOFT_LIMIT):
        if limit in status:
            return f"at its {str(limit.name).lower().replace('_', ' ')} (set_soft_limits())"
    closed = {
        port: function
        for port, function in enumerate(functions)
        if function in (DiFunction.POSITIVE_LIMIT, DiFunction.NEGATIVE_LIMIT) and inputs & (1 << port)
    }
    if not closed:
        return ""
    ports = Ports(sum(1 << port for port in closed))
    names = ", ".join(f"DI{port} ({DiFunction(function).name})" for port, function in closed.items())
    return f"with inputs {ports!r}. A limit switch is active: {names}"
