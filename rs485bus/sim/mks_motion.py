"""What a virtual MKS drive does when it is told to move or to home. Source: MKS RTU V1.0.9, 5, 8 and 9."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import (
    GoHome,
    Homed,
    HomingMode,
    MotionDirection,
    ParameterDirection,
    SingleTurn,
    Status,
)
from rs485bus.sim.mks_memory import Refused
from rs485bus.sim.mks_shaft import FOREVER, MksShaft

_SINGLE_TURN_RPM = (30.0, 60.0, 120.0, 180.0, 240.0)
_COORDINATE_RPM = 600.0
_COORDINATE_RAMP = 1000.0
_OFF_SWITCH = 0.02


class MksMotion(MksShaft):
    """The shaft, as the drive's commands move it."""

    turn_zero: float | None = None
    """The zero of the turn (5.3.4); kept when it is switched off."""
    last_run: tuple[Any, ...] | None = None
    """The last speed command: what 0xFF saves."""

    def reset(self, now: float, enabled: bool) -> None:
        super().reset(now, enabled)
        self.last_run = None

    # Commands

    def run(self, values: tuple[Any, ...], now: float) -> None:
        """0xF6: direction, acceleration, speed, and the time if there is one."""
        direction, acceleration, speed, *runtime = values
        ramp = _ramp(acceleration)
        if speed == 0:
            self.stop_command(ramp, now)
            return
        self._check_may_move()
        rpm = _sign(direction) * self.rpm(speed)
        self.last_run = (direction, acceleration, speed)
        self.start(now, lambda now: self.motor.run(rpm, ramp, now))
        if runtime and runtime[0]:
            self.later(self.machine.start_delay + runtime[0] / 100, now, lambda now: self.motor.run(0, ramp, now))

    def move_pulses(self, values: tuple[Any, ...], now: float) -> None:
        """0xFD."""
        direction, acceleration, speed, pulses = values
        self._relative(acceleration, speed, _sign(direction) * self.turns(pulses), now)

    def move_counts(self, values: tuple[Any, ...], now: float) -> None:
        """0xF4."""
        acceleration, speed, counts = values
        self._relative(acceleration, speed, counts / r.COUNTS_PER_TURN, now)

    def move_to_pulses(self, values: tuple[Any, ...], now: float) -> None:
        """0xFE."""
        acceleration, speed, pulses = values
        if speed and self.motor.moving(now):
            raise Refused
        self._go(acceleration, speed, self.zero + self.turns(pulses), now)

    def move_to_counts(self, values: tuple[Any, ...], now: float) -> None:
        """0xF5: may change a move that runs (9.4, note 2)."""
        acceleration, speed, counts = values
        self._go(acceleration, speed, self.zero + counts / r.COUNTS_PER_TURN, now)

    def set_zero(self, now: float) -> None:
        """0x92."""
        self.zero = self.motor.position(now)
        self._error = 0

    def _relative(self, acceleration: int, speed: int, turns: float, now: float) -> None:
        if speed and (self.motor.moving(now) or self._pushing):
            raise Refused
        self._go(acceleration, speed, self.motor.position(now) + turns, now)

    def _go(self, acceleration: int, speed: int, target: float, now: float) -> None:
        ramp = _ramp(acceleration)
        if speed == 0:
            self.stop_command(ramp, now)
            return
        self._check_may_move()
        self.start(now, lambda now: self.motor.go_to(target, self.rpm(speed), ramp, now))

    def _check_may_move(self) -> None:
        if not self.mode.is_serial or not self.enabled or self.activity is not None:
            raise Refused

    # Homing

    def go_home(self, how: GoHome, now: float) -> None:
        """0x91: every write starts it anew."""
        if not self.mode.is_serial or not self.enabled or self.activity is Status.CALIBRATING:
            raise Refused
        if how is GoHome.COORDINATE:
            self.start(now, lambda now: self.motor.go_to(self.zero, _COORDINATE_RPM, _COORDINATE_RAMP, now))
            return
        mode = self._homing_mode
        if mode is HomingMode.SINGLE_TURN:
            self.home_in_turn(now)
            return
        self._events.clear()
        self.moves += 1
        self.has_moved = True
        _, direction, speed, _ = self.settings[r.HOMING.address]
        self.activity = Status.HOMING
        self.homed = (self.homed[0], Homed.UNDER_WAY)
        way = -1 if direction is ParameterDirection.CW else 1
        rpm = float(max(1, speed))
        if mode is HomingMode.STOP:
            self._home_by_stop(rpm, way, now)
        else:
            self._home_by_switch(rpm, way, now)

    def home_in_turn(self, now: float) -> None:
        """To the zero of the turn, as 0x9A says."""
        mode, _, speed, direction = self.settings[r.SINGLE_TURN.address]
        if self.turn_zero is None or mode is SingleTurn.OFF:
            self.homed = (Homed.NOT_DONE, self.homed[1])
            return
        self._events.clear()
        self.moves += 1
        self.has_moved = True
        position = self.motor.position(now)
        way = (self.turn_zero - position) % 1.0
        if mode is SingleTurn.NEAREST:
            way = way - 1.0 if way > 0.5 else way
        elif direction is ParameterDirection.CW and way:
            way -= 1.0
        self.activity = Status.HOMING
        self.homed = (Homed.UNDER_WAY, self.homed[1])
        self._leg(position + way, _SINGLE_TURN_RPM[speed], now, self._found)

    def _home_by_stop(self, rpm: float, way: int, now: float) -> None:
        end = self.machine.travel[0 if way < 0 else 1]
        if self.machine.load > self._force:
            end = self.motor.position(now)  # too little current: it takes the load for the stop
        back = end - way * self.settings[r.HOMING_TORQUE.address][0] / r.COUNTS_PER_TURN
        self._leg(end, rpm, now, lambda now: self._leg(back, rpm, now, self._found))

    def _home_by_switch(self, rpm: float, way: int, now: float) -> None:
        switch, position = self.machine.home_switch, self.motor.position(now)
        if switch is not None and self.at_home(position):
            # It starts on the switch: off it first, the other way (5.1). Below the switch it never comes off it.
            off = switch + _OFF_SWITCH if way < 0 else -FOREVER
            self._leg(off, rpm, now, lambda now: self._leg(switch, rpm, now, self._found))
            return
        seen = switch is not None and way < 0 and self.at_home(switch)
        self._leg(switch if seen and switch is not None else way * FOREVER, rpm, now, self._found)

    def _leg(self, target: float, rpm: float, now: float, then: Callable[[float], None]) -> None:
        """Go there without a ramp, then do the next thing; what is not there is looked for for ever."""
        if math.isinf(target):
            self.motor.run(math.copysign(rpm, target), FOREVER, now)
            return
        self.motor.go_to(target, rpm, FOREVER, now)
        self._events.append((self.motor.arrives_at, then))

    def _found(self, now: float) -> None:
        self.activity = None
        self.stalled = False
        self.set_zero(now)
        single, origin = self.homed
        self.homed = (Homed.DONE, origin) if single is Homed.UNDER_WAY else (single, Homed.DONE)

    @property
    def _homing_mode(self) -> HomingMode:
        return HomingMode(self.settings[r.HOMING_TORQUE.address][1])

    @property
    def _force(self) -> int:
        """The current it moves with, in mA: homing against a stop has one of its own (5.3.3)."""
        if self.activity is Status.HOMING and self._homing_mode is HomingMode.STOP:
            return int(self.settings[r.HOMING_TORQUE.address][2])
        return self.current


def _ramp(acceleration: int) -> float:
    """rpm/s of an acceleration code (7.1): one rpm every (256 - code) * 50 µs, 0 for a jump."""
    return 20_000 / (256 - acceleration) if acceleration else FOREVER


def _sign(direction: MotionDirection) -> int:
    return 1 if direction is MotionDirection.CCW else -1
