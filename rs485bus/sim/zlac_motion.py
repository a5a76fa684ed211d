"""The motor side of a virtual ZLAC8015D: one wheel, its encoder and its brake. Source: ZLAC8015D RS485 V1.06."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.values import Brake, ControlMode, Fault, ShaftState, Side
from rs485bus.sim.motor import Motor
from rs485bus.wire.registers import Register

_FRICTION = 300.0
"""rpm/s by which a wheel that nobody holds slows down."""
_RPM_PER_MILLIAMPERE = 0.05
"""How fast the load lets the wheel turn for a torque."""
_LOAD = 300
"""mA that a turning wheel takes."""


class SimWheel:
    """One wheel.

    Args:
        side: which one.
        value: reads a register of the drive.
        counts: what its counter begins with.
        ramp_rpm: the change of speed that takes the ramp time; None for any change.
        enable_resumes: enabling it goes on with the target that an emergency stop interrupted.
        following_error: counts by which it stands off its target.
    """

    def __init__(
        self,
        side: Side,
        value: Callable[[Register[Any]], Any],
        counts: int,
        ramp_rpm: float | None,
        enable_resumes: bool,
        following_error: int = 0,
    ) -> None:
        self.side = side
        self.motor = Motor()
        self.state = ShaftState.RELEASED
        self.faults = Fault(0)
        self.moves = 0
        """How often a start word set it in motion."""
        self.temperature = 31
        self.hall = 3
        self._value = value
        self._first = counts
        self._ramp_rpm = ramp_rpm
        self._enable_resumes = enable_resumes
        self._following_error = following_error
        self._zero = 0.0
        self._origin = -counts / self._counts_per_turn
        self._goal: float | None = None
        """The position, in turns, that it was sent to and has not reached."""

    # What one sees of it

    def counts(self, now: float) -> int:
        """What its counter reads: 32 bits that wrap."""
        counts = self._first + round((self.motor.position(now) - self._zero) * self._counts_per_turn)
        return (counts + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000

    def torque(self, now: float) -> int:
        """mA."""
        if self.state is ShaftState.LOCKED and self._value(r.MODE) is ControlMode.TORQUE:
            return int(self._value(r.TARGET_TORQUE.of(self.side)))
        return int(math.copysign(_LOAD, self.motor.rpm(now))) if self.motor.moving(now) else 0

    # What happens to it

    def power_on(self, locked: bool, now: float) -> None:
        """Count from zero where it stands, and forget all else."""
        self.motor.halt(now)
        self.state = ShaftState.LOCKED if locked else ShaftState.RELEASED
        self.faults = Fault(0)
        self._goal = None
        self._first = 0
        self._zero = self._origin = self.motor.position(now)

    def fail(self, fault: Fault, now: float) -> None:
        """It reports an error and is held no longer."""
        self.faults |= fault
        self.state = ShaftState.ALARM
        self._coast(now)

    # Commands

    def enable(self, now: float) -> None:
        """0x08: whatever its target is now holds."""
        self.state = ShaftState.LOCKED
        self.obey(now)

    def obey(self, now: float) -> None:
        """Do what mode and targets say."""
        if self.state is not ShaftState.LOCKED:
            return
        mode = self._value(r.MODE)
        if mode is ControlMode.VELOCITY:
            self._goal = None
            self._run(self._value(r.TARGET_VELOCITY.of(self.side)) / self._value(r.SPEED_RESOLUTION), now)
        elif mode is ControlMode.TORQUE:
            self._goal = None
            self._push(self._value(r.TARGET_TORQUE.of(self.side)), now)
        elif mode.is_position and self._goal is not None and self._enable_resumes:
            self._go(self._goal, now)

    def start(self, now: float) -> None:
        """0x10, 0x11 or 0x12: go to the target, or as far as it says."""
        mode = self._value(r.MODE)
        if self.state is not ShaftState.LOCKED or not mode.is_position:
            return
        target = self._value(r.TARGET_POSITION.of(self.side))
        if mode is ControlMode.POSITION_ABSOLUTE and abs(target) > r.MAX_ABSOLUTE:
            return
        base = self._origin if mode is ControlMode.POSITION_ABSOLUTE else self.motor.position(now)
        self.moves += 1
        self._go(base + target / self._counts_per_turn, now)

    def quick_stop(self, state: ShaftState, now: float) -> None:
        """Stop with the quick ramp. The target stays what it was."""
        if self.state in (ShaftState.LOCKED, ShaftState.EMERGENCY_STOP):
            self.state = state
            self.motor.run(0, self._rate(self.motor.rpm(now), r.QUICK_STOP_TIME), now)

    def release(self, now: float) -> None:
        """0x07."""
        if self.state is not ShaftState.ALARM:
            self.state = ShaftState.RELEASED
            self._coast(now)

    def clear_faults(self, now: float) -> None:
        """0x06."""
        self.faults = Fault(0)
        if self.state is ShaftState.ALARM:
            self.state = ShaftState.RELEASED

    def clear_position(self, now: float) -> None:
        """0x2005: the counter begins anew; where absolute targets are counted from stays."""
        self._first, self._zero = 0, self.motor.position(now)

    def reset_zero(self, now: float) -> None:
        """0x2006: absolute targets are counted from here."""
        self._origin = self.motor.position(now)

    # How it moves

    @property
    def _counts_per_turn(self) -> float:
        return max(1.0, float(r.COUNTS_PER_LINE * self._value(r.ENCODER_LINES.of(self.side))))

    def _rate(self, change: float, time: r.Twin[int]) -> float:
        """rpm/s of a ramp time for a change of speed."""
        seconds = self._value(time.of(self.side)) / 1000
        return abs(self._ramp_rpm or change) / seconds if seconds and change else math.inf

    def _run(self, rpm: float, now: float) -> None:
        limit = self._value(r.SPEED_LIMIT)
        rpm = max(-limit, min(limit, rpm))
        old = self.motor.rpm(now)
        if not self._is_free(rpm, now) or (rpm == old and not self.motor.moving(now)):
            return
        faster = abs(rpm) > abs(old)
        self.motor.run(rpm, self._rate(rpm - old, r.ACCELERATION_TIME if faster else r.DECELERATION_TIME), now)

    def _push(self, milliamperes: int, now: float) -> None:
        rpm = milliamperes * _RPM_PER_MILLIAMPERE
        if self._is_free(rpm, now):
            slope = self._value(r.TORQUE_SLOPE.of(self.side)) * _RPM_PER_MILLIAMPERE
            self.motor.run(rpm, slope or math.inf, now)

    def _go(self, goal: float, now: float) -> None:
        self._goal = goal
        rpm = float(min(self._value(r.POSITION_SPEED.of(self.side)), self._value(r.SPEED_LIMIT)))
        if self._is_free(goal - self.motor.position(now), now):
            goal += self._following_error / self._counts_per_turn
            self.motor.go_to(goal, rpm, self._rate(rpm, r.ACCELERATION_TIME), now)

    def _is_free(self, wanted: float, now: float) -> bool:
        """Whether it can turn; a closed brake overloads it."""
        if wanted and self._value(r.BRAKE.of(self.side)) is Brake.CLOSED:
            self.fail(Fault.OVER_LOAD, now)
            return False
        return True

    def _coast(self, now: float) -> None:
        self.motor.run(0, _FRICTION, now)
