"""What an MKS drive can be asked. Source: MKS RTU V1.0.9, the section named at each method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from rs485bus.bus.schedule.job import Urgency
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.values import Homed, Inputs, Status


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
class MksStatus:
    """What a drive reports of itself."""

    status: Status
    enabled: bool
    homed: Homed
    """By switch or mechanical stop."""
    homed_in_turn: Homed
    stalled: bool
    inputs: Inputs


class MksQuestions(MksDrive):
    """The reads of a drive. Each raises `NoReply`, or `NotSent` and what is derived from it."""

    async def status(self) -> MksStatus:
        """All that tells how the drive is."""
        status = await self.running()
        enabled = await self.enabled()
        homed = await self.homed()
        return MksStatus(status, enabled, homed.origin, homed.single_turn, await self.stalled(), await self.inputs())

    async def running(self) -> Status:
        """What the motor does (7.2.1). Some drives have been seen stuck at "slowing down" while they stand."""
        return await self._read(r.STATUS, Urgency.POLL)

    async def enabled(self) -> bool:
        """Whether the motor is energised (3.1.6)."""
        return await self._read(r.ENABLED, Urgency.POLL)

    async def homed(self) -> Homings:
        """How the homings stand (3.1.7)."""
        return Homings(*await self._read_block(r.HOMED, Urgency.POLL))

    async def stalled(self) -> bool:
        """Whether the drive has noticed a stall (3.4.3)."""
        return await self._read(r.STALLED, Urgency.POLL)

    async def inputs(self) -> Inputs:
        """The levels of the ports (4.1). With remapped limits IN_1 is En and IN_2 is Dir."""
        return await self._read(r.INPUTS, Urgency.POLL)

    async def counts(self) -> int:
        """The coordinate: 48 bits, 0x4000 counts a turn (3.1.2). `position` is this in the axis' units."""
        return await self._read(r.POSITION, Urgency.POLL)

    async def encoder(self) -> Encoder:
        """The encoder as carry and value (3.1.1)."""
        return Encoder(*await self._read_block(r.ENCODER, Urgency.POLL))

    async def pulses(self) -> int:
        """The pulses received, 200 times the microsteps a turn, as 32 bits without a sign (3.1.4)."""
        return await self._read(r.PULSES, Urgency.POLL)

    async def angle_error(self) -> float:
        """By how much the shaft differs from where it should be, in degrees (3.1.5)."""
        return await self._read(r.ANGLE_ERROR, Urgency.POLL)

    async def version(self) -> int:
        """The version of the firmware, 32 bits of which the manual gives no layout (3.1.8)."""
        return await self._read(r.VERSION, Urgency.POLL)
