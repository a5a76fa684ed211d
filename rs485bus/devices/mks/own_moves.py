"""Moves that are told an MKS drive in its own units, by one frame each. Pure. Source: MKS RTU V1.0.9, 9.1 to 9.3."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.frames import write_block
from rs485bus.devices.mks.values import MotionDirection
from rs485bus.errors import LimitExceeded
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Plan
from rs485bus.wire.frames import Request
from rs485bus.wire.registers import Field


@dataclass(frozen=True, slots=True)
class OwnMove:
    """One move."""

    what: str
    drive: MksDrive
    target_from: Callable[[int], int]
    """Where it goes, in counts, from where it starts."""
    frame: Callable[[int, int], Request]
    """What starts it, with a ramp and a speed as they are said; with speed 0 what stops it."""
    once: bool
    """Said twice it would move the axis twice."""

    def plan(self, _: int, told: MotionParameters) -> Plan[None]:
        """How the drive is told."""
        self.drive.check_mode()
        code = self.drive.ability(0).speed_code(told.rpm)
        yield self.drive.start(self.frame(told.ramp_code, code), self.frame(told.ramp_code, 0), told, once=self.once)


def by_pulses(drive: MksDrive, sign: int, pulses: int) -> OwnMove:
    """So many pulses further (9.1). Raises `LimitExceeded`."""
    _check_distance(r.MOVE_PULSES.fields[3], abs(pulses))
    direction = drive.direction(sign * pulses)

    def frame(ramp: int, speed: int) -> Request:
        if not speed:
            return write_block(drive.address, r.MOVE_PULSES, MotionDirection.CCW, ramp, 0, 0)
        return write_block(drive.address, r.MOVE_PULSES, direction, ramp, speed, abs(pulses))

    # Microsteps may be changed before its turn comes.
    return OwnMove(
        f"move by {pulses} pulses", drive, lambda start: start + sign * _counts_of(drive, pulses), frame, once=True
    )


def by_counts(drive: MksDrive, sign: int, counts: int) -> OwnMove:
    """So many counts further (9.3). Raises `LimitExceeded`."""
    way = sign * counts
    _check_distance(r.MOVE_COUNTS.fields[2], way)

    def frame(ramp: int, speed: int) -> Request:
        return write_block(drive.address, r.MOVE_COUNTS, ramp, speed, way if speed else 0)

    return OwnMove(f"move by {counts} counts", drive, lambda start: start + way, frame, once=True)


def to_pulses(drive: MksDrive, sign: int, pulses: int) -> OwnMove:
    """To a position counted in pulses (9.2). Raises `LimitExceeded`."""
    target = sign * pulses
    r.MOVE_TO_PULSES.fields[2].raw(target)

    def frame(ramp: int, speed: int) -> Request:
        return write_block(drive.address, r.MOVE_TO_PULSES, ramp, speed, target if speed else 0)

    return OwnMove(f"move to {pulses} pulses", drive, lambda _: sign * _counts_of(drive, pulses), frame, once=False)


def _counts_of(drive: MksDrive, pulses: int) -> int:
    return round(pulses * r.COUNTS_PER_TURN / (r.STEPS_PER_TURN * drive.microsteps))


def _check_distance(field: Field[int], distance: int) -> None:
    if field.raw(distance) == 0:
        raise LimitExceeded(f"{field.name} 0 is no distance")
