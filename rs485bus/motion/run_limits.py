"""When a run must be stopped, lest it leaves the limits of its axis. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.motion.state import AxisState, Fact

_FOREVER = float("inf")


@dataclass(frozen=True, slots=True)
class RunLimits:
    """Between which positions a run may go.

    Args:
        low: the lowest one, in counts.
        high: the highest one.
        rate: its ramp down, in counts/s²; infinity for a jump.
        attempt: seconds that an attempt to stop it may take in vain.
    """

    low: int
    high: int
    rate: float
    attempt: float

    def stop_at(self, state: AxisState, speed: float, measured: float) -> float:
        """When it must be told to stop, by where it was last seen. Two attempts may fail.

        Args:
            state: what is known of the axis.
            speed: what it was told, in counts/s; its sign is the direction.
            measured: how fast it was seen to turn.
        """
        position = state.last(Fact.POSITION)
        if not speed or position.value is None:
            return _FOREVER
        fastest = max(abs(speed), measured * (1 if speed > 0 else -1))
        ahead = float(self.high - position.value if speed > 0 else position.value - self.low)
        return position.at + (ahead - fastest * fastest / (2 * self.rate)) / fastest - 2 * self.attempt
