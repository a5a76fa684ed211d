"""The invariants: what must hold of every run, whatever went wrong in it.

The oracle knows the true motion of the shafts, the record of the line and what the application was told (`Evidence`),
and nothing of how the package comes to say what it says: it imports neither bus/ nor motion/ nor devices/.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rs485bus.sim.campaigns.faults.evidence import NEVER, Call, Evidence, Shaft
from rs485bus.sim.campaigns.faults.reckoning import (
    STANDING,
    Leg,
    is_moving_verb,
    legs,
    next_wish,
    open_wishes,
    wishes_between,
)

GRACE = 0.02
"""Seconds in which a frame that was on the wire already is heard, and the motor starts."""
_ROLLS = 3.0
"""Seconds for which a shaft rolls on that its drive lets go of."""
STOP_TAKES = 3.0
"""Seconds within which a motor stands that nobody wants to turn any more: some lost frames, and the ramp."""
LOOKED_AT = 1.1
"""Seconds for which a motor that turns may be left alone: supervision stretched to 1 s at most, and one frame."""
TOLD_WITHIN = 3.0
"""Seconds within which the application is told what happened to a motor under way, its stop confirmed."""
PATIENCE = 40.0
"""Seconds by which a call may take longer than where nothing goes wrong: a lost port is waited for for 30."""
OURS = frozenset({"BusError", "ValueError", "TypeError", "CancelledError", "BaseExceptionGroup"})

Finding = str
Check = Callable[[Evidence], Iterator[Finding]]


@dataclass(frozen=True, slots=True)
class Invariant:
    """One thing that must hold."""

    name: str
    sentence: str
    check: Check


INVARIANTS: dict[str, Invariant] = {}


def _invariant(name: str, sentence: str) -> Callable[[Check], Check]:
    def add(check: Check) -> Check:
        INVARIANTS[name] = Invariant(name, sentence, check)
        return check

    return add


def judge(evidence: Evidence) -> list[tuple[str, Finding]]:
    """What was broken: the invariant's name, and what was seen."""
    return [(each.name, finding) for each in INVARIANTS.values() for finding in each.check(evidence)]


# What was said is so


@_invariant("stopped-is-still", "A motor that is said to have stopped stands until somebody asks for motion again.")
def _stopped(evidence: Evidence) -> Iterator[Finding]:
    for call in evidence.calls:
        if call.verb not in STANDING or call.end != "done" or not _says_all_stand(call):
            continue
        for shaft in _shafts(evidence, call):
            until = min(next_wish(evidence, shaft, call.begun), evidence.ended)
            if until <= call.ended or open_wishes(evidence, shaft, call.ended):
                continue
            for begin, end in shaft.motions():
                if begin < until and end > call.ended + 1e-6:
                    turned = shaft.at(min(end, until)).position - shaft.at(max(begin, call.ended)).position
                    yield f"{shaft.name} turns by {turned:+.4f} after {call} at {_time(evidence, call.ended)}"
                    break


@_invariant("done-is-there", "A move that is said to be done has brought the shaft where it was sent.")
def _there(evidence: Evidence) -> Iterator[Finding]:
    for shaft in evidence.shafts.values():
        for leg in legs(evidence, shaft):
            if leg.target is None or leg.call.end != "done":
                continue
            off = shaft.at(leg.call.ended).position - leg.target
            if abs(off) > leg.slack:
                yield f"{shaft.name} stands {off:+.4f} turns off where {leg.call} says it is"


@_invariant("positions-are-so", "A position that is told is where the shaft was while it was asked.")
def _positions(evidence: Evidence) -> Iterator[Finding]:
    for shaft in evidence.shafts.values():
        for leg in legs(evidence, shaft):
            if leg.told is None:
                continue
            seen = [sample.position for sample in shaft.between(leg.call.begun - GRACE, leg.call.ended)]
            if not min(seen) - shaft.slack <= leg.told <= max(seen) + shaft.slack:
                yield f"{leg.call} means {leg.told:.4f}, and {shaft.name} is at {seen[-1]:.4f}"


@_invariant("speed-is-so", "A run that is said to have its speed turns the shaft at that speed.")
def _speed(evidence: Evidence) -> Iterator[Finding]:
    for shaft in evidence.shafts.values():
        for call in evidence.calls:
            if (
                call.verb != "run"
                or shaft.name not in call.shafts
                or call.end != "done"
                or call.options.get("duration")
            ):
                continue
            asked, true = float(call.args[0]) * shaft.sign, shaft.at(call.ended).rpm  # type: ignore[arg-type]
            if abs(asked - true) > max(2.0, 0.05 * abs(asked)) and not shaft.heard_mishap(call.begun, call.ended + 0.1):
                yield f"{shaft.name} turns at {true:.1f} rpm when {call} is told"


@_invariant("provisioned-is-so", "A drive that is said to have a new address answers at that one.")
def _provisioned(evidence: Evidence) -> Iterator[Finding]:
    for call in evidence.calls:
        place = getattr(call.result, "place", None)
        if not getattr(call.result, "confirmed", False) or place is None:
            continue
        seen = {
            [address for at, address in shaft.answers_at if at <= call.ended + GRACE][-1]
            for shaft in evidence.shafts.values()
        }
        if place.address not in seen:
            yield f"it answers at {', '.join(map(str, seen))}: {call}"


@_invariant("refused-is-nothing", "Where the application is told that nothing was done, nothing has moved.")
def _refused(evidence: Evidence) -> Iterator[Finding]:
    for call in evidence.calls:
        nothing = call.failed & {"NotSent", "DeviceRefused", "NotEnabled", "LimitExceeded", "NotSupported"}
        if not nothing or "MotionInterrupted" in call.failed or not is_moving_verb(call):
            continue
        for shaft in _shafts(evidence, call):
            if (
                open_wishes(evidence, shaft, call.begun, call)
                or shaft.turns_at(call.begun)
                or next_wish(evidence, shaft, call.begun, call) < call.ended
            ):
                continue
            way = shaft.at(call.ended).position - shaft.at(call.begun).position
            # A motion under way ends as not enabled, too, where its drive lets go.
            let_go = call.failed & {"NotEnabled"} and shaft.rolls(call.begun, call.ended)
            if abs(way) > 1e-6 and not let_go:
                yield f"{shaft.name} went {way:+.4f} turns: {call}"


# Nothing turns that nobody wants


@_invariant("nothing-older-after-a-stop", "After a stop nothing is set in motion by what was asked for before it.")
def _older(evidence: Evidence) -> Iterator[Finding]:
    for call in evidence.calls:
        if call.verb not in ("stop", "emergency_stop", "cancel"):
            continue
        for shaft in _shafts(evidence, call):
            until = next_wish(evidence, shaft, call.begun)
            for start in shaft.starts:
                if call.begun + GRACE < start < until:
                    yield f"{shaft.name} is set in motion {1000 * (start - call.begun):.0f} ms after {call}"
                    break


@_invariant("motion-is-asked-for", "A drive is set in motion only while a call that asks for it is open.")
def _asked_for(evidence: Evidence) -> Iterator[Finding]:
    for shaft in evidence.shafts.values():
        for start in shaft.starts:
            if not wishes_between(evidence, shaft, start - GRACE, start):
                yield f"{shaft.name} is set in motion at {_time(evidence, start)}, and nobody asked for that"
                break


@_invariant("never-further-than-asked", "A move never takes the shaft beyond where it began and where it is to end.")
def _hull(evidence: Evidence) -> Iterator[Finding]:
    for shaft in evidence.shafts.values():
        for leg in legs(evidence, shaft):
            began = leg.begun < leg.call.ended
            if not began or leg.target is None or leg.start is None or leg.call.verb not in ("move_to", "move_by"):
                continue
            if shaft.rolls(leg.begun, leg.until):
                continue
            low, high = sorted((leg.start, leg.target))
            for sample in shaft.between(leg.begun, min(leg.until, evidence.ended)):
                if not low - leg.slack <= sample.position <= high + leg.slack:
                    yield (
                        f"{shaft.name} comes to {sample.position:.4f} at {_time(evidence, sample.at)}, which is beyond "
                        f"{low:.4f}..{high:.4f}: {leg.call}"
                    )
                    break


@_invariant("failure-leaves-nothing-turning", "A motor whose command has failed stands soon after that was told.")
def _failure(evidence: Evidence) -> Iterator[Finding]:
    for call in evidence.calls:
        if call.error is None or not is_moving_verb(call) or "StopUnconfirmed" in call.failed:
            continue
        for shaft in _shafts(evidence, call):
            until = min(next_wish(evidence, shaft, call.ended), evidence.ended)
            if open_wishes(evidence, shaft, call.ended, call) or _told_running(evidence, call, shaft):
                continue
            for begin, end in shaft.motions():
                begin, end = max(begin, call.ended), min(end, until)
                late = end - begin - _unreachable(evidence, shaft, begin, end)
                if late > STOP_TAKES:
                    yield f"{shaft.name} turns for {late:.1f} s after {call}"
                    break


@_invariant(
    "closed-is-still", "When the application has left the bus every motor stands, or it was told which does not."
)
def _closed(evidence: Evidence) -> Iterator[Finding]:
    if evidence.closed_at == NEVER or evidence.left_running:
        return
    for shaft in evidence.shafts.values():
        told = "NOT CONFIRMED STANDING" in evidence.loudest or _unreachable(
            evidence, shaft, evidence.closed_at - 1.0, evidence.closed_at
        )
        if not told and any(end > evidence.closed_at + 1e-6 for _, end in shaft.motions()):
            yield f"{shaft.name} turns at {shaft.at(evidence.closed_at).rpm:.0f} rpm when the bus is closed"


@_invariant("turning-is-watched", "A motor that turns is asked about at least once a second.")
def _watched(evidence: Evidence) -> Iterator[Finding]:
    for shaft in evidence.shafts.values():
        asked = [frame.at for frame in evidence.frames if frame.address == shaft.address]
        for begin, end in shaft.motions():
            times = [begin, *(at for at in asked if begin < at < end), min(end, evidence.closed_at)]
            for early, late in itertools.pairwise(times):
                alone = late - early - _unreachable(evidence, shaft, early, late) - evidence.blocked(early, late)
                if alone > LOOKED_AT:
                    yield f"{shaft.name} turns at {_time(evidence, early)}, and nobody asks about it for {alone:.2f} s"
                    break


@_invariant("within-limits", "A shaft does not leave the limits that the application has set.")
def _limits(evidence: Evidence) -> Iterator[Finding]:
    for shaft in evidence.shafts.values():
        if shaft.limits is None:
            continue
        low, high = shaft.limits
        for sample in shaft.samples:
            outside = not low - shaft.slack <= sample.position <= high + shaft.slack
            if outside and not shaft.rolls(sample.at - _ROLLS, sample.at):
                yield f"{shaft.name} is at {sample.position:.4f} at {_time(evidence, sample.at)}, outside {low}..{high}"
                break


# Everything is told, and in time


@_invariant("everything-ends", "Every call ends, and in bounded time.")
def _ends(evidence: Evidence) -> Iterator[Finding]:
    if evidence.spun:
        yield "it goes round in a circle without any time passing"
    for call in evidence.calls:
        took = min(call.ended, evidence.ended) - call.begun
        if call.ended == NEVER:
            yield f"{call}, after {took:.1f} s"
        elif took > evidence.usual.get(call.verb, 0.0) + PATIENCE:
            yield f"{call} took {took:.1f} s"


@_invariant("mishaps-are-told", "What happens to a drive under way ends its command with an error, and soon.")
def _mishaps(evidence: Evidence) -> Iterator[Finding]:
    for shaft in evidence.shafts.values():
        for mishap in shaft.mishaps:
            for call in open_wishes(evidence, shaft, mishap.at):
                if not shaft.turns_at(mishap.at - 0.002) or call.verb not in ("move_to", "move_by", "run"):
                    continue
                left = mishap.at + TOLD_WITHIN
                late = call.ended - left - _unreachable(evidence, shaft, mishap.at, min(call.ended, evidence.ended))
                if call.ended > left and late > 0:
                    when = _time(evidence, mishap.at)
                    yield f"a {mishap.what} of {shaft.name} at {when} is told {late:.1f} s too late: {call}"


@_invariant("errors-are-ours", "What is raised is one of the documented errors, and nothing fails unheard.")
def _errors(evidence: Evidence) -> Iterator[Finding]:
    for call in evidence.calls:
        if call.error is not None and not call.failed & OURS:
            yield f"{type(call.error).__name__} raised: {call}"
    yield from evidence.unhandled


@_invariant("the-others-stand", "Where one of several that move together fails, the others stand soon, too.")
def _others(evidence: Evidence) -> Iterator[Finding]:
    for call in evidence.calls:
        if not is_moving_verb(call) or not call.failed or call.failed & {"MoveCancelled", "CancelledError"}:
            continue
        for name in {each for shaft in _shafts(evidence, call) for each in shaft.together}:
            other = evidence.shafts[name]
            until = min(next_wish(evidence, other, call.ended), evidence.ended)
            stands_by = call.ended + STOP_TAKES
            if stands_by + _unreachable(evidence, other, call.ended, until) < until and any(
                begin < call.ended and end > stands_by + _unreachable(evidence, other, call.ended, end)
                for begin, end in other.motions()
            ):
                yield f"{name} still turns at {_time(evidence, stands_by)}, after {call}"


# The line and the watchdogs


@_invariant("silence-is-kept", "No frame starts before t3.5 of silence.")
def _silence(evidence: Evidence) -> Iterator[Finding]:
    if evidence.early_frames:
        yield f"{evidence.early_frames} frames started too early"


@_invariant(
    "watchdogs-are-left-as-found", "In the end a watchdog is set as in the beginning, or it guards a motor that stands."
)
def _watchdogs(evidence: Evidence) -> Iterator[Finding]:
    if evidence.left_running:
        return
    for address, (before, after) in evidence.armed.items():
        shafts = [shaft for shaft in evidence.shafts.values() if shaft.address == address]
        mishap = any(shaft.mishaps or shaft.deaf for shaft in shafts) or bool(evidence.away)
        told = any("watchdog" in call.verb and call.error is not None for call in evidence.calls)
        if after != before and not (after and (mishap or told)):
            yield f"the watchdog of drive {address} is left at {after} ms, and was at {before} ms"
        if after and any(shaft.samples[-1].rpm for shaft in shafts):
            yield f"drive {address} turns in the end with a watchdog of {after} ms that nobody feeds"


@_invariant("the-guarded-are-fed", "A guarded drive that can be reached does not trip.")
def _fed(evidence: Evidence) -> Iterator[Finding]:
    for shaft in evidence.shafts.values():
        for trip in shaft.trips:
            made = any(mishap.what == "trip" and mishap.at == trip for mishap in shaft.mishaps)
            excused = _unreachable(evidence, shaft, trip - 2.0, trip) or evidence.blocked(trip - 2.0, trip)
            if not made and not excused and trip < evidence.leaving_at:
                yield f"{shaft.name} trips at {_time(evidence, trip)}"


# The best true end


@_invariant("best-true-end", "What one lost frame cannot spoil ends as if nothing had been lost.")
def _best(evidence: Evidence) -> Iterator[Finding]:
    if evidence.expected is None:
        return
    unknown = any(call.verb in evidence.may_differ and call.error is not None for call in evidence.calls)
    for who in dict.fromkeys(who for who, _, _ in evidence.expected if not unknown):
        expected = [(verb, end) for one, verb, end in evidence.expected if one == who]
        calls = [call for call in evidence.calls if call.who == who and not call.aside]
        for call, (verb, end) in zip(calls, expected, strict=False):
            if (call.verb, call.end) != (verb, end) and end == "done":
                yield f"{call}, where {verb} would have ended {end}"
                break
        else:
            if len(calls) < len(expected):
                yield f"{who} did not come to {expected[len(calls)][0]}"


# Inside


def _shafts(evidence: Evidence, call: Call) -> list[Shaft]:
    return [evidence.shafts[name] for name in call.shafts]


def _says_all_stand(call: Call) -> bool:
    """Of an emergency stop of the bus, what its report says."""
    return bool(getattr(call.result, "all_standing", True))


def _told_running(evidence: Evidence, call: Call, shaft: Shaft) -> bool:
    """Whether the motor turns by an older call that ended well: a run, which the failed one did not replace."""
    before = [
        other
        for other in evidence.calls
        if shaft.name in other.shafts and other.begun < call.begun and (is_moving_verb(other) or other.verb in STANDING)
    ]
    nothing_done = call.failed & {"LimitExceeded", "TypeError", "ValueError", "NotSupported"}
    return bool(nothing_done and before and before[-1].verb in ("run", "torque", "drive") and before[-1].end == "done")


def _unreachable(evidence: Evidence, shaft: Shaft, begin: float, end: float) -> float:
    """Seconds in which nobody could tell its drive anything."""
    away = sum(max(0.0, min(end, until) - max(begin, since)) for since, until in evidence.away)
    return shaft.deaf_for(begin, end) + away


def _time(evidence: Evidence, at: float) -> str:
    return f"{at - evidence.begun:.3f} s"


__all__ = ["INVARIANTS", "Invariant", "Leg", "judge"]
