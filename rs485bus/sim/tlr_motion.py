"""The motor side of a virtual TL-R drive: what its shaft does. Source: TL-R manual, 3."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable

from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.values import DiFunction, HomingMode, LimitStop, OperatingMode, Ports, StatusWord
from rs485bus.sim.motor import Motor
from rs485bus.sim.tlr_homing import HomingRun
from rs485bus.sim.tlr_machine import FOREVER, TlrMachine
from rs485bus.sim.tlr_memory import Memory

ENCODER_STEPS = 4000
"""A turn: 1000 lines, four edges each (1.3)."""
POSITION_ERROR = 5
_SAME = 1e-9
"""Seconds by which two moments may differ that are the same."""
_NUDGE = 1e-7


class Activity(enum.Enum):
    """What the motor is doing."""

    NONE = enum.auto()
    POSITIONING = enum.auto()
    JOGGING = enum.auto()
    HOMING = enum.auto()


class Denied(Exception):
    """The drive does not do that now."""


class TlrMotion:
    """The shaft, and what the drive knows of it.

    Args:
        memory: what the drive is set to.
        machine: what the shaft drives.
        shaft: where the shaft stands, in turns of the machine.
        ramp_rpm: the speed that ramp times refer to; None for that of the move.
        goes_to_offset: after homing it goes to the offset and counts from zero there; otherwise the origin is the
            offset.
    """

    def __init__(
        self, memory: Memory, machine: TlrMachine, shaft: float, ramp_rpm: float | None, goes_to_offset: bool
    ) -> None:
        self.memory = memory
        self.machine = machine
        self.motor = Motor(shaft)
        self.ramp_rpm = ramp_rpm
        self.goes_to_offset = goes_to_offset
        self.moves = 0
        """How often it was set in motion."""
        self.inputs_changed: Callable[[float], None] = lambda now: None
        """Called when a switch of the machine may have closed or opened."""
        self.activity = Activity.NONE
        self.alarm = 0
        self.enabled = False
        self.homed = False
        self.in_position = False
        self.active: frozenset[DiFunction] = frozenset()
        """What the inputs want."""
        self.closed_loop = True
        self._zero = shaft
        self._slip = 0.0
        self._down = FOREVER
        self._homing: HomingRun | None = None
        self._events: list[tuple[float, Callable[[float], None]]] = []
        self._last = 0.0

    def reset(self, now: float, enabled: bool) -> None:
        """Switched on: count from zero where the shaft is."""
        self.halt(now)
        self.motor.place(self.shaft(now), now)
        self._slip = 0.0
        self._zero = self.motor.position(now)
        self.enabled, self.homed, self.in_position, self.alarm = enabled, False, False, 0
        self.closed_loop = self.memory.get(r.OPERATING_MODE) is OperatingMode.CLOSED_LOOP
        self._last = now

    # What one sees of it

    def shaft(self, now: float) -> float:
        """Where the shaft is, in turns of the machine."""
        return self.motor.position(now) - self._slip

    def running(self, now: float) -> bool:
        """Whether the status says so."""
        return self.motor.moving(now)

    def pulses(self, now: float) -> int:
        """What the position reads, before it is cut to 32 bits: of a closed loop what its encoder sees."""
        turns = self.motor.position(now) - self._zero
        if self.closed_loop:
            turns = round((self.shaft(now) - self._zero) * ENCODER_STEPS) / ENCODER_STEPS
        error = self.machine.following_error if self.closed_loop and not self.motor.moving(now) else 0
        return round(self._sign * turns * self._subdivision) + error

    def rpm(self, now: float) -> float:
        """Its speed, in the direction in which pulses count."""
        return self._sign * self.motor.rpm(now)

    def status(self, now: float) -> StatusWord:
        """What the status reads, but for the bit that says whether it is enabled."""
        low, high = self._soft_limits()
        pulses = self.pulses(now)
        flags = {
            StatusWord.IN_POSITION: self.in_position,
            StatusWord.HOMED: self.homed,
            StatusWord.RUNNING: self.running(now),
            StatusWord.FAULT: bool(self.alarm),
            StatusWord.POSITIVE_SOFT_LIMIT: pulses >= high,
            StatusWord.NEGATIVE_SOFT_LIMIT: pulses <= low,
        }
        return StatusWord(sum(bit for bit, is_set in flags.items() if is_set))

    # Time

    def advance(self, now: float) -> None:
        """Let everything happen until now, each at its time."""
        met = -FOREVER
        while True:
            due = min(self._events, default=None, key=lambda event: event[0])
            until = min(now, FOREVER if due is None else max(due[0], self._last))
            hits = [] if not self.motor.moving(self._last) else self._hits(until)
            # What holds the shaft goes with it: it comes to that again, by rounding.
            hits = [hit for hit in hits if hit > met + _SAME]
            if hits:
                self._last = met = min(hits)
                self._meet(met)
            elif due is not None and due[0] <= now:
                self._last = until
                self._events.remove(due)
                due[1](until)
            else:
                self._last = now
                self._meet(now)
                return

    def _hits(self, until: float) -> list[float]:
        places = [place + self._slip for place in self.machine.places()]
        places += [self._place(limit) for limit in self._soft_limits() if math.isfinite(limit)]
        hits = [self.motor.reaches(place, self._last, until) for place in places]
        return [hit for hit in hits if hit is not None]

    def _meet(self, now: float) -> None:
        """The shaft may have come to a switch, a limit or a stop."""
        low, high = self.machine.travel
        shaft, rpm = self.shaft(now), self.motor.rpm(now)
        if not self.closed_loop:
            self._slip += shaft - min(max(shaft, low), high)
        elif (rpm > 0 and shaft >= high) or (rpm < 0 and shaft <= low):
            self.fail(POSITION_ERROR, now)
        self.inputs_changed(now)
        way = self.rpm(now)
        homing_to = self._homing.switch if self._homing is not None else None
        limit = DiFunction.POSITIVE_LIMIT if way > 0 else DiFunction.NEGATIVE_LIMIT
        if way and limit in self.active and limit is not homing_to:
            if self.memory.get(r.LIMIT_STOP) is LimitStop.EMERGENCY:
                self.halt(now)
            elif self.motor.target is not None or self.activity is not Activity.NONE:
                self.stop(now)
        if way and self._beyond_soft_limit(way, now):
            self.halt(now)

    def closed(self, now: float) -> Ports:
        """The inputs that the machine's switches close."""
        rpm = self.motor.rpm(now)
        # On the very edge of a switch the direction decides.
        switches = self.machine.closed(self.shaft(now) + _NUDGE * ((rpm > 0) - (rpm < 0)))
        return Ports(sum(1 << port for port, is_closed in enumerate(switches) if is_closed))

    # Commands

    def position(
        self, start: int, up: int, down: int, speed: int, target: int, *, relative: bool, interrupt: bool, now: float
    ) -> None:
        """Go to a target, with what 0x33 to 0x38 hold."""
        if self.activity is Activity.POSITIONING and not interrupt:
            return
        here = self.motor.position(now)
        goal = here + self._sign * target / self._subdivision if relative else self._place(target)
        if not speed or not self._may_move(self._sign * (goal - here), now):
            raise Denied
        self._down = self._rate(down, speed)

        def go(now: float) -> None:
            self.motor.go_to(goal, speed, self._rate(up, speed), now, down=self._rate(down, speed), start=start)
            self._events.append((self.motor.arrives_at, self._arrive))

        self._begin(Activity.POSITIONING, go, now)

    def jog(self, speed: int, up: int, down: int, *, now: float) -> None:
        """Turn at a speed until told otherwise."""
        if not speed or not self._may_move(speed, now):
            raise Denied
        self._down = self._rate(down, speed)
        rate = self._rate(up, speed)
        self._begin(Activity.JOGGING, lambda now: self.motor.run(self._sign * speed, rate, now), now)

    def home(self, now: float) -> None:
        """Find the origin."""
        mode, speed, creep, ramp, offset = self.memory.block(r.HOMING)
        if not self._may_move(0, now):
            raise Denied
        self.halt(now)
        self.homed = self.homed and self.machine.stays_homed
        if mode is HomingMode.HERE:
            self.moves += 1
            self._found(offset, speed, now)
            return
        rate = self._down = self._rate(ramp, speed)

        def run(way: int, creeping: bool, now: float) -> None:
            self.motor.run(self._sign * way * (creep if creeping else speed), rate, now)

        def turn(now: float) -> None:
            self.motor.run(0, rate, now)
            self._events.append((self.motor.arrives_at + self.machine.homing_pause, homing.go_on))

        homing = HomingRun(mode, mode.needs in self.active, run, turn, lambda now: self._found(offset, speed, now))
        self._begin(Activity.HOMING, homing.go_on, now)
        self._homing = homing

    def see_switch(self, now: float) -> None:
        """The inputs are up to date."""
        if self._homing is not None and self.motor.moving(now):
            self._homing.see(self._homing.switch in self.active, now)

    def stop(self, now: float) -> None:
        """Slow down with the ramp of what it does."""
        self._forget()
        if self.motor.moving(now):
            self.motor.run(0, self._down, now)

    def halt(self, now: float) -> None:
        """Stand at once."""
        self._forget()
        self.motor.halt(now)

    def fail(self, alarm: int, now: float) -> None:
        """Raise an alarm: the motor is let go."""
        self.halt(now)
        self.alarm = alarm
        self.enabled = False

    def clear_position(self, now: float) -> None:
        """Count from zero here."""
        self._zero = self.motor.position(now)

    # Inside

    def _begin(self, activity: Activity, go: Callable[[float], None], now: float) -> None:
        self._forget()
        self.moves += 1
        self.in_position = False
        self.activity = activity
        if self.motor.moving(now) or not self.machine.start_delay:
            go(now)
        else:
            self._events.append((now + self.machine.start_delay, go))

    def _forget(self) -> None:
        self._events.clear()
        self._homing = None
        self.activity = Activity.NONE

    def _arrive(self, now: float) -> None:
        self.activity = Activity.NONE
        self.in_position = True

    def _found(self, offset: int, speed: int, now: float) -> None:
        self.halt(now)
        self._zero = self.motor.position(now)
        if offset and self.goes_to_offset:
            self.activity = Activity.HOMING
            self.motor.go_to(self._place(offset), speed, self._down, now)
            self._events.append((self.motor.arrives_at, self._at_home))
            return
        self._at_home(now)
        self._zero -= self._sign * offset / self._subdivision

    def _at_home(self, now: float) -> None:
        self._zero = self.motor.position(now)
        self.homed = True
        self._arrive(now)

    def _may_move(self, way: float, now: float) -> bool:
        """Whether it takes a command that goes in a direction of its pulses."""
        held = {DiFunction.STOP, DiFunction.EMERGENCY_STOP, DiFunction.RELEASE}
        if way:
            held.add(DiFunction.POSITIVE_LIMIT if way > 0 else DiFunction.NEGATIVE_LIMIT)
        beyond = bool(way) and self._beyond_soft_limit(way, now)
        return self.enabled and not self.alarm and not beyond and held.isdisjoint(self.active)

    def _soft_limits(self) -> tuple[float, float]:
        """They count only after homing (3.5.3)."""
        if not (self.homed and self.memory.get(r.SOFT_LIMITS_ON)):
            return -FOREVER, FOREVER
        return self.memory.get(r.NEGATIVE_SOFT_LIMIT), self.memory.get(r.POSITIVE_SOFT_LIMIT)

    def _beyond_soft_limit(self, way: float, now: float) -> bool:
        low, high = self._soft_limits()
        pulses = self._sign * (self.motor.position(now) - self._zero) * self._subdivision
        return pulses >= high - 1e-3 if way > 0 else pulses <= low + 1e-3

    def _place(self, pulses: float) -> float:
        """Where the motor is to be, in turns, for a position in pulses."""
        return self._zero + self._sign * pulses / self._subdivision

    def _rate(self, milliseconds: int, speed: int) -> float:
        """rpm/s of a ramp time."""
        return (self.ramp_rpm or abs(speed)) * 1000 / milliseconds if milliseconds else FOREVER

    @property
    def _sign(self) -> int:
        return -1 if self.memory.get(r.DIRECTION) else 1

    @property
    def _subdivision(self) -> int:
        return self.memory.get(r.SUBDIVISION)
