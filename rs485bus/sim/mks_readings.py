"""What the registers of a virtual MKS drive read."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from rs485bus.devices.mks import registers as r

if TYPE_CHECKING:
    from rs485bus.sim.mks import SimMks


def readings(drive: SimMks) -> dict[int, Callable[[float], bytes]]:
    """What each register of a drive reads at a time."""
    motion = drive.motion

    def encoder(now: float) -> bytes:
        counts = math.floor(motion.motor.position(now) * r.COUNTS_PER_TURN)
        return r.ENCODER.encode(*divmod(counts, r.COUNTS_PER_TURN))

    return {
        r.ENCODER.address: encoder,
        r.POSITION.address: lambda now: r.POSITION.encode(motion.counts(now)),
        r.SPEED.address: lambda now: r.SPEED.encode(round(motion.motor.rpm(now))),
        r.PULSES.address: lambda now: r.PULSES.encode(motion.pulses(now) % 0x1_0000_0000),
        r.INPUTS.address: lambda now: r.INPUTS.encode(drive.inputs(now)),
        r.ANGLE_ERROR.address: lambda now: r.ANGLE_ERROR.encode(motion.angle_error(now)),
        r.ENABLED.address: lambda _: r.ENABLED.encode(motion.enabled),
        r.HOMED.address: lambda _: r.HOMED.encode(*motion.homed),
        r.STALLED.address: lambda _: r.STALLED.encode(motion.stalled),
        r.VERSION.address: lambda _: r.VERSION.encode(drive.version),
        r.STATUS.address: lambda now: r.STATUS.encode(drive.status(now)),
    }
