"""What a unit is asked instead of waiting for a reply that it owes. Pure.

Bytes of one unit come in the order in which it was asked. So an answer to something else, that cannot be taken for the
late reply, proves that the late reply will never come: one transaction instead of half a second.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from rs485bus.bus.schedule.job import Job, Urgency
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.wire.frames import Request

_RETRIES = 5
"""How often a question is repeated before others have their turn."""
_FIRST_PAUSE, _LONGEST_PAUSE, _DOUBLINGS = 0.006, 0.25, 8
"""Seconds for which a question is not repeated, twice as long each time: the unit may be busy."""
_GIVEN_UP = 4
"""Questions that count as unanswered where a whole request was: the unit is away or busy, and may answer each later."""


def question_for(unit: UnitState, now: float, is_in_the_way: Callable[[Request], bool]) -> Job | None:
    """A read for a unit that owes a reply: harmless, known to be answered, and not to be mistaken for what is owed.

    None if there is none, or if one is under way. The same question is one job as long as an answer to it is owed:
    either of its answers will do. But where another one is owed nothing, that is asked: answers to the same question
    that all look alike never show which of them it was. It may have to wait, lest a unit that does not answer takes the
    wire from others.

    Args:
        unit: the unit.
        now: the time.
        is_in_the_way: whether a question, while it is owed an answer, would keep waiting who waits for the unit.
    """
    if unit.is_questioned or unit.reach.offline or unit.halt is not None:
        return None  # one that is being stopped is asked anyway
    if unit.reach.silent and not (unit.reach.gave_up and unit.leaves_questions):
        return None  # where reads of it end unsent, nothing but these questions finds out that it is back
    last, reads = unit.question, [read for read in _harmless(unit) if not is_in_the_way(read)]
    fresh = next((request for request in reads if not unit.late.must_wait(request)), None)
    if fresh is None:
        asked = {owed.job.request.adu: owed.job for owed in unit.late if owed.job.backs_off}
        same = (asked[read.adu] for read in reads if read.adu in asked)
        job = next((job for job in same if not unit.late.must_wait(job.request, job)), None)
        if job is None:
            return None
        unit.question = _again(job, now)
    elif last is None or last.request.adu != fresh.adu:
        unit.question = _new(unit, fresh)
    else:
        unit.question = _again(last, now)
    if unit.reach.gave_up and unit.attached is None:
        unit.question.unanswered = max(unit.question.unanswered, _GIVEN_UP)
    unit.is_questioned = True
    return unit.question


def pause(job: Job) -> float:
    """Seconds for which a question is not repeated."""
    return float(min(_LONGEST_PAUSE, _FIRST_PAUSE * 2.0 ** min(job.unanswered, _DOUBLINGS)))


def hurry(unit: UnitState, now: float) -> None:
    """The unit gave a sign of life: it may be asked at once."""
    if unit.question is not None:
        unit.question.not_before = now
        unit.question.unanswered = 0


def _new(unit: UnitState, request: Request) -> Job:
    def ended(_: Job) -> None:
        unit.is_questioned = False

    return Job(request, urgency=Urgency.POLL, internal=True, retries=_RETRIES, backs_off=True, on_end=ended)


def _again(job: Job, now: float) -> Job:
    if job.reply:
        job.unanswered, job.not_before = 0, now
    else:
        job.not_before = max(job.not_before, job.ended_at + pause(job))
    job.outcome, job.reply, job.retries = None, b"", job.attempts + _RETRIES
    return job


def _harmless(unit: UnitState) -> Iterator[Request]:
    """The reads that the unit may be asked at any time."""
    if unit.probe is False or not unit.late.are_settled_by_answers:
        return
    if unit.probe is not None:
        yield unit.probe
    elif unit.attached is not None:
        yield from unit.reads()
    else:
        yield from unit.answers.shorter(unit.address)
