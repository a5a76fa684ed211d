"""The shaft of a virtual MKS drive: how it starts, stalls, meets limits and stops. Source: MKS RTU V1.0.9."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.values import Homed, Inputs, Level, Model, Status, WorkMode
from rs485bus.sim.mks_machine import Machine
from rs485bus.sim.mks_memory import Refused
from rs485bus.sim.motor import Motor

FOREVER = math.inf
_CONTACT = 1e-9
"""Turns within which the shaft touches a stop without pushing."""


class MksShaft:
    """The motor, the machine on it, and what the drive knows of both.

    Args:
        settings: the settings of the drive, by register.
        model: which drive.
        machine: what the shaft drives.
        position: where the shaft stands, in turns of the machine.
    """

    def __init__(self, settings: dict[int, Any], model: Model, machine: Machine, position: float) -> None:
        self.settings = settings
        self.model = model
        self.machine = machine
        self.motor = Motor(position)
        self.moves = 0
        """How often it was set in motion."""
        self.has_moved = False
        self.zero = position
        self.current = 0
        self.enabled = False
        self.stalled = False
        self.protected = False
        """A protection has let go of the shaft."""
        self.activity: Status | None = None
        """Homing or calibrating."""
        self.homed = (Homed.NOT_DONE, Homed.NOT_DONE)
        self._events: list[tuple[float, Callable[[float], None]]] = []
        self._pushing = False
        self._resume: Callable[[float], None] | None = None
        """Go on with what a load has stopped."""
        self._error = 0

    def reset(self, now: float, enabled: bool) -> None:
        """Forget all but the settings; count from zero where the shaft is."""
        self.motor.halt(now)
        self._events.clear()
        self.zero = self.motor.position(now)
        self.current = int(self.settings[r.CURRENT.address])
        self.enabled = enabled
        self.stalled = self.protected = self.has_moved = self._pushing = False
        self.activity = None
        self.homed = (Homed.NOT_DONE, Homed.NOT_DONE)
        self._error = 0

    # What one sees of it

    @property
    def mode(self) -> WorkMode:
        return WorkMode(self.settings[r.WORK_MODE.address])

    def counts(self, now: float) -> int:
        """What 0x31 reads."""
        counts = round((self.motor.position(now) - self.zero) * r.COUNTS_PER_TURN)
        return counts if self.motor.moving(now) else counts + self._error

    def angle_error(self, now: float) -> float:
        """What 0x39 reads, in degrees."""
        return 0.0 if self.motor.moving(now) else self._error * 360 / r.COUNTS_PER_TURN

    def pulses(self, now: float) -> int:
        """What 0x33 reads, before it is cut to 32 bits."""
        return round((self.motor.position(now) - self.zero) / self.turns(1))

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
        high = self.settings[r.HOMING.address][0] is Level.HIGH
        position = self.motor.position(now)
        seen = Inputs(0)
        if self.at_home(position) == high:
            seen |= Inputs.IN_1
        if self._has_right and self.at_right(position) == high:
            seen |= Inputs.IN_2
        return seen

    def turns(self, pulses: int) -> float:
        """How far so many pulses go."""
        return pulses / (r.STEPS_PER_TURN * float(self.settings[r.MICROSTEPS.address]))

    def rpm(self, speed: int) -> float:
        """The rpm that a speed value makes (7.1): it is calibrated for 16, 32 and 64 microsteps."""
        microsteps = self.settings[r.MICROSTEPS.address]
        rpm = float(speed) if microsteps in (16, 32, 64) else speed * 16 / microsteps
        return min(rpm, float(self.mode.max_rpm))

    # Switches

    @property
    def _remapped(self) -> bool:
        return bool(self.settings[r.LIMIT_REMAP.address])

    @property
    def _has_right(self) -> bool:
        return self.model.has_outputs or self._remapped  # 1.2: only the 57D has IN_2

    def at_home(self, position: float) -> bool:
        """Whether the drive sees the origin switch closed."""
        return self._remapped == self.machine.remapped and self.machine.at_home(position)

    def at_right(self, position: float) -> bool:
        """Whether the drive sees the right limit switch closed."""
        return self._has_right and self._remapped == self.machine.remapped and self.machine.at_right(position)

    # Time

    def advance(self, last: float, now: float, starves_at: float, starved: Callable[[float], None]) -> None:
        """Let everything happen until now, each at its time: what was planned, collisions, a starved watchdog."""
        if not self._events and self.motor.rests(last):
            return
        while True:
            due = min(self._events, key=lambda event: event[0], default=None)
            starves = max(last, starves_at) if self.motor.moving(last) else FOREVER
            turns = self.motor.next_change(last)
            when = min(now, starves, turns, due[0] if due else FOREVER)
            self._collide(last, when)
            last = when
            if due is not None and due[0] <= when and due in self._events:
                self._events.remove(due)
                due[1](due[0])
            elif starves <= when:
                starved(starves)
            elif when == now:
                return

    @property
    def planned(self) -> bool:
        """Whether something is to happen later."""
        return bool(self._events)

    def later(self, delay: float, now: float, happen: Callable[[float], None]) -> None:
        """Plan something; a stop, and the next command, forget it."""
        self._events.append((now + delay, happen))

    # How it moves

    def start(self, now: float, begin: Callable[[float], None]) -> None:
        """Set it in motion."""
        self._events.clear()
        self._pushing = False
        self.moves += 1
        self.has_moved = True
        self._error = self.machine.following_error
        self._resume = begin
        if self.machine.load > self._force:
            self._stall(now)
        elif self.motor.moving(now) or not self.machine.start_delay:
            begin(now)
        else:
            self.later(self.machine.start_delay, now, begin)

    def stop(self, ramp: float, now: float) -> None:
        """Slow down with a ramp in rpm/s, or at once."""
        self._events.clear()
        self._pushing = False
        if self.activity is Status.HOMING:
            self._homing_failed()
        self.activity = None
        if ramp < FOREVER:
            self.motor.run(0, ramp, now)
        else:
            self.motor.halt(now)

    def stop_command(self, ramp: float, now: float) -> None:
        """A command with speed 0. Raises `Refused` where nothing moves, as 9.1.3 and 9.3.3 log it."""
        if not self.motor.moving(now) and not self._events and not self._pushing:
            raise Refused
        self.stop(ramp, now)

    def enable(self, on: bool, now: float) -> None:
        """0xF3."""
        if not self.mode.is_serial or (on and self.protected):
            raise Refused
        if not on:
            self.stop(FOREVER, now)
        self.enabled = on

    def release_stall(self) -> None:
        """0x3D."""
        self.enabled = self.enabled or self.protected
        self.stalled = self.protected = self._pushing = False

    @property
    def limited(self) -> bool:
        """Whether the limit switches count (5.3.2)."""
        return bool(self.settings[r.HOMING.address][3])

    def protect(self, now: float) -> None:
        """A protection lets go of the shaft."""
        self.stop(FOREVER, now)
        self.stalled = True
        self._protect()

    def put_load(self, load: int, now: float) -> None:
        """The machine takes so much current, in mA, to move from now on."""
        self.machine.load = load
        if load > self._force and self.motor.moving(now):
            self.motor.halt(now)
            self._events.clear()
            self._stall(now)
        elif load <= self._force and self._pushing and self._resume is not None:
            self._pushing = False
            self._resume(now)

    @property
    def _force(self) -> int:
        return self.current

    def _stall(self, now: float) -> None:
        self.stalled = True
        _, guarded, seconds, _ = self.settings[r.POSITION_PROTECTION.address]
        if self.activity is Status.HOMING:
            self.activity = None
            self._homing_failed()
        elif not self.settings[r.STALL_PROTECTION.address]:
            self._pushing = True
            if guarded:
                self.later(seconds, now, lambda _: self._protect())
        if self.settings[r.STALL_PROTECTION.address]:
            self._protect()

    def _protect(self) -> None:
        """Let go of the shaft (3.4)."""
        self.protected = True
        self.enabled = self._pushing = False

    def _homing_failed(self) -> None:
        single, origin = self.homed
        under_way = Homed.UNDER_WAY
        self.homed = (
            Homed.NOT_DONE if single is under_way else single,
            Homed.NOT_DONE if origin is under_way else origin,
        )

    def _collide(self, last: float, now: float) -> None:
        """The shaft goes no further than the mechanical stops nor, with limits on, than the switches."""
        way = self.motor.position(now) - self.motor.position(last)
        if way == 0 or not self._is_out(self.motor.position(now), way):
            return
        early, late = last, now
        for _ in range(40):
            middle = (early + late) / 2
            early, late = (early, middle) if self._is_out(self.motor.position(middle), way) else (middle, late)
        low, high = self.machine.travel
        position = self.motor.position(late)
        self._events.clear()
        self.motor.place(min(max(position, low), high), late)
        if self._is_beyond(position):
            self._resume = None
            self._stall(late)

    def _is_beyond(self, position: float) -> bool:
        low, high = self.machine.travel
        return not low - _CONTACT <= position <= high + _CONTACT

    def _is_out(self, position: float, way: float) -> bool:
        """Whether it may not be there, going that way."""
        if self._is_beyond(position):
            return True
        if not self.limited or self.activity is not None:
            return False
        return (way < 0 and self.at_home(position)) or (way > 0 and self.at_right(position))
