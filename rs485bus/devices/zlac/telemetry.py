"""What a drive reports of its wheels, of one moment, and what that tells of each as an axis. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.memory import decode
from rs485bus.devices.zlac.values import Fault, ShaftState, Side
from rs485bus.motion.state import Fact

STILL_RPM = 1.0
"""Up to here a wheel that is held in place may seem to turn."""


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


def snapshot(words: Mapping[int, int], at: float) -> Snapshot:
    """The wheels in registers that were read together, `registers.STATE` among them, asked for at a time."""
    first = r.STATE.address
    data = b"".join(words[first + place].to_bytes(2, "big") for place in range(r.STATE.count))
    status, *pairs = r.STATE.decode(data)
    hall, temperature, faults, position, rpm, torque = (tuple(pairs[n : n + 2]) for n in range(0, 12, 2))
    left, right = (WheelMotion(position[n], round(rpm[n], 1), torque[n]) for n in range(len(Side)))
    return Snapshot(at, StatusWord(status), hall, temperature, faults, (left, right))


def tell(words: Mapping[int, int]) -> tuple[dict[Fact, Any], dict[Fact, Any]]:
    """What registers tell of the left and the right wheel: as many of them as were read, by whomever."""
    status, mode = decode(r.STATUS, words), decode(r.MODE, words)
    word = None if status is None else StatusWord(status)
    left, right = (_tell_of(side, words, word) for side in Side)
    faults = decode(r.ERRORS.left, words), decode(r.ERRORS.right, words)
    for told in (left, right):
        if mode is not None:
            told[Fact.MARK] = mode
        if faults[0] is not None and faults[1] is not None:
            # A fault of one wheel is a fault of both: both stop.
            told[Fact.FAULT] = describe((faults[0], faults[1])) or ("an alarm" if _alarms(word) else "")
        elif _alarms(word):
            told[Fact.FAULT] = "an alarm"
    return left, right


def describe(faults: tuple[Fault, Fault]) -> str:
    """The errors of the left and the right wheel, in words; empty if there are none."""
    return "; ".join(
        f"{side.name.lower()} {fault.describe()}" for side, fault in zip(Side, faults, strict=True) if fault
    )


def _alarms(word: StatusWord | None) -> bool:
    return word is not None and word.either(ShaftState.ALARM)


def _tell_of(side: Side, words: Mapping[int, int], word: StatusWord | None) -> dict[Fact, Any]:
    told: dict[Fact, Any] = {}
    position, rpm = decode(r.POSITION.of(side), words), decode(r.VELOCITY.of(side), words)
    if position is not None:
        told[Fact.POSITION] = position
    if rpm is not None:
        told[Fact.SPEED] = round(rpm, 1)
    if word is not None:
        told[Fact.ENABLED] = word.enabled
        # Which half is whose is disputed: one run bit alone may be the other wheel's.
        turns = (word.low.running and word.high.running) or (rpm is not None and abs(rpm) > STILL_RPM)
        told[Fact.RUNNING] = False if not word.running else (True if turns else None)
    return told


def turned(before: int, after: int) -> int:
    """How many counts lie between two positions of a counter of 32 bits, the shorter way round."""
    return (after - before + 0x8000_0000) % 0x1_0000_0000 - 0x8000_0000
