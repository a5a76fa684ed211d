"""What an MKS drive tells of itself. Source: MKS RTU V1.0.9, 7.2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from rs485bus.devices.mks.values import Homed, Inputs, Status
from rs485bus.motion.sample import AxisStatus


class Encoder(NamedTuple):
    """The encoder as carry and value (3.1.1)."""

    carry: int
    """Whole turns."""
    value: int
    """0..0x3FFF in the turn."""


class Homings(NamedTuple):
    """How the homings stand (3.1.7)."""

    single_turn: Homed
    origin: Homed
    """By switch or mechanical stop."""


@dataclass(frozen=True, slots=True)
class MksStatus(AxisStatus):
    """What a drive reports of itself."""

    status: Status
    enabled: bool
    homed: Homed
    """By switch or mechanical stop."""
    homed_in_turn: Homed
    stalled: bool
    inputs: Inputs

    @property
    def moving(self) -> bool:
        return self.status is not Status.STOPPED

    @property
    def faulty(self) -> bool:
        return self.stalled
