"""What an axis can be asked for: its units, its limits, and the speeds and ramps that its drive can be told."""

from __future__ import annotations

import math

from rs485bus.arguments import flag, pair, positive, real
from rs485bus.errors import LimitExceeded
from rs485bus.motion.drive import Ability, Drive, said_by_family
from rs485bus.motion.parameters import MotionParameters

_FAR = 1 << 64
"""Counts that no drive gets to."""
_AS_ASKED = 0.05
"""By which part the drive may be faster or slower than asked before that is refused."""


class AxisScale:
    """Turns what users say into what a drive is told, and back.

    Args:
        drive: the drive.
        number: which one of the drive's axes it is.
        name: names it in messages.
        units_per_turn: positions are in units of this many to a turn of the motor.
        reverse: whether positive is the other way round.
        limits: lowest and highest position that may be gone to, in units; None for no limit.

    Raises:
        LimitExceeded, ValueError: an argument is out of its range.
        TypeError: one is of a wrong type.
    """

    def __init__(
        self,
        drive: Drive,
        number: int,
        name: str,
        *,
        units_per_turn: float,
        reverse: bool,
        limits: tuple[float, float] | None,
    ) -> None:
        self.units_per_turn = units_per_turn
        self.reverse = reverse
        self.limits = limits
        self._drive = drive
        self._at = number
        self._name = name

    @property
    def units_per_turn(self) -> float:
        """Positions are in units of this many to a turn of the motor."""
        return self._units_per_turn

    @units_per_turn.setter
    def units_per_turn(self, units: float) -> None:
        self._units_per_turn = positive("units_per_turn", units, "; use reverse=True to turn the other way")

    @property
    def reverse(self) -> bool:
        """Whether positive is the other way round."""
        return self._reverse

    @reverse.setter
    def reverse(self, reverse: bool) -> None:
        self._reverse = flag("reverse", reverse)

    @property
    def limits(self) -> tuple[float, float] | None:
        """Lowest and highest position that may be gone to, in units; None for no limit."""
        return self._limits

    @limits.setter
    def limits(self, limits: tuple[float, float] | None) -> None:
        self._limits = None if limits is None else _limits(limits)

    @property
    def ability(self) -> Ability:
        """What the axis can be told."""
        return said_by_family(self._name, lambda: self._drive.ability(self._at))

    @property
    def sign(self) -> int:
        """-1 where the axis counts the other way than its drive."""
        return -1 if self.reverse else 1

    def number(self, what: str, value: float) -> float:
        """A number given to a verb. Raises `TypeError`; `LimitExceeded` for nan."""
        return real(f"{self._name}: {what}", value)

    def time(self, what: str, seconds: float) -> float:
        """A time that one can wait. Raises `LimitExceeded` for others, `TypeError` for what is no number."""
        return positive(f"{self._name}: {what} (s)", seconds)

    # Positions

    def to_counts(self, units: float) -> int:
        """Counts of the drive. Raises `LimitExceeded` for what is no number, or has no end."""
        counts = units / self.units_per_turn * self.ability.counts_per_turn
        if not math.isfinite(counts):
            raise LimitExceeded(f"{self._name}: {units:g} is no position and no distance; those are finite numbers.")
        return self.sign * round(counts)

    def to_units(self, counts: int) -> float:
        """A position, or a distance, of so many counts of the drive."""
        return self.sign * counts / self.ability.counts_per_turn * self.units_per_turn

    def check_limits(self, position: float) -> None:
        """Raise `LimitExceeded` for a position that the axis' limits do not allow."""
        half = self.units_per_turn / self.ability.counts_per_turn / 2
        if self.limits is not None and not self.limits[0] - half <= position <= self.limits[1] + half:
            low, high = self.limits
            raise LimitExceeded(f"{self._name}: position {position:g} is outside its limits {low:g}..{high:g}.")

    @property
    def count_limits(self) -> tuple[int, int] | None:
        """The axis' limits in counts, the lower one first; None for none."""
        if self.limits is None:
            return None
        # What has no end is further than any drive counts.
        most = _FAR * self.units_per_turn / self.ability.counts_per_turn
        low, high = sorted(self.to_counts(min(max(end, -most), most)) for end in self.limits)
        return low, high

    def target(self, position: float, reach: tuple[int, int] | None = None) -> int:
        """A position in counts. Raises `LimitExceeded` where the limits or the drive's register do not allow it."""
        self.check_limits(position)
        lowest, highest = self.ability.target_range if reach is None else reach
        if not math.isfinite(position) or not lowest <= (counts := self.to_counts(position)) <= highest:
            ends = sorted((self.to_units(lowest), self.to_units(highest)))
            raise LimitExceeded(
                f"{self._name}: position {position:.10g} is outside {ends[0]:.10g}..{ends[1]:.10g}, which is what the "
                "drive can be told. Go there in steps, each from a new zero: set_zero()."
            )
        return counts

    # Speeds and ramps

    def parameters(self, rpm: float, acceleration: float) -> MotionParameters:
        """What the drive can be told of a speed and an acceleration. Raises `LimitExceeded`, `TypeError`."""
        speed, ramp = self.number("rpm", rpm), self.number("acceleration", acceleration)
        self.check_speed(speed)
        parameters = self.ability.parameters(speed, ramp)
        self.check_as_asked("rpm", speed, parameters.rpm, "rpm")
        if abs(parameters.rpm / parameters.acceleration - parameters.rpm / ramp) > self.ability.ramp_step:
            self.check_as_asked("acceleration", ramp, parameters.acceleration, "rpm/s")
        return parameters

    def position_parameters(self, rpm: float, acceleration: float) -> MotionParameters:
        """The nearest that the drive can be told on its way to a position. Raises `LimitExceeded`."""
        self.check_speed(rpm)
        return self.ability.position_parameters(rpm, acceleration)

    def check_as_asked(self, what: str, asked: float, told: float, unit: str) -> None:
        """Raise `LimitExceeded` where the drive cannot be told nearly what was asked for."""
        if asked != told and abs(told - asked) > _AS_ASKED * asked:
            raise LimitExceeded(
                f"{self._name}: {what} {asked:g} is none that its drive can be told; {told:.5g} {unit} is the nearest."
            )

    def check_speed(self, rpm: float) -> None:
        """Raise `LimitExceeded` for a speed that the motor cannot have."""
        highest, why = self.ability.fastest
        if not 0 < rpm <= highest:
            raise LimitExceeded(
                f"{self._name}: rpm {rpm:g} is outside its range, which is above 0, up to {highest:g} ({why})"
            )


def _limits(limits: tuple[float, float]) -> tuple[float, float]:
    low, high = (real("each of limits", end) for end in pair("limits", limits, "a pair of numbers: (lowest, highest)"))
    if low > high:
        raise ValueError(f"limits {limits} are the wrong way round: (lowest, highest)")
    return low, high
