"""The motor side of a virtual MKS SERVO drive: what its shaft does, and the machine on it. Source: MKS RTU V1.0.9."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import (
    GoHome,
    Homed,
    HomingMode,
    Inputs,
    Level,
    MotionDirection,
    ParameterDirection,
    SingleTurn,
    Status,
    WorkMode,
)
from rs485bus.sim.motor import Motor

FOREVER = math.inf
_SINGLE_TURN_RPM = (30.0, 60.0, 120.0, 180.0, 240.0)
_COORDINATE_RPM = 600.0
_OFF_SWITCH = 0.02


class Refused(Exception):
    """The drive says no inside a normal reply (2.4)."""


@dataclass(slots=True)
class Machine:
    """What the shaft drives. Positions are turns of the machine; counter-clockwise is up."""

    home_switch: float | None = -2.0
    """IN_1 is active from here down; None for no switch."""
    right_switch: float | None = None
    """IN_2 is active from here up; None for no switch."""
    travel: tuple[float, float] = (-FOREVER, FOREVER)
    """The mechanical stops."""
    load: int = 0
    """The current, in mA, that it takes to move it. A motor with less stalls."""
    start_delay: float = 0.005
    """Seconds between a command and the start."""
    following_error: int = 0
    """Counts by which the shaft stands off its target (9.4.3 and 9.4.4 log -1 and +1)."""


class MksMotion:
    """The shaft, and what the drive knows of it.

    Args:
        settings: the settings of the drive, by register.
        machine: what the shaft drives.
        shaft: where the shaft stands, in turns of the machine.
    """

    def __init__(self, settings: dict[int, Any], machine: Machine, shaft: float) -> None:
        self.settings = settings
        self.machine = machine
        self.motor = Motor(shaft)
        self.moves = 0
        """How often it was set in motion."""
        self.zero = shaft
        self.turn_zero = 0.0
        self.current = 0
        self.enabled = False
        self.stalled = False
        self.activity: Status | None = None
        """Homing or calibrating."""
        self.homed = (Homed.NOT_DONE, Homed.NOT_DONE)
        self.has_moved = False
        self.last_run: tuple[Any, ...] | None = None
        self._events: list[tuple[float, Callable[[float], None]]] = []
        self._pushing = False
        self._error = 0

    def reset(self, now: float, enabled: bool) -> None:
        """Forget all but the settings; count from zero where the shaft is."""
        self.motor.halt(now)
        self._events.clear()
        self.zero = self.motor.position(now)
        self.current = int(self.settings[r.CURRENT.address])
        self.enabled = enabled
        self.stalled = self.has_moved = self._pushing = False
        self.activity = None
        self.homed = (Homed.NOT_DONE, Homed.NOT_DONE)
        self.last_run = None
        self._error = 0

    # What one sees of it

    @property
    def mode(self) -> WorkMode:
        return WorkMode(self.settings[r.WORK_MODE.address])

    def counts(self, now: float) -> int:
        """What 0x31 reads."""
        counts = round((self.motor.position(now) - self.zero) * r.COUNTS_PER_TURN)
        return counts if self.motor.moving(now) else counts + self._error

    def pulses(self, now: float) -> int:
        """What 0x33 reads, before it is cut to 32 bits."""
        return round((self.motor.position(now) - self.zero) / self._turns(1))

    def status(self, now: float) -> Status:
        """What 0xF1 reads."""
        if self.activity is not None:
            return self.activity
        if self.motor.moving(now):
            faster = self.motor.getting_faster(now)
            return Status.FULL_SPEED if faster is None else Status.SPEEDING_UP if faster else Status.SLOWING_DOWN
        return Status.FULL_SPEED if self._pushing else Status.STOPPED

    def inputs(self, now: float) -> Inputs:
        """The inputs of 0x34: each is at the level at which it triggers while its switch is closed."""
        trigger = self.settings[r.HOMING.address][0]
        position = self.motor.position(now)
        closed = (self._at_home(position), self._at_right(position))
        high = [closed_one == (trigger is Level.HIGH) for closed_one in closed]
        return (Inputs.IN_1 if high[0] else Inputs(0)) | (Inputs.IN_2 if high[1] else Inputs(0))

    # Time

    def advance(self, last: float, now: float, starves_at: float, starved: Callable[[float], None]) -> None:
        """Let everything happen until now, each at its time: what was planned, collisions, a starved watchdog."""
        while True:
            due = min(self._events, default=None, key=lambda event: event[0])
            starves = max(last, starves_at) if self.motor.moving(last) else FOREVER
            when = min(now, starves, due[0] if due else FOREVER)
            self._collide(last, when)
            last = when
            if due is not None and due[0] <= when and due in self._events:
                self._events.remove(due)
                due[1](due[0])
            elif starves <= when:
                starved(starves)
            else:
                return

    def later(self, delay: float, now: float, happen: Callable[[float], None]) -> None:
        """Plan something; a stop, and the next command, forget it."""
        self._events.append((now + delay, happen))

    # Commands

    def run(self, values: tuple[Any, ...], now: float) -> None:
        """0xF6: direction, acceleration, speed, and the time if there is one."""
        direction, acceleration, speed, *runtime = values
        ramp = _ramp(acceleration)
        if speed == 0:
            self._stop_command(ramp, now)
            return
        self._check_may_move()
        self._events.clear()
        rpm = _sign(direction) * self._rpm(speed)
        self.last_run = (direction, acceleration, speed)
        self._start(now, lambda now: self.motor.run(rpm, ramp, now))
        if runtime and runtime[0]:
            self.later(self.machine.start_delay + runtime[0] / 100, now, lambda now: self.motor.run(0, ramp, now))

    def move_pulses(self, values: tuple[Any, ...], now: float) -> None:
        """0xFD."""
        direction, acceleration, speed, pulses = values
        self._relative(acceleration, speed, _sign(direction) * self._turns(pulses), now)

    def move_counts(self, values: tuple[Any, ...], now: float) -> None:
        """0xF4."""
        acceleration, speed, counts = values
        self._relative(acceleration, speed, counts / r.COUNTS_PER_TURN, now)

    def move_to_pulses(self, values: tuple[Any, ...], now: float) -> None:
        """0xFE."""
        acceleration, speed, pulses = values
        self._absolute(acceleration, speed, self._turns(pulses), now, live=False)

    def move_to_counts(self, values: tuple[Any, ...], now: float) -> None:
        """0xF5: may change a move that runs (9.4, note 2)."""
        acceleration, speed, counts = values
        self._absolute(acceleration, speed, counts / r.COUNTS_PER_TURN, now, live=True)

    def stop(self, ramp: float, now: float) -> None:
        """Slow down with a ramp in rpm/s, or at once."""
        self._events.clear()
        self._pushing = False
        if self.activity is Status.HOMING:
            self.homed = (Homed.NOT_DONE, Homed.NOT_DONE)
        self.activity = None
        if ramp < FOREVER:
            self.motor.run(0, ramp, now)
        else:
            self.motor.halt(now)

    def enable(self, on: bool, now: float) -> None:
        """0xF3."""
        if not self.mode.is_serial or (on and self.stalled and self.settings[r.STALL_PROTECTION.address]):
            raise Refused
        if not on:
            self.stop(FOREVER, now)
        self.enabled = on

    def release_stall(self) -> None:
        """0x3D."""
        self.enabled = self.enabled or self.stalled
        self.stalled = self._pushing = False

    def set_zero(self, now: float) -> None:
        """0x92."""
        self.zero = self.motor.position(now)
        self._error = 0

    # Homing

    def go_home(self, how: GoHome, now: float) -> None:
        """0x91: every write starts it anew."""
        if not self.mode.is_serial or not self.enabled or self.activity is Status.CALIBRATING:
            raise Refused
        self._events.clear()
        self.moves += 1
        self.has_moved = True
        if how is GoHome.COORDINATE:
            self.motor.go_to(self.zero, _COORDINATE_RPM, 1000.0, now)
            return
        _, direction, speed, _ = self.settings[r.HOMING.address]
        offset, mode, _ = self.settings[r.HOMING_TORQUE.address]
        self.activity = Status.HOMING
        self.homed = (self.homed[0], Homed.UNDER_WAY)
        way = -1 if direction is ParameterDirection.CW else 1
        rpm = float(max(1, speed))
        if mode is HomingMode.SINGLE_TURN:
            self.home_in_turn(now)
        elif mode is HomingMode.STOP:
            end = self.machine.travel[0 if way < 0 else 1]
            back = end - way * offset / r.COUNTS_PER_TURN
            self._leg(end, rpm, way, now, lambda now: self._leg(back, rpm, way, now, self._found))
        else:
            self._home_by_switch(rpm, way, now)

    def home_in_turn(self, now: float) -> None:
        """To the zero of the turn, as 0x9A says."""
        mode, _, speed, direction = self.settings[r.SINGLE_TURN.address]
        position = self.motor.position(now)
        way = (self.turn_zero - position) % 1.0
        if mode is SingleTurn.NEAREST:
            way = way - 1.0 if way > 0.5 else way
        elif direction is ParameterDirection.CW:
            way -= 1.0
        self.activity = Status.HOMING
        self.homed = (Homed.UNDER_WAY, self.homed[1])
        self._leg(position + way, _SINGLE_TURN_RPM[speed], 1, now, self._found)

    def _home_by_switch(self, rpm: float, way: int, now: float) -> None:
        switch, position = self.machine.home_switch, self.motor.position(now)
        if switch is not None and self._at_home(position):
            # It starts on the switch: off it first, the other way (5.1).
            self._leg(switch + _OFF_SWITCH, rpm, way, now, lambda now: self._leg(switch, rpm, way, now, self._found))
            return
        found = switch is not None and (switch - position) * way > 0
        self._leg(switch if found and switch is not None else way * FOREVER, rpm, way, now, self._found)

    def _leg(self, target: float, rpm: float, way: int, now: float, then: Callable[[float], None]) -> None:
        """Go there without a ramp, then do the next thing; what is not there is looked for for ever."""
        if math.isinf(target):
            self.motor.run(way * rpm, FOREVER, now)
            return
        self.motor.go_to(target, rpm, FOREVER, now)
        self._events.append((self.motor.arrives_at, then))

    def _found(self, now: float) -> None:
        self.activity = None
        self.stalled = False
        self.set_zero(now)
        single = self.settings[r.HOMING_TORQUE.address][1] is HomingMode.SINGLE_TURN
        self.homed = (Homed.DONE, self.homed[1]) if single else (self.homed[0], Homed.DONE)

    # How it moves

    def _relative(self, acceleration: int, speed: int, turns: float, now: float) -> None:
        if speed and (self.motor.moving(now) or self._pushing):
            raise Refused
        self._go(acceleration, speed, self.motor.position(now) + turns, now)

    def _absolute(self, acceleration: int, speed: int, turns: float, now: float, live: bool) -> None:
        if speed and not live and self.motor.moving(now):
            raise Refused
        self._go(acceleration, speed, self.zero + turns, now)

    def _go(self, acceleration: int, speed: int, target: float, now: float) -> None:
        ramp = _ramp(acceleration)
        if speed == 0:
            self._stop_command(ramp, now)
            return
        self._check_may_move()
        self._events.clear()
        self._start(now, lambda now: self.motor.go_to(target, self._rpm(speed), ramp, now))

    def _start(self, now: float, begin: Callable[[float], None]) -> None:
        self.moves += 1
        self.has_moved = True
        self._error = self.machine.following_error
        if self.machine.load > self.current:
            self._stall()
        elif self.motor.moving(now) or not self.machine.start_delay:
            begin(now)
        else:
            self.later(self.machine.start_delay, now, begin)

    def _stop_command(self, ramp: float, now: float) -> None:
        if not self.motor.moving(now) and not self._events and not self._pushing:
            raise Refused  # 9.1.3 and 9.3.3 log the stop of a standing motor as refused
        self.stop(ramp, now)

    def _check_may_move(self) -> None:
        if not self.mode.is_serial or not self.enabled or self.activity is not None:
            raise Refused

    def _collide(self, last: float, now: float) -> None:
        """The shaft goes no further than the mechanical stops nor, with limits on, than the switches."""
        if not self._is_out(now):
            return
        early, late = last, now
        for _ in range(40):
            middle = (early + late) / 2
            early, late = (early, middle) if self._is_out(middle) else (middle, late)
        low, high = self.machine.travel
        position = self.motor.position(late)
        self._events.clear()
        self.motor.place(min(max(position, low), high), late)
        if not low <= position <= high:
            self._stall()

    def _is_out(self, now: float) -> bool:
        low, high = self.machine.travel
        position, rpm = self.motor.position(now), self.motor.rpm(now)
        if not low <= position <= high:
            return True
        if not self.settings[r.HOMING.address][3] or self.activity is not None:
            return False
        return (rpm < 0 and self._at_home(position)) or (rpm > 0 and self._at_right(position))

    def _stall(self) -> None:
        self.stalled = True
        if self.settings[r.STALL_PROTECTION.address]:
            self.enabled = False
        elif self.activity is None:
            self._pushing = True
        if self.activity is Status.HOMING:
            self.activity = None
            self.homed = (Homed.NOT_DONE, Homed.NOT_DONE)

    def _at_home(self, position: float) -> bool:
        return self.machine.home_switch is not None and position <= self.machine.home_switch + 1e-9

    def _at_right(self, position: float) -> bool:
        return self.machine.right_switch is not None and position >= self.machine.right_switch - 1e-9

    def _rpm(self, speed: int) -> float:
        """The rpm that a speed value makes (7.1): it is calibrated for 16, 32 and 64 microsteps."""
        microsteps = self.settings[r.MICROSTEPS.address]
        rpm = float(speed) if microsteps in (16, 32, 64) else speed * 16 / microsteps
        return min(rpm, float(self.mode.max_rpm))

    def _turns(self, pulses: int) -> float:
        return pulses / (r.STEPS_PER_TURN * float(self.settings[r.MICROSTEPS.address]))


def _ramp(acceleration: int) -> float:
    """rpm/s of an acceleration code (7.1): one rpm every (256 - code) * 50 µs, 0 for a jump."""
    return 20_000 / (256 - acceleration) if acceleration else FOREVER


def _sign(direction: MotionDirection) -> int:
    return 1 if direction is MotionDirection.CCW else -1
