"""Why an axis does not do what it was told, from what its drive reports. Pure."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence

from rs485bus.errors import (
    BusError,
    DriveFault,
    LimitReached,
    MotionError,
    MotorStalled,
    MoveFailed,
    MoveTimeout,
    NotEnabled,
    ReferenceLost,
    StopUnconfirmed,
)
from rs485bus.motion.courses import Course, MoveCourse
from rs485bus.motion.drive import Drive
from rs485bus.motion.look_budget import SILENT
from rs485bus.motion.state import Fact

FOUND_OUT = 2 * SILENT
"""Intervals in which it must be found out. What the drive has not told by then is left out: it may never tell it."""
LOST = "home() it or set_zero() first."
UNSEEN = (
    "It was told to stop and could not be seen standing. Look at the machine; use the hard-wired emergency stop. It "
    "moves only after enable()."
)
_LATER = (Fact.RUNNING, Fact.POSITION, Fact.LIMIT)
"""What is asked after all others: most is decided without the last one, and then the position is new enough to see that
the axis stands."""


def in_order(facts: Iterable[Fact]) -> Sequence[Fact]:
    """The order in which to ask what is wrong with an axis."""
    return sorted(facts, key=lambda fact: _LATER.index(fact) if fact in _LATER else -1)


def is_decided(drive: Drive, axis: int, course: Course, since: float) -> bool:
    """Whether what was asked of an axis since a time shows what is wrong with it, whatever else may be asked. It is in
    the order of `diagnose`."""
    state = drive.state.axes[axis]

    def told(*facts: Fact) -> bool:
        return state.since(since, drive.tells(*facts))

    if not told(Fact.FAULT):
        return False
    if state.value(Fact.FAULT) or (told(Fact.STALLED) and state.value(Fact.STALLED)):
        return True
    is_off = state.value(Fact.ENABLED) is False or (state.lost and course.has_lost_reference)
    if is_off and told(Fact.STALLED, *drive.marks(axis)):
        return True
    return told(*drive.wanted(axis))


def suspect_restart(drive: Drive, axis: int, course: Course, cause: str) -> bool:
    """Whether an axis may have stopped because its drive has restarted; its positions are not trusted then.

    Nothing else explains it, as a `cause` does where its motor is held, and it is where one is that counts anew.
    """
    state = drive.state.axes[axis]
    is_off = state.value(Fact.ENABLED) is False
    told = any(state.value(fact) for fact in (Fact.FAULT, Fact.STALLED, Fact.LIMIT)) or drive.halted_by(axis)
    explained = told or (cause and not is_off) or state.stopped_at > state.obeyed_at or _misses_little(course)
    if explained or drive.tells_restarts or not state.may_count_anew:
        return False
    what = "its motor is not enabled any more, and nobody disabled it" if is_off else "nothing says why it stopped"
    state.suspect(f"{what}, and it is where one is that counts anew: the drive may have restarted.")
    return True


def diagnose(drive: Drive, axis: int, name: str, course: Course, cause: str = "") -> MotionError:
    """What is wrong with an axis, of which that is decided. `cause` is a sentence about what may have stopped it beside
    what the drive tells."""
    state = drive.state.axes[axis]
    place = f"{name} {course.place()}"
    fault = state.value(Fact.FAULT)
    if fault:
        return DriveFault(f"{place}: the drive reports {fault}. {drive.fault_remedy}".rstrip())
    if state.value(Fact.STALLED):
        return MotorStalled(f"{place}: the drive reports a stall. {drive.stall_remedy}")
    if state.lost and course.has_lost_reference:
        return ReferenceLost(f"{place}: {state.lost} {LOST}")
    if state.value(Fact.ENABLED) is False and (halted_by := drive.halted_by(axis)):
        return MoveFailed(f"{place}: {halted_by}")
    if state.value(Fact.ENABLED) is False:
        return NotEnabled(f"{place}: its motor is not enabled any more, and nobody disabled it. enable() it.")
    limit = state.value(Fact.LIMIT)
    if limit:
        at_zero = ", at zero" if abs(state.last(Fact.POSITION).value) <= state.jump else ""
        return LimitReached(f"{place}{at_zero}, {limit}. Move it off the limit the other way.")
    if state.stands is not False and not state.standstill.confirmed and state.value(Fact.RUNNING) is not False:
        return MotorStalled(
            f"{place}, and its drive says that it moves. Either something holds the shaft, or that status is stuck: "
            f"look at the machine. It was stopped, lest it goes on when what holds it lets go. {drive.stall_remedy}"
        )
    why = " ".join(filter(None, (drive.what_else(axis), cause, _maybe_restarted(drive, axis, course))))
    return MoveFailed(f"{place}{_near_miss(course)}. {why}".rstrip())


def _maybe_restarted(drive: Drive, axis: int, course: Course) -> str:
    """What to do where an axis is where one is whose drive counts anew, and something else may have stopped it."""
    state = drive.state.axes[axis]
    stopped = state.stopped_at > state.obeyed_at or _misses_little(course)
    if stopped or drive.tells_restarts or state.lost or not state.may_count_anew:
        return ""
    return (
        "Or its drive has restarted, and counts from zero here: where positions matter, home() it or set_zero() first."
    )


def is_stall_by_status(drive: Drive, axis: int, error: MotionError) -> bool:
    """Whether a shaft is taken for held only because a status says that the motor is driven, which may be stuck."""
    state = drive.state.axes[axis]
    return isinstance(error, MotorStalled) and bool(state.value(Fact.PUSHES)) and not state.value(Fact.STALLED)


def not_seen_standing(unconfirmed: StopUnconfirmed, error: BusError) -> MotionError:
    """What is wrong with an axis that was stopped because of an error, and was not seen standing: that error, where it
    says what is wrong with the axis."""
    if isinstance(error, MoveTimeout) or not isinstance(error, MotionError):
        return unconfirmed
    known = copy.copy(error)
    known.args = (f"{error} {unconfirmed}",)
    return known


def _near_miss(course: Course) -> str:
    """What to do where an axis stands but a little off its target."""
    if not isinstance(course, MoveCourse) or not _misses_little(course):
        return ""
    assert course.deviation is not None
    return (
        f", which is more than its tolerance of {course.tolerance}. Where a load holds it off, make the axis with a "
        f"greater one: tolerance={2 * course.deviation}"
    )


def _misses_little(course: Course) -> bool:
    """Whether it stands so near its target that it has gone there."""
    return isinstance(course, MoveCourse) and course.deviation is not None and course.deviation <= course.state.jump
