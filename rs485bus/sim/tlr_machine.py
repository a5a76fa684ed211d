"""What hangs on a virtual TL-R drive: its DIP switches, and the machine on its shaft and inputs."""

from __future__ import annotations

import math
from dataclasses import dataclass

FOREVER = math.inf


@dataclass(frozen=True, slots=True)
class Dip:
    """The six DIP switches (TL-R manual, 2.2.4)."""

    station: int
    """SW1 to SW4, the first counting 1 and the last 8. 0: all are off, and PA_020 holds the station."""
    custom_baudrate: bool = False
    """SW5. Off: 115200; on: PA_028 holds the baud rate."""
    terminated: bool = False
    """SW6: 120 ohms between the wires."""

    def __post_init__(self) -> None:
        if not 0 <= self.station <= 15:
            raise ValueError(f"station {self.station} is outside 0..15, which four switches can be set to")


@dataclass(slots=True)
class TlrMachine:
    """What the shaft drives. Positions are turns of the machine.

    The switches close the inputs to which the drive's own settings assign them (3.4.3), until those are changed.
    """

    origin: tuple[float, float] | None = (-2.0, -1.9)
    """From where to where the origin switch, on DI0, is closed; None for no switch."""
    limits: tuple[float, float] = (-FOREVER, FOREVER)
    """The negative limit switch, on DI2, is closed up to the first, the positive one, on DI1, from the second on."""
    travel: tuple[float, float] = (-FOREVER, FOREVER)
    """The mechanical stops. Against them a closed loop raises an alarm, and an open one loses steps."""
    start_delay: float = 0.005
    """Seconds between a command and the start."""
    homing_pause: float = 0.05
    """Seconds for which it stands where homing turns round."""
    stays_homed: bool = False
    """While it homes again the drive goes on saying that it is homed."""
    following_error: int = 0
    """Pulses by which a closed loop stands off its target."""

    def closed(self, shaft: float) -> tuple[bool, bool, bool]:
        """The switches on DI0, DI1 and DI2."""
        origin = self.origin is not None and self.origin[0] <= shaft <= self.origin[1]
        return origin, shaft >= self.limits[1], shaft <= self.limits[0]

    def places(self) -> list[float]:
        """Where something happens."""
        return [place for place in (*(self.origin or ()), *self.limits, *self.travel) if math.isfinite(place)]
