"""Looks at whatever may move, and tells at once what ends it.

From the first frame that may set an axis in motion until it was seen to stand it is looked at, whoever set it in motion
and whether anybody waits for it or not. Replies to others count: only what would be too old is asked for.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rs485bus.arguments import instance
from rs485bus.bus.bus import Bus
from rs485bus.bus.schedule.job import Job, Outcome, Urgency
from rs485bus.bus.units.loss import share_lost
from rs485bus.bus.units.unit_state import UnitState
from rs485bus.bus.watchdog.foreign import possible_cause
from rs485bus.errors import LimitReached, MotionError, MoveFailed, MoveTimeout, ReferenceLost
from rs485bus.motion.courses import Course, Verdict
from rs485bus.motion.diagnosis import FOUND_OUT, diagnose, in_order, is_decided, is_stall_by_status, suspect_restart
from rs485bus.motion.drive import Drive
from rs485bus.motion.events import Changes, EventKind
from rs485bus.motion.knowledge import Questions
from rs485bus.motion.look_budget import SHARE, SILENT, LookBudget, LookTime
from rs485bus.motion.other_courses import ForeignCourse
from rs485bus.motion.plan_lock import PlanLock
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import AxisState, Fact
from rs485bus.wire.frames import Request

_MISSES = 4
"""How many looks must have been without an answer then, at least, however long the drive may take for one."""
_UNLIKELY = math.log(1e-6)
"""How unlikely it must be that the line has lost them all."""
_SHOWN = 0.02
"""Seconds after which a drive that has stopped says why."""
_PAUSE = 0.05
"""The longest pause, in seconds, before a drive that does not answer is asked again."""
_AGAIN = 0.05
"""Seconds after which it is seen whether a stop has ended; or a look that must wait for a late reply gives way."""
_FOREVER = float("inf")

Told = Callable[[Verdict, MotionError | None], None]
"""Called when a course has reached its speed, has ended, or failed of an error."""


@dataclass(slots=True)
class _Watched:
    """One axis of a drive."""

    state: AxisState
    name: str
    on_trouble: Callable[[MotionError], None]
    tell: Callable[[EventKind, str], None]
    changes: Changes
    course: Course | None = None
    told: Told | None = None
    doubted_at: float | None = None
    doubted_until: float = _FOREVER
    """Since when it is being found out what is wrong; and until when, whatever the drive has not told by then."""
    lost: str = ""
    """Why its positions were not to be trusted when that was last looked at."""
    silent: bool = False
    """It was told that its drive does not answer."""
    starting: bool = False
    """Somebody is about to start or to stop it, and looks at it meanwhile."""


class Supervisor:
    """Looks at one drive.

    Args:
        bus: the bus it is on.
        drive: the drive.
    """

    def __init__(self, bus: Bus, drive: Drive) -> None:
        self._bus = instance("bus", bus, Bus, "await open_bus(...)")
        self._drive = drive
        self._budget = bus.keep(LookBudget, lambda: LookBudget(bus.config.supervision))
        self._watched: dict[int, _Watched] = {}
        self.plans = PlanLock()
        """Held while a plan of the drive is carried out."""
        self.questions = Questions(bus, drive)
        self._job: Job | None = None
        self._unanswered: dict[bytes, Job] = {}
        """Looks that were not answered, by their frames. The same one may be sent again where an equal one must wait,
        lest the late answer to the first is taken for its own."""
        self._timer_at = _FOREVER
        self._rotated_at = self._not_before = NEVER
        self._misses = 0
        self._missed: Fact | None = None
        """What the last look was for, where that was not told: it gives way to whatever else is due."""
        self._since = NEVER
        """Since when it is looked at."""
        times = bus.owner.units[drive.address].reply_times
        self._look_time = LookTime(bus.owner.pair, times, (reading.request for reading in drive.readings))
        drive.state.listen(self.review)

    def watch(
        self, axis: int, name: str, on_trouble: Callable[[MotionError], None], tell: Callable[[EventKind, str], None]
    ) -> None:
        """Look at an axis from now on, whenever it may move. `on_trouble` is called where nobody waits for its end;
        `tell` of what happens to it."""
        state = self._drive.state.axes[axis]
        self._watched[axis] = _Watched(state, name, on_trouble, tell, Changes(state, tell))

    def check_room(self, name: str) -> None:
        """Raise `LimitExceeded` where there is no room on the wire to look at this drive, too, while it moves."""
        self._budget.check(self, self._look_time.seconds, name)

    def begin(self, axis: int) -> None:
        """An axis is being told to move. Who does that sees whether it was, and says what follows then."""
        self.leave(axis)
        self._watched[axis].starting = True

    @contextmanager
    def absent(self, axis: int) -> Iterator[None]:
        """Do not look at an axis while this holds, whatever it does: it is tried what it does when nobody asks it."""
        self.begin(axis)
        try:
            yield
        finally:
            state = self._watched[axis].state
            state.keeps, state.holds = False, None  # its drive may have stopped it, or let go of it: that was tried
            self.leave(axis)
            self.review()

    def follow(self, axis: int, course: Course, told: Told) -> None:
        """An axis was told to move: judge it by that."""
        self.leave(axis)
        watched = self._watched[axis]
        watched.course, watched.told = course, told
        self.review()

    def leave(self, axis: int) -> None:
        """Nobody waits for what it was told last: it is stopped, or given up."""
        watched = self._watched[axis]
        watched.course = watched.told = watched.doubted_at = None
        watched.starting = False

    def course(self, axis: int) -> Course | None:
        """What it was told last, and does still."""
        return self._watched[axis].course

    @property
    def interval(self) -> float:
        """Seconds between two looks at an axis that may move."""
        return self._budget.interval

    # Judging

    def review(self) -> None:
        """Something is known that was not, or may be so no more."""
        active = False
        for axis, watched in self._watched.items():
            watched.state.suspect(self._drive.restarted(axis))
            watched.changes.look()
            self._tell_of_restart(watched)
            if watched.course is not None and watched.course.goes_on and not watched.state.motion.may_move:
                course, told = watched.course, watched.told
                self.leave(axis)  # it was stopped, and seen standing
                if told is not None and not course.reached:
                    told(Verdict.DOUBTFUL, self._diagnose(axis, watched, course))
            if watched.silent and self._drive.state.heard_at > self._since:
                watched.silent = False
                watched.tell(EventKind.BACK, "its drive answers again")
            if watched.starting or (watched.course is None and not self._may_move(axis, watched)):
                continue
            active = True
            halt = self._bus.owner.units[self._drive.address].halt
            if halt is None or halt.motion not in (watched.state.motion, self._drive.motion):
                self._judge(axis, watched, self._bus.now())
            elif halt.failed and watched.course is not None and not watched.course.goes_on:
                error = f"{watched.name} was stopped during {watched.course.what}, and could not be seen standing."
                self._end(axis, watched, Verdict.DOUBTFUL, MoveFailed(error))  # nobody waits longer for that
        if not active:
            self._rest()
            return
        if self._since == NEVER:
            self._since = self._bus.now()
            self._budget.enter(self, self._look_time.seconds)
        self._look()

    def _tell_of_restart(self, watched: _Watched, *, perhaps: bool = False) -> None:
        """Tell the owner that the drive has started anew, or `perhaps` has: its watchdog may be off."""
        told, watched.lost = watched.lost, watched.state.lost
        is_lost = watched.lost not in (told, "", watched.state.distrusted)
        if is_lost or perhaps:
            self._bus.owner.stops.restarted(self._bus.owner.units[self._drive.address])
        if is_lost:
            watched.tell(EventKind.RESTART, watched.lost)

    def _may_move(self, axis: int, watched: _Watched) -> bool:
        state, motion, drive = watched.state, watched.state.motion, self._drive
        if not motion.may_move:
            if state.stands is not False or not state.value(Fact.RUNNING):
                return False
            motion.moves()  # somebody else has set it in motion
            state.start(_FOREVER)
            state.keeps = False  # what it was told before has ended
        proof = drive.wanted(axis)
        watched.course = ForeignCourse("motion", state, motion.commanded_at, drive.start_grace, proof=proof)
        return True

    def _judge(self, axis: int, watched: _Watched, now: float) -> None:
        course = watched.course
        assert course is not None
        verdict = course.judge()
        if course.stop_at <= now:
            left = f"{watched.name} would leave its limits by its {course.what}: it was stopped before."
            self._end(axis, watched, Verdict.DOUBTFUL, LimitReached(left))
        elif verdict is Verdict.REACHED and watched.told is not None:
            watched.told(verdict, None)
        elif verdict is Verdict.DONE:
            watched.state.stood()
            self._end(axis, watched, verdict, None)
        elif verdict is Verdict.OVERDUE:
            late = f"{watched.name}: {course.what} takes more than twice its time, and a second. It was stopped."
            self._end(axis, watched, verdict, MoveTimeout(late))
        elif verdict is Verdict.DOUBTFUL:
            self._doubt(axis, watched, course, now)
        elif watched.doubted_at is not None:
            if course.interval < _FOREVER:
                self._doubt(axis, watched, course, now)  # others were stopped because of it
            else:
                watched.doubted_at = None

    def _doubt(self, axis: int, watched: _Watched, course: Course, now: float) -> None:
        """Find out what is wrong."""
        if watched.doubted_at is None:
            # What was asked while it stood already tells as much as what is asked now.
            shown_at = watched.state.standstill.since + _SHOWN if watched.state.stands else now
            watched.doubted_at = min(shown_at, self._drive.state.heard_at)
            watched.doubted_until = now + FOUND_OUT * self.interval
            if watched.told is not None:
                watched.told(Verdict.DOUBTFUL, None)
        is_over = now > watched.doubted_until or is_decided(self._drive, axis, course, watched.doubted_at)
        if watched.course is course and is_over:
            self._end(axis, watched, Verdict.DOUBTFUL, self._diagnose(axis, watched, course))

    def _diagnose(self, axis: int, watched: _Watched, course: Course) -> MotionError:
        cause = possible_cause(self._bus.owner, self._drive)
        if suspect_restart(self._drive, axis, course, cause):
            self._tell_of_restart(watched, perhaps=True)
        return diagnose(self._drive, axis, watched.name, course, cause)

    def _end(self, axis: int, watched: _Watched, verdict: Verdict, error: MotionError | None) -> None:
        if watched.course is not None and error is not None:
            watched.course.failed()
        told, watched.course, watched.told, watched.doubted_at = watched.told, None, None, None
        if error is not None and not isinstance(error, ReferenceLost):
            watched.silent = verdict is Verdict.SILENT
            if told is not None or not is_stall_by_status(self._drive, axis, error):  # else it is told after a stop
                watched.changes.failed(error, silent=watched.silent)
        if told is not None:
            watched.starting = error is not None  # who is told stops it, or sees that it need not be
            told(verdict, error)
        elif error is not None:
            watched.on_trouble(error)

    # Looking

    def _rest(self) -> None:
        if self._since != NEVER:
            self._since = NEVER
            self._budget.leave(self)

    def _look(self) -> None:
        """Ask for what is due, or come back when something is."""
        owner, now = self._bus.owner, self._bus.now()
        unit = owner.units[self._drive.address]
        if self._job is not None or owner.gate.closed:
            return
        if unit.halt is not None or not owner.gate.connected:
            self._wake_at(now + _AGAIN)  # who stops it looks at it
            return
        unheard = now - max(self._drive.state.heard_at, self._since)
        if self._misses >= self._in_vain(unit) and unheard > SILENT * max(self._interval(), unit.reply_timeout):
            self._fell_silent()
            return
        unit.late.expire(now)
        when, fact = self._next(now)
        if max(when, self._not_before) > now:
            self._wake_at(max(when, self._not_before))
            return
        request = self._free(fact)
        if fact not in self._drive.telling:
            self._rotated_at = now
        job = self._unanswered.pop(request.adu, None)
        if job is None:
            job = Job(request, urgency=Urgency.CONFIRM, internal=True, retries=0, weighs=True, on_end=self._answered)
        self._job, self._missed = job, fact
        self._bus.submit(job)
        if not job.attempts:
            self._bus.call_at(now + _AGAIN, functools.partial(self._give_way, job))

    def _give_way(self, job: Job) -> None:
        """Take back a look that must wait for a late reply to somebody else: another one is chosen then."""
        if self._job is job and not job.attempts:
            owner, now = self._bus.owner, self._bus.now()
            if owner.units[self._drive.address].late.must_wait(job.request):
                owner.cancel(job, now)
            else:
                self._bus.call_at(now + _AGAIN, functools.partial(self._give_way, job))

    def _in_vain(self, unit: UnitState) -> int:
        """How many looks in a row must have been without an answer, lest that is the loss of the line."""
        return max(_MISSES, math.ceil(_UNLIKELY / math.log(share_lost(*unit.reach.loss.counts))))

    def _free(self, fact: Fact) -> Request:
        """What to ask for a fact; where a late reply could be taken for its answer, something else."""
        late = self._bus.owner.units[self._drive.address].late

        def free(request: Request) -> bool:
            return not late.in_order or not late.must_wait(request, self._unanswered.get(request.adu))

        reading = self._drive.reading(fact, free)
        if reading is not None:
            return reading.request
        others = (*(each.request for each in self._drive.readings), *self._drive.reads())
        return next((request for request in others if free(request)), others[0])

    def _answered(self, job: Job) -> None:
        self._job = None
        if job.outcome is Outcome.NOT_SENT:
            self.review()
            return
        took = job.ended_at - job.sent_at
        if job.outcome is Outcome.REPLY:
            self._misses, self._missed = 0, None
            self._look_time.took(took)
            if self._since != NEVER:
                self._budget.enter(self, self._look_time.seconds)
                self._look()  # what it said was reviewed when it came
            return
        # The first repetition goes at once; later ones leave the wire to others.
        self._misses += 1
        self._unanswered[job.request.adu] = job
        self._not_before = job.ended_at + (0.0 if self._misses == 1 else min(took * (1 / SHARE - 1), _PAUSE))
        self.review()

    def _next(self, now: float) -> tuple[float, Fact]:
        """What is to be asked next, and when."""
        best, fact = _FOREVER, self._drive.telling[0]
        for axis, watched in self._watched.items():
            course = watched.course
            if course is None:
                continue
            interval, stop_at = self._interval(course), course.stop_at
            for each in self._facts(axis, course):
                due = min(course.due(each), self._routine(each, watched, course, interval), stop_at)
                if watched.doubted_at is not None and watched.state.known(each).at < watched.doubted_at:
                    due = NEVER
                due = max(due, now) if each is self._missed else due
                if due < best:
                    best, fact = due, each
        return best, fact

    def _facts(self, axis: int, course: Course) -> Iterable[Fact]:
        """What may be asked about an axis."""
        wanted = self._drive.wanted(axis)
        first = self._drive.telling if self._watched[axis].doubted_at is None else in_order(wanted)
        return self._drive.tells(*dict.fromkeys((*first, *wanted, Fact.SPEED, *course.facts)))

    def _routine(self, fact: Fact, watched: _Watched, course: Course, interval: float) -> float:
        """When a fact is due because the axis moves."""
        at = watched.state.last(fact).at  # set-points take away what was known, again and again
        if fact in self._drive.telling:
            return max(at, course.started_at) + interval
        if fact in self._drive.rotation:
            oldest = max(at, course.started_at) + len(self._drive.rotation) * self._budget.interval
            return max(oldest, self._rotated_at + self._budget.rotation)
        return _FOREVER

    def _interval(self, *courses: Course) -> float:
        """Seconds between two telling looks; fewer where others depend on one of these courses, or of all."""
        all_courses = courses or tuple(each.course for each in self._watched.values() if each.course is not None)
        wanted = min((course.interval for course in all_courses), default=_FOREVER)
        return min(self._budget.interval, max(wanted, self._budget.shortest))

    def _wake_at(self, when: float) -> None:
        if when < self._timer_at - 1e-4 and when < _FOREVER:
            self._timer_at = when
            self._bus.call_at(when, self._wake)

    def _wake(self) -> None:
        self._timer_at = _FOREVER
        self.review()

    def _fell_silent(self) -> None:
        self._since = self._bus.now()
        for axis, watched in self._watched.items():
            if watched.course is not None:
                course, watched.state.between = watched.course, watched.course.between
                silent = f"{watched.name} stopped answering during {course.what}."
                self._end(axis, watched, Verdict.SILENT, MoveFailed(silent))
