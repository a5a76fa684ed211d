"""What is asked next of a drive whose axes move, and when. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from rs485bus.errors import MotionError
from rs485bus.motion.courses import Course, Verdict
from rs485bus.motion.drive import Drive
from rs485bus.motion.events import Changes, EventKind
from rs485bus.motion.look_budget import LookBudget
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import AxisState, Fact

_FOREVER = float("inf")

Told = Callable[[Verdict, MotionError | None], None]
"""Called when a course has reached its speed, has ended, or failed of an error."""


@dataclass(slots=True)
class Watched:
    """One axis of a drive."""

    state: AxisState
    name: str
    on_trouble: Callable[[MotionError], None]
    tell: Callable[[EventKind, str], None]
    changes: Changes
    course: Course | None = None
    told: Told | None = None
    doubted_at: float | None = None
    """Since when it is being found out what is wrong."""
    lost: str = ""
    """Why its positions were not to be trusted when that was last looked at."""
    silent: bool = False
    """It was told that its drive does not answer."""
    starting: bool = False
    """Somebody is about to start or to stop it, and looks at it meanwhile."""


class Look(NamedTuple):
    """A look that is to be made."""

    when: float
    fact: Fact


class Looks:
    """What is to be asked of one drive.

    Args:
        drive: the drive.
        budget: how often the drives of its bus can be looked at.
        watched: its axes, by number.
    """

    def __init__(self, drive: Drive, budget: LookBudget, watched: Mapping[int, Watched]) -> None:
        self._drive = drive
        self._budget = budget
        self._watched = watched
        self.rotated_at = NEVER
        """When it was last asked something else than what tells soonest."""

    def next(self) -> tuple[Look, Look]:
        """What must be asked next, and what is asked beside that to see an end soon."""
        must = may = Look(_FOREVER, self._drive.telling[0])
        for axis, watched in self._watched.items():
            course = watched.course
            if course is None:
                continue
            interval, stop_at = self.interval(course), course.stop_at
            for fact in self._facts(axis, course):
                due = min(self._routine(fact, watched, course, interval), stop_at)
                if watched.doubted_at is not None and watched.state.known(fact).at < watched.doubted_at:
                    due = NEVER
                if due < must.when:
                    must = Look(due, fact)
                due = course.due(fact)
                if due < may.when:
                    may = Look(due, fact)
        return must, may

    def interval(self, *courses: Course) -> float:
        """Seconds between two telling looks; fewer where others depend on one of these courses, or of all."""
        all_courses = courses or tuple(each.course for each in self._watched.values() if each.course is not None)
        wanted = min((course.interval for course in all_courses), default=_FOREVER)
        return min(self._budget.interval, max(wanted, self._budget.shortest))

    def _facts(self, axis: int, course: Course) -> Iterable[Fact]:
        """What may be asked about an axis."""
        facts = (*self._drive.telling, *self._drive.wanted(axis), Fact.SPEED, *course.facts)
        return self._drive.tells(*dict.fromkeys(facts))

    def _routine(self, fact: Fact, watched: Watched, course: Course, interval: float) -> float:
        """When a fact is due because the axis moves."""
        at = watched.state.last(fact).at  # set-points take away what was known, again and again
        if fact in self._drive.telling:
            return max(at, course.started_at) + interval
        if fact in self._drive.rotation:
            oldest = max(at, course.started_at) + len(self._drive.rotation) * self._budget.interval
            return max(oldest, self.rotated_at + self._budget.rotation)
        return _FOREVER
