"""What the shaft of a virtual MKS drive moves: its switches, its stops, its load."""

from __future__ import annotations

import math
from dataclasses import dataclass

_INFINITE = math.inf
_EDGE = 1e-9


@dataclass(slots=True)
class Machine:
    """What the shaft drives. Positions are turns of the machine; counter-clockwise is up."""

    home_switch: float | None = -2.0
    """The origin and left limit switch is closed from here down; None for no switch."""
    right_switch: float | None = None
    """The right limit switch is closed from here up; None for no switch."""
    remapped: bool = False
    """The switches are wired to En and Dir instead of IN_1 and IN_2 (1.2): the drive sees them when remapping is on."""
    travel: tuple[float, float] = (-_INFINITE, _INFINITE)
    """The mechanical stops."""
    load: int = 0
    """The current, in mA, that it takes to move it. A motor with less stalls. `SimMks.put_load` changes it at once."""
    start_delay: float = 0.005
    """Seconds between a command and the start."""
    following_error: int = 0
    """Counts by which the shaft stands off its target (9.4.3 and 9.4.4 log -1 and +1)."""

    def at_home(self, position: float) -> bool:
        """Whether the origin switch is closed."""
        return self.home_switch is not None and position <= self.home_switch + _EDGE

    def at_right(self, position: float) -> bool:
        """Whether the right limit switch is closed."""
        return self.right_switch is not None and position >= self.right_switch - _EDGE
