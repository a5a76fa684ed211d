"""What a wheel of a ZLAC8015D can be told. Source: ZLAC8015D RS485 V1.06, 3.1, 3.2, 4."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from rs485bus.arguments import flag, positive, whole
from rs485bus.devices.zlac import registers as r
from rs485bus.errors import LimitExceeded
from rs485bus.motion.drive import Ability
from rs485bus.motion.parameters import MotionParameters


@dataclass(frozen=True, slots=True, kw_only=True)
class ZlacOptions:
    """How a drive is used, and what only the drive at hand can tell. Described at `Zlac8015d`."""

    max_rpm: float = 1000.0
    encoder_lines: int | None = None
    speed_resolution: int | None = None
    status_word_left: Literal["low", "high"] = "low"
    ramp_rpm: float | None = None
    smooth_stop: bool = False
    scaled_position_speed: bool = False
    zero_in_position_mode: bool = False

    def __post_init__(self) -> None:
        positive("max_rpm", self.max_rpm)
        if self.encoder_lines is not None:
            whole("encoder_lines", self.encoder_lines, 1)
        if self.speed_resolution is not None:
            r.SPEED_RESOLUTION.raw(self.speed_resolution)
        if self.status_word_left not in ("low", "high"):
            raise ValueError(f"status_word_left {self.status_word_left!r} is neither 'low' nor 'high'")
        if self.ramp_rpm is not None:
            positive("ramp_rpm", self.ramp_rpm)
        flag("smooth_stop", self.smooth_stop)
        flag("scaled_position_speed", self.scaled_position_speed)
        flag("zero_in_position_mode", self.zero_in_position_mode)


class ZlacAbility(Ability):
    """One wheel. What the drive is set to is written here as soon as it is known.

    Args:
        name: names the wheel in messages.
        options: how the drive is used.
    """

    def __init__(self, name: str, options: ZlacOptions) -> None:
        self.counts_per_turn = 4096
        self.speed_limit = float(min(options.max_rpm, r.MAX_RPM))
        """rpm: the least of what was asked for, 0x2008 and 3000."""
        self.resolution = options.speed_resolution or 1
        """Steps to one rpm (0x2022)."""
        self._name = name
        self._options = options

    @property
    def target_range(self) -> tuple[int, int]:
        return -r.MAX_ABSOLUTE, r.MAX_ABSOLUTE

    @property
    def reach(self) -> tuple[int, int]:
        return -r.MAX_COUNTS, r.MAX_COUNTS

    @property
    def longest(self) -> float:
        return r.MAX_COUNTS

    @property
    def fastest(self) -> tuple[float, str]:
        return self.speed_limit, f"the least of max_rpm, 0x2008 and {r.MAX_RPM}"

    @property
    def stream_step(self) -> float:
        return 1 / self.resolution

    @property
    def ramp_step(self) -> float:
        return 0.001

    @property
    def highest_rpm(self) -> float:
        # Where 0x2022 scales the speed of positions, too, its register holds less.
        scale = self.resolution if self._options.scaled_position_speed else 1
        return min(self.speed_limit, r.MAX_POSITION_RPM // scale)

    def lowest_acceleration(self, rpm: float) -> float:
        return 1000 * self._range_of(rpm) / r.MAX_RAMP

    def parameters(self, rpm: float, acceleration: float) -> MotionParameters:
        real = max(1, round(rpm * self.resolution)) / self.resolution
        lowest = self.lowest_acceleration(real)
        if not acceleration >= lowest:
            raise LimitExceeded(
                f"{self._name}: acceleration {acceleration:g} rpm/s is below {lowest:.3g} rpm/s: a ramp lasts at most "
                f"{r.MAX_RAMP / 1000} s. Infinity is a jump"
            )
        ramp = round(self.ramp_time(real, acceleration))
        return MotionParameters(real, 1000 * self._range_of(real) / ramp if ramp else math.inf, round(real), ramp)

    def position_parameters(self, rpm: float, acceleration: float) -> MotionParameters:
        if rpm > min(self.highest_rpm, r.MAX_POSITION_RPM):
            raise LimitExceeded(
                f"{self._name}: {rpm:g} rpm is more than {self.highest_rpm:g} rpm for a position, which is what its "
                "register (0x208E) holds"
            )
        return self.parameters(float(max(1, round(rpm))), acceleration)

    def ticks(self, duration: float) -> int | None:
        if not 0.001 <= duration < math.inf:
            raise LimitExceeded(
                f"{self._name}: duration {duration:g} s is not 0.001 s or more, with an end; None has none"
            )
        return None  # the drive does not time a run

    def ramp_time(self, change: float, acceleration: float) -> float:
        """The ramp time, in ms, with which a change of speed, in rpm, goes at an acceleration, in rpm/s."""
        return 1000 * self._range_of(change) / acceleration

    def _range_of(self, change: float) -> float:
        """The change of speed that a ramp time is for."""
        return self._options.ramp_rpm or change
