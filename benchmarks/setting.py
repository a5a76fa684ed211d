"""One setting of the line, and what all clients are asked to do on it."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.wire.timing import LineSettings

READ_COUNT = 3
WRITE_COUNT = 4
ROUND = 4
"""Requests in a round: three reads of three registers, one write of four."""
MARK = 0x0F60
"""Writes to this register are told with the time at which they arrived: the stops."""

_READ = 8 + 5 + 2 * READ_COUNT
_WRITE = 9 + 2 * WRITE_COUNT + 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """How the line is set.

    Args:
        baudrate: bit/s; characters have ten bits.
        units: how many units are asked in turn, 1..31.
        turnaround: seconds a device takes before it starts to answer.
    """

    baudrate: int = 115200
    units: int = 8
    turnaround: float = 0.002

    @property
    def line(self) -> LineSettings:
        return LineSettings(baudrate=self.baudrate)

    @property
    def limit(self) -> float:
        """Requests a second that the wire allows: airtime, turnaround and t3.5 each, and nothing else."""
        line = self.line
        airtime = ((ROUND - 1) * line.airtime(_READ) + line.airtime(_WRITE)) / ROUND
        return 1 / (airtime + self.turnaround + line.t35)

    @property
    def read_time(self) -> float:
        """Seconds from the start of a read to the end of its reply."""
        return self.line.airtime(_READ) + self.turnaround


@dataclass(frozen=True, slots=True)
class Step:
    """One request of the workload."""

    unit: int
    writes: bool


def workload(units: int) -> list[Step]:
    """The requests of the workload, to be repeated: every unit is asked equally often, and so is each kind."""
    return [Step(1 + number % units, number % ROUND == ROUND - 1) for number in range(ROUND * units)]
