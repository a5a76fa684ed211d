"""What a TL-R drive can be told. Source: TL-R manual, 3.1.1, 3.5.3."""

from __future__ import annotations

import math
from dataclasses import replace

from rs485bus.devices.tlr import registers as r
from rs485bus.errors import LimitExceeded
from rs485bus.motion.drive import Ability
from rs485bus.motion.parameters import MotionParameters


class TlrAbility(Ability):
    """One drive.

    Args:
        name: names it in messages.
        pulses: pulses a turn, as far as is known.
        ramp_rpm: the speed that the times of ramps refer to; None for the speed of the move.
    """

    def __init__(self, name: str, pulses: int, ramp_rpm: float | None) -> None:
        self.counts_per_turn = pulses
        self.ramp_rpm = ramp_rpm
        self._name = name

    @property
    def ramp_step(self) -> float:
        return 0.001

    @property
    def target_range(self) -> tuple[int, int]:
        return r.TARGET.number.low, r.TARGET.number.high

    @property
    def fastest(self) -> tuple[float, str]:
        return r.MAX_RPM, "what the drive takes"

    def lowest_acceleration(self, rpm: float) -> float:
        return (self.ramp_rpm or rpm) * 1000 / r.MAX_RAMP_MS

    def parameters(self, rpm: float, acceleration: float) -> MotionParameters:
        speed = max(1, round(rpm))
        time = self._ramp("acceleration", speed, acceleration)
        return MotionParameters(float(speed), self._rate(speed, time), speed, time)

    def braking(self, parameters: MotionParameters, deceleration: float) -> MotionParameters:
        """The same with another ramp down.

        Raises:
            LimitExceeded: it cannot slow down like that.
        """
        time = self._ramp("deceleration", parameters.speed_code, deceleration)
        return replace(parameters, deceleration=self._rate(parameters.speed_code, time), down_code=time)

    def ticks(self, duration: float) -> int:
        if not duration > 0.0005 or not math.isfinite(duration * 1000):
            raise LimitExceeded(f"{self._name}: duration {duration:g} s is not 0.001 s or more, with an end")
        return round(duration * 1000)

    def _ramp(self, what: str, speed: int, rate: float) -> int:
        """Milliseconds of a ramp that comes nearest to a rate."""
        slowest = self.lowest_acceleration(speed)
        if not rate >= slowest * 0.999:
            raise LimitExceeded(
                f"{self._name}: {what} {rate:g} rpm/s is below {slowest:g} rpm/s, the slowest at {speed} rpm: a ramp "
                f"takes {r.MAX_RAMP_MS} ms at most"
            )
        return min(r.MAX_RAMP_MS, round((self.ramp_rpm or speed) * 1000 / rate))

    def _rate(self, speed: int, time: int) -> float:
        """rpm/s of such a ramp."""
        return (self.ramp_rpm or speed) * 1000 / time if time else math.inf
