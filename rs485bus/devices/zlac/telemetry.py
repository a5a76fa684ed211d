"""What a drive reports of its wheels, of one moment; and how to tell from it whether a wheel stands. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.values import Fault, ShaftState, Side

_STILL_RPM = 1.0
"""Up to here a wheel that is held in place may seem to turn."""
_SAME = 2
"""Counts by which a standing wheel may seem to move."""
_RECENT, _OLD = 0.1, 2.0
"""Seconds within which a wheel that moved is taken to move still, and after which a position says nothing any more."""


@dataclass(frozen=True, slots=True)
class Half:
    """One half of the status word."""

    shaft: ShaftState
    running: bool


@dataclass(frozen=True, slots=True)
class StatusWord:
    """0x20A2. The manual gives bits 7, 6 and 0 to the left wheel and 15, 14 and 8 to the right one; users report it the
    other way round, as it is with Hall states and temperatures. What decides over safety asks both halves."""

    raw: int

    @property
    def low(self) -> Half:
        return self._half(self.raw & 0xFF)

    @property
    def high(self) -> Half:
        return self._half(self.raw >> 8)

    def of(self, side: Side, left: str) -> Half:
        """The half of a wheel, the left one's being the "low" or the "high" one."""
        return self.low if (side is Side.LEFT) == (left == "low") else self.high

    @property
    def enabled(self) -> bool:
        """Whether both wheels are held. The control word enables both at once."""
        return self.low.shaft is self.high.shaft is ShaftState.LOCKED

    @property
    def running(self) -> bool:
        """Whether either is said to run."""
        return self.low.running or self.high.running

    def either(self, shaft: ShaftState) -> bool:
        return shaft in (self.low.shaft, self.high.shaft)

    @staticmethod
    def _half(byte: int) -> Half:
        return Half(ShaftState(byte >> 6), bool(byte & 1))


@dataclass(frozen=True, slots=True)
class WheelMotion:
    """What one wheel does, in the drive's own terms."""

    position: int
    """Counts, -0x80000000..0x7FFFFFFF; beyond that it wraps."""
    rpm: float
    """In steps of 0.1 rpm. Some firmware reports it in velocity mode only."""
    torque: int
    """mA, in steps of 100."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Both wheels at one moment: the left one first."""

    at: float
    """When it was asked for, on the event loop's clock."""
    status: StatusWord
    hall: tuple[int, int]
    """1..6; 0 and 7 are faults."""
    temperature: tuple[int, int]
    """°C, of the motors."""
    faults: tuple[Fault, Fault]
    motion: tuple[WheelMotion, WheelMotion]


def motions(data: bytes) -> tuple[WheelMotion, WheelMotion]:
    """The wheels in the payload of a read of `registers.MOTION`: the left one first."""
    left, right, left_rpm, right_rpm, left_torque, right_torque = r.MOTION.decode(data)
    return (
        WheelMotion(left, round(left_rpm, 1), left_torque),
        WheelMotion(right, round(right_rpm, 1), right_torque),
    )


def snapshot(data: bytes, at: float) -> Snapshot:
    """The wheels in the payload of a read of `registers.STATE`, asked for at a time."""
    status, *bytes_and_faults = r.STATE.decode(data)[:7]
    hall, temperature, faults = (tuple(bytes_and_faults[n : n + 2]) for n in (0, 2, 4))
    motion = motions(data[-2 * r.MOTION.count :])
    return Snapshot(at, StatusWord(status), hall, temperature, faults, motion)


class Stillness:
    """Tells from what a wheel reports whether it stands.

    Neither speed nor run bits are trusted alone: some firmware reports a speed in velocity mode only, and a run bit may
    be the other wheel's. A position that stays is the truth, but takes time to see.

    Args:
        quiet: seconds for which the position must have stayed where nothing else says that the wheel runs.
        contradicted: the same where a run bit says so.
    """

    def __init__(self, quiet: float, contradicted: float) -> None:
        self._quiet = quiet
        self._contradicted = contradicted
        self._since = 0.0
        self._at = float("-inf")
        self._position = 0

    def see(self, at: float, wheel: WheelMotion, running: bool) -> bool | None:
        """Take in a report made at a time. True: it stands. False: it moves. None: that cannot be told yet."""
        moved = abs(turned(self._position, wheel.position)) > _SAME
        recent = at - self._at < _RECENT
        if moved or at - self._at > _OLD:
            self._since, self._position = at, wheel.position
        self._at = at
        if abs(wheel.rpm) > _STILL_RPM:
            return False
        if at - self._since >= (self._contradicted if running else self._quiet):
            return True
        return False if moved and recent else None


def turned(before: int, after: int) -> int:
    """How many counts lie between two positions of a counter of 32 bits, the shorter way round."""
    return (after - before + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000
