"""What the calls of an application ask of a shaft, one after the other: where it is to go, and from where.

Part of the oracle: it imports neither bus/ nor motion/ nor devices/.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rs485bus.sim.campaigns.faults.evidence import NEVER, Call, Evidence, Shaft

STANDING = frozenset({"stop", "emergency_stop", "disable", "release", "leave stream"})
"""Verbs after which the motor stands."""
_TO, _BY = "move_to", "move_by"
_FREE = frozenset({"run", "torque", "drive", "stream", "retarget"})
_COUNTED = frozenset({"move_by_counts", "move_by_pulses", "move_to_pulses"})
_COUNTS_PER_TURN = 16384
_SEEKING = frozenset({"home", "return_to_zero"})
MOVING = frozenset({_TO, _BY, *_FREE, *_COUNTED, *_SEEKING})
_NOTHING_QUEUED = frozenset({"LimitExceeded", "TypeError", "ValueError"})
_NOTHING_CHANGED = _NOTHING_QUEUED | {"NotSent", "DeviceRefused", "MotionError", "NoReply"}
_FORGETTING = frozenset({"restart", "factory_reset", "calibrate"})
_ZEROING = frozenset({"home", "set_zero"})


def is_moving_verb(call: Call) -> bool:
    """Whether it asks for motion."""
    return call.verb in MOVING


def next_wish(evidence: Evidence, shaft: Shaft, after: float, beside: Call | None = None) -> float:
    """When motion of a shaft is asked for next."""
    return min(
        (
            call.begun
            for call in evidence.calls
            if call.verb in MOVING and shaft.name in call.shafts and call.begun >= after and call is not beside
        ),
        default=NEVER,
    )


def open_wishes(evidence: Evidence, shaft: Shaft, at: float, beside: Call | None = None) -> list[Call]:
    """The calls that ask for motion of a shaft and are open then."""
    return [
        call
        for call in evidence.calls
        if call.verb in MOVING and shaft.name in call.shafts and call.begun <= at < call.ended and call is not beside
    ]


def wishes_between(evidence: Evidence, shaft: Shaft, begin: float, end: float) -> list[Call]:
    """The calls that ask for motion of a shaft and are open at some time between two."""
    return [
        call
        for call in evidence.calls
        if call.verb in MOVING and shaft.name in call.shafts and call.begun <= end and call.ended >= begin
    ]


@dataclass(frozen=True, slots=True)
class Leg:
    """What one call asks of a shaft."""

    call: Call
    begun: float
    """When it can have begun: when it was called, and the one before it had ended."""
    until: float
    """When the next one can have begun."""
    start: float | None
    """Where the shaft stood then; None if it did not stand."""
    target: float | None
    """Where it is to end; None where nobody can say."""
    told: float | None
    """What it says where the shaft is; None if it says nothing."""
    slack: float
    """By how much it may be off."""


def legs(evidence: Evidence, shaft: Shaft) -> Iterator[Leg]:
    """What is asked of a shaft, in order. Positions are turns of the shaft."""
    calls = [call for call in evidence.calls if shaft.name in call.shafts]
    moves = [call for call in calls if call.verb in MOVING]
    zero: float | None = shaft.samples[0].position
    base: float | None = shaft.samples[0].position
    zeroed_at, free = -NEVER, evidence.begun
    for call in calls:
        done = call.end == "done"
        if call.verb == "position":
            yield Leg(call, call.begun, call.ended, None, None, _told(call, calls, shaft, zero, zeroed_at), shaft.slack)
        elif call.verb in _FORGETTING:
            zero = base = None
        elif call.verb == "set_zero":
            zero = shaft.at(call.ended).position if done else None
            zeroed_at = call.ended
        elif call.verb in MOVING and call.verb != "retarget":
            last = _last_of(call, calls)
            begun = max(call.begun, free)
            later = min((other.begun for other in moves[moves.index(call) + 1 :]), default=NEVER)
            until = later if call.ended == NEVER else max(later, call.ended)
            start = shaft.at(begun).position if not shaft.turns_at(begun) and last is call else None
            target = _target(last, shaft, zero, start if base is None else base)
            yield Leg(call, begun, until, start, target, None, shaft.slack)
            base = target if done else None
            free = max(free, evidence.ended if call.ended == NEVER else call.ended)
            if call.verb == "home":
                zero, zeroed_at = (shaft.home_at(call.begun) if done else None), call.ended


def _last_of(call: Call, calls: list[Call]) -> Call:
    """The call that says where a move goes in the end: itself, or a retargeting while it was under way."""
    changes = [
        other
        for other in calls
        if other.verb == "retarget" and call.begun < other.begun < call.ended and not other.failed & _NOTHING_CHANGED
    ]
    return changes[-1] if changes and call.verb == _TO else call


def _told(call: Call, calls: list[Call], shaft: Shaft, zero: float | None, zeroed_at: float) -> float | None:
    """Where the answer to a question says that the shaft is; None where its zero is not known, or being found."""
    zeroing = any(other.verb in _ZEROING and other.begun <= call.ended and other.ended >= call.begun for other in calls)
    restarted = any(mishap.what == "restart" and zeroed_at <= mishap.at <= call.ended for mishap in shaft.mishaps)
    if call.end != "done" or call.result is None or zero is None or zeroing or restarted:
        return None  # after a restart it counts from somewhere else; a move would notice that
    return zero + shaft.sign * shaft.turns_per_unit * float(call.result)  # type: ignore[arg-type] # a position


def _target(call: Call, shaft: Shaft, zero: float | None, base: float | None) -> float | None:
    """Where a call is to take the shaft."""
    if call.failed & _NOTHING_QUEUED or (call.failed and call.ended == call.begun):
        return None  # it was refused as it was called
    if call.verb == "home":
        return shaft.home_at(call.begun)
    if call.verb == "return_to_zero":
        return zero
    if call.verb in _FREE - {"retarget"} or not call.args:
        return None
    way = shaft.sign * shaft.turns_per_unit * float(call.args[0])  # type: ignore[arg-type]
    if call.verb in _COUNTED:
        counts = _COUNTS_PER_TURN if call.verb == "move_by_counts" else shaft.pulses_per_turn
        way = shaft.sign * float(call.args[0]) / counts  # type: ignore[arg-type]
    if call.verb in (_TO, "retarget", "move_to_pulses"):
        return None if zero is None else zero + way
    return None if base is None else base + way
