"""How a virtual TL-R drive finds its origin. Source: TL-R manual, 3.4.2."""

from __future__ import annotations

import enum
from collections.abc import Callable

from rs485bus.devices.tlr.values import DiFunction, HomingMode


class _Phase(enum.Enum):
    SEEK = enum.auto()
    """At homing speed to the switch; in mode 29 beyond it."""
    BACK = enum.auto()
    """At homing speed off it again."""
    CREEP = enum.auto()
    """At creep speed to its edge."""


class HomingRun:
    """One homing: told what the inputs do and when the motor stands, it says how to go on.

    Args:
        mode: any but `HERE`.
        active: whether the switch is, at the start.
        run: go at homing speed (or creep) in a direction.
        turn: slow down to a stand, then call `go_on`.
        found: this is the origin.
    """

    def __init__(
        self,
        mode: HomingMode,
        active: bool,
        run: Callable[[int, bool, float], None],
        turn: Callable[[float], None],
        found: Callable[[float], None],
    ) -> None:
        assert mode.needs is not None
        self.switch: DiFunction = mode.needs
        self._leaves = mode is HomingMode.NEGATIVE_ORIGIN
        self._way = -1 if mode in (HomingMode.NEGATIVE_LIMIT, HomingMode.NEGATIVE_ORIGIN) else 1
        self._run, self._turn, self._found = run, turn, found
        self._was_active = active
        self._turning = False
        self._next = _Phase.SEEK if not active or self._leaves else _Phase.BACK

    def go_on(self, now: float) -> None:
        """Begin the next phase."""
        self._phase, self._turning = self._next, False
        ahead = self._phase is _Phase.SEEK or (self._phase is _Phase.CREEP and not self._leaves)
        self._run(self._way if ahead else -self._way, self._phase is _Phase.CREEP, now)

    def see(self, active: bool, now: float) -> None:
        """The switch is active, or not, while the motor turns."""
        was, self._was_active = self._was_active, active
        if self._turning:
            return
        left = was and not active
        if self._phase is _Phase.CREEP:
            if active:
                self._found(now)
        elif left if (self._leaves or self._phase is _Phase.BACK) else active:
            self._next = _Phase.BACK if self._phase is _Phase.SEEK and not self._leaves else _Phase.CREEP
            self._turning = True
            self._turn(now)
