"""What the inputs of a virtual TL-R drive do, and what its outputs tell. Source: TL-R manual, 2.2.2, 3.2, 3.3."""

from __future__ import annotations

import contextlib

from rs485bus.devices.tlr import registers as r
from rs485bus.devices.tlr.values import DiFunction, DoFunction, PathMode, PathTrigger, Ports, StatusWord
from rs485bus.sim.tlr_memory import Memory
from rs485bus.sim.tlr_motion import Denied, TlrMotion

_SELECT = (DiFunction.SELECT_0, DiFunction.SELECT_1, DiFunction.SELECT_2, DiFunction.SELECT_3)
_FORCED = {DoFunction.FORCED_1: 0, DoFunction.FORCED_2: 1, DoFunction.FORCED_3: 2}


class TlrInputs:
    """The five inputs and two outputs.

    Args:
        memory: what the drive is set to.
        motion: its motor.
    """

    def __init__(self, memory: Memory, motion: TlrMotion) -> None:
        self._memory = memory
        self._motion = motion
        self.contacts = Ports(0)
        """What somebody closes, beside the machine's switches."""
        self._active: frozenset[DiFunction] = frozenset()

    def states(self, now: float) -> Ports:
        """The inputs that are active: closed, or open where they are normally closed."""
        return (self.contacts | self._motion.closed(now)) ^ self._memory.get(r.INPUT_POLARITY)

    def outputs(self, now: float, enabled: bool) -> Ports:
        """The outputs that are on."""
        status = self._motion.status(now)
        tells = {
            DoFunction.ALARM: StatusWord.FAULT in status,
            DoFunction.RUNNING: StatusWord.RUNNING in status,
            DoFunction.HOMED: StatusWord.HOMED in status,
            DoFunction.IN_POSITION: StatusWord.IN_POSITION in status,
            DoFunction.BRAKE_RELEASE: enabled,
        }
        forced = self._memory.get(r.FORCED_OUTPUTS)
        on = Ports(0)
        for port, register in enumerate(r.OUTPUT_FUNCTIONS):
            function = self._memory.get(register)
            if tells.get(function, function in _FORCED and bool(forced & (1 << _FORCED[function]))):
                on |= Ports(1 << port)
        return on ^ self._memory.get(r.OUTPUT_POLARITY)

    def power_on(self, now: float) -> None:
        """What is closed already triggers nothing."""
        self._active = self._motion.active = self._functions(now)

    def update(self, now: float) -> None:
        """Do what inputs want that have changed."""
        before, self._active = self._active, self._functions(now)
        self._motion.active = self._active
        for function in sorted(self._active - before):
            with contextlib.suppress(Denied):
                self._rise(function, now)
        for function in sorted(before - self._active):
            if function in (DiFunction.JOG_POSITIVE, DiFunction.JOG_NEGATIVE, DiFunction.SPEED_TRIGGER):
                self._motion.stop(now)
        self._motion.see_switch(now)

    def _functions(self, now: float) -> frozenset[DiFunction]:
        states = self.states(now)
        return frozenset(
            self._memory.get(register) for port, register in enumerate(r.INPUT_FUNCTIONS) if states & (1 << port)
        )

    def _rise(self, function: DiFunction, now: float) -> None:
        motion, memory = self._motion, self._memory
        if function in (DiFunction.RELEASE, DiFunction.EMERGENCY_STOP):
            motion.halt(now)
        elif function is DiFunction.STOP:
            motion.stop(now)
        elif function in (DiFunction.JOG_POSITIVE, DiFunction.JOG_NEGATIVE):
            speed, up, down = memory.block(r.JOG)
            motion.jog(abs(speed) if function is DiFunction.JOG_POSITIVE else -abs(speed), up, down, now=now)
        elif function is DiFunction.HOME:
            motion.home(now)
        elif function is DiFunction.POSITION_TRIGGER:
            target, speed, up, down = memory.block(r.POSITION_PATHS[self._selected()])
            motion.position(
                0,
                up,
                down,
                speed,
                target,
                relative=memory.get(r.PATH_MODE) is PathMode.RELATIVE,
                interrupt=memory.get(r.PATH_TRIGGER) is PathTrigger.INTERRUPT,
                now=now,
            )
        elif function is DiFunction.SPEED_TRIGGER:
            motion.jog(*memory.block(r.SPEED_PATHS[self._selected()]), now=now)

    def _selected(self) -> int:
        return sum(1 << bit for bit, function in enumerate(_SELECT) if function in self._active)
