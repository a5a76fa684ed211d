"""What the axes on a pair did and were told, as far as its frames tell. Pure.

Positions are turns of the motor, speeds rpm, both in the drive's own direction. Where a drive's resolution was not on
the pair, the one it is shipped with is taken; the trace says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from rs485bus.bus.capture_lines import Exchange
from rs485bus.capture.explanation import values_of
from rs485bus.capture.pdu import spoken
from rs485bus.capture.reading import Capture
from rs485bus.capture.vocabulary import Value
from rs485bus.devices.mks import registers as mks
from rs485bus.devices.mks.values import MotionDirection
from rs485bus.devices.tlr import registers as tlr
from rs485bus.devices.zlac import registers as zlac
from rs485bus.devices.zlac.values import Side

_MICROSTEPS: Final = 16
_SUBDIVISION: Final = 4000
_LINES: Final = 1024
_PULSES_PER_TURN: Final = 200
_JUMP: Final = 500
"""rpm by which one derived speed differs from both beside it where the position was set to zero, say."""


class Point(NamedTuple):
    """A value at a time, in seconds since the capture began."""

    at: float
    value: float


@dataclass(slots=True)
class Trace:
    """One axis."""

    name: str
    address: int
    positions: list[Point] = field(default_factory=list)
    """Turns."""
    speeds: list[Point] = field(default_factory=list)
    """rpm."""
    targets: list[Point] = field(default_factory=list)
    """Positions it was sent to, in turns."""
    set_points: list[Point] = field(default_factory=list)
    """Speeds it was told, in rpm."""
    assumed: str = ""
    """What was taken for granted of its resolution."""

    def between(self, begin: float, end: float) -> Trace:
        """The part between two times."""

        def some(points: list[Point]) -> list[Point]:
            return [point for point in points if begin <= point.at <= end]

        return Trace(
            self.name,
            self.address,
            some(self.positions),
            some(self.speeds),
            some(self.targets),
            some(self.set_points),
            self.assumed,
        )

    @property
    def measured_speeds(self) -> list[Point]:
        """Its speeds; where the drive was hardly asked for them, by how much the position changed."""
        if 2 * len(self.speeds) >= len(self.positions):
            return self.speeds
        pairs = zip(self.positions, self.positions[1:], strict=False)
        derived = [
            Point((before.at + after.at) / 2, 60 * (after.value - before.value) / (after.at - before.at))
            for before, after in pairs
            if after.at > before.at
        ]
        return [point for at, point in enumerate(derived) if not _is_jump(derived, at)]

    def __bool__(self) -> bool:
        return bool(self.positions or self.speeds or self.targets or self.set_points)


def traces(capture: Capture) -> list[Trace]:
    """The axes of the drives whose families are known."""
    found: list[Trace] = []
    for address, family in sorted(capture.families.items()):
        make = _FAMILIES.get(family)
        if make is not None:
            exchanges = [each for each in capture.exchanges if each.address == address]
            found += make(address, [(each, _named(values_of(each, family))) for each in exchanges])
    return [trace for trace in found if trace]


def _is_jump(speeds: list[Point], at: int) -> bool:
    beside = [*speeds[max(0, at - 1) : at], *speeds[at + 1 : at + 2]]
    return bool(beside) and all(abs(speeds[at].value - other.value) > _JUMP for other in beside)


Told = list[tuple[Exchange, dict[str, Any]]]
"""The exchanges with one drive, each with what it read or wrote, by name."""


def _mks(address: int, told: Told) -> Iterable[Trace]:
    trace = Trace(f"MKS {address}", address)
    microsteps = _first(told, mks.MICROSTEPS.name)
    pulses = _PULSES_PER_TURN * (microsteps or _MICROSTEPS)
    for exchange, values in told:
        register = spoken(exchange.request).register
        if not values:
            continue
        if spoken(exchange.request).verb == "read":
            _add(trace.positions, exchange, values, mks.POSITION.name, 1 / mks.COUNTS_PER_TURN)
            _add(trace.speeds, exchange, values, mks.SPEED.name, 1)
        elif register == mks.MOVE_TO_COUNTS.address and values.get("speed"):
            _add(trace.targets, exchange, values, "position", 1 / mks.COUNTS_PER_TURN)
        elif register == mks.MOVE_TO_PULSES.address and values.get("speed"):
            _add(trace.targets, exchange, values, "pulses", 1 / pulses)
            trace.assumed = "" if microsteps else f"{_MICROSTEPS} microsteps taken"
        elif register == mks.RUN.address:
            sign = 1 if values.get("direction") is MotionDirection.CCW else -1
            _add(trace.set_points, exchange, values, "speed", sign)
    yield trace


def _zlac(address: int, told: Told) -> Iterable[Trace]:
    resolution = _first(told, zlac.SPEED_RESOLUTION.name) or 1
    for side, name in ((Side.LEFT, "left"), (Side.RIGHT, "right")):
        trace = Trace(f"ZLAC {address} {name}", address)
        lines = _first(told, zlac.ENCODER_LINES.of(side).name)
        turn = 1 / (zlac.COUNTS_PER_LINE * (lines or _LINES))
        trace.assumed = "" if lines else f"{_LINES} encoder lines taken"
        for exchange, values in told:
            _add(trace.positions, exchange, values, zlac.POSITION.of(side).name, turn)
            _add(trace.speeds, exchange, values, zlac.VELOCITY.of(side).name, 1)
            if spoken(exchange.request).verb == "write":
                _add(trace.set_points, exchange, values, zlac.TARGET_VELOCITY.of(side).name, 1 / resolution)
                _add(trace.targets, exchange, values, zlac.TARGET_POSITION.of(side).name, turn)
        yield trace


def _tlr(address: int, told: Told) -> Iterable[Trace]:
    trace = Trace(f"TL-R {address}", address)
    subdivision = _first(told, tlr.SUBDIVISION.name)
    turn = 1 / (subdivision or _SUBDIVISION)
    trace.assumed = "" if subdivision else f"{_SUBDIVISION} pulses a turn taken"
    for exchange, values in told:
        asked = spoken(exchange.request)
        if asked.verb == "read" and asked.register <= tlr.SPEED.address:
            _add(trace.positions, exchange, values, tlr.POSITION.name, turn)
            _add(trace.speeds, exchange, values, tlr.SPEED.name, 1)
        elif asked.verb == "write":
            _add(trace.targets, exchange, values, tlr.TARGET.name, turn)
            _add(trace.set_points, exchange, values, tlr.JOG_SPEED.name, 1)
    yield trace


_FAMILIES: Final[dict[str, Callable[[int, Told], Iterable[Trace]]]] = {"MKS": _mks, "ZLAC": _zlac, "TL-R": _tlr}


def _named(values: list[Value]) -> dict[str, Any]:
    return {value.name: value.value for value in values if value.value is not None}


def _first(told: Told, name: str) -> Any:
    """The first value that a register is seen to have; None if it is not seen."""
    return next((values[name] for _, values in told if name in values), None)


def _add(points: list[Point], exchange: Exchange, values: dict[str, Any], name: str, scale: float) -> None:
    value = values.get(name)
    if isinstance(value, int | float) and not isinstance(value, bool):
        written = spoken(exchange.request).verb == "write"
        points.append(Point(exchange.at if written else exchange.ended, value * scale))
