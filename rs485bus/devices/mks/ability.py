"""What an MKS drive can be told. Source: MKS RTU V1.0.9, 7.1, 8.1, 9.4."""

from __future__ import annotations

import math

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import WorkMode
from rs485bus.errors import LimitExceeded
from rs485bus.motion.drive import Ability
from rs485bus.motion.parameters import MotionParameters

_CALIBRATED = (16, 32, 64)
"""The microsteps at which a speed value is rpm (7.1)."""
_RAMP_UNIT = 20_000.0
"""rpm/s times (256 - code): one rpm every (256 - code) * 50 µs (7.1)."""
_TICK = 0.01


class MksAbility(Ability):
    """One drive.

    Args:
        name: names it in messages.
        mode: the work mode it is set to.
        microsteps: what it is set to.
    """

    counts_per_turn = r.COUNTS_PER_TURN

    def __init__(self, name: str, mode: WorkMode, microsteps: int) -> None:
        self.mode = mode
        self.microsteps = microsteps
        self._name = name

    @property
    def target_range(self) -> tuple[int, int]:
        target = r.MOVE_TO_COUNTS.fields[2].number
        return target.low, target.high

    @property
    def fastest(self) -> tuple[float, str]:
        highest = min(self.mode.max_rpm, int(r.MAX_SPEED / self.speed_factor))
        return highest, f"mode {self.mode.name} at {self.microsteps} microsteps"

    @property
    def rpm_step(self) -> float:
        return 1 / self.speed_factor

    def lowest_acceleration(self, rpm: float) -> float:
        return _RAMP_UNIT / 255

    def parameters(self, rpm: float, acceleration: float) -> MotionParameters:
        speed = self.speed_code(rpm)
        code, real = self._ramp(acceleration)
        return MotionParameters(speed / self.speed_factor, real, speed, code)

    def ticks(self, duration: float) -> int:
        if not _TICK / 2 < duration <= r.MAX_RUN_TIME * _TICK:
            raise LimitExceeded(
                f"{self._name}: duration {duration:g} s is outside 0.01..{r.MAX_RUN_TIME * _TICK:.0f} s"
            )
        return round(duration / _TICK)

    @property
    def speed_factor(self) -> float:
        """What a speed value is of an rpm: it turns the shaft at value * 16 / microsteps where not calibrated (7.1)."""
        return 1.0 if self.microsteps in _CALIBRATED else self.microsteps / 16

    def speed_code(self, rpm: float) -> int:
        """How a speed is said now. The microsteps may have been changed since it was checked.

        Raises:
            LimitExceeded: the drive cannot be so fast.
        """
        highest, why = self.fastest
        if rpm > highest:
            raise LimitExceeded(
                f"{self._name}: rpm {rpm:g} is outside its range, which is above 0, up to {highest:g} ({why})"
            )
        return max(1, round(rpm * self.speed_factor))

    def slower(self, rpm: float) -> int:
        """The speed value that comes nearest to a speed from below."""
        return min(r.MAX_SPEED, int(abs(rpm) * self.speed_factor))

    def gentler(self, acceleration: float) -> int:
        """The code that comes nearest to an acceleration from below; that of the gentlest ramp below that."""
        return 0 if acceleration == math.inf else 256 - math.ceil(min(255.0, _RAMP_UNIT / acceleration))

    def rpm_of(self, speed_code: int) -> float:
        """The speed that a speed value makes, in rpm."""
        return speed_code / self.speed_factor

    def _ramp(self, acceleration: float) -> tuple[int, float]:
        """The code that comes nearest to an acceleration, and what it makes (7.1)."""
        if acceleration == math.inf:
            return 0, math.inf
        lowest = self.lowest_acceleration(1)
        if not lowest - 0.5 <= acceleration <= _RAMP_UNIT:
            raise LimitExceeded(
                f"{self._name}: acceleration {acceleration:g} rpm/s is outside {lowest:.1f}..{_RAMP_UNIT:g} rpm/s; "
                "infinity is a jump"
            )
        code = min(255, max(1, 256 - round(_RAMP_UNIT / acceleration)))
        return code, _RAMP_UNIT / (256 - code)
