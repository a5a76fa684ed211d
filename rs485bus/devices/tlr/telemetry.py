"""What a drive reports of itself, of one moment. Pure. Source: TL-R manual, 3.5.1."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.values import Ports, StatusWord

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
