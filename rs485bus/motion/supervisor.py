"""Looks at whatever may move, and tells at once what ends it.

From the first frame that may set an axis in motion until it was seen to stand it is looked at, whoever set it in motion
and whether anybody waits for it or not. Replies to others count: only what would be too old is asked for.
"""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from rs485bus.arguments import instance
from rs485bus.bus.bus import Bus
from rs485bus.bus.schedule.job import Job, Outcome, Urgency
from rs485bus.bus.schedule.timers import Wake
from rs485bus.bus.stopping.halt import Halt
from rs485bus.bus.watchdog.foreign import possible_cause
from rs485bus.errors import LimitReached, MotionError, MoveFailed, MoveTimeout, ReferenceLost
from rs485bus.motion.courses import Course, Verdict
from rs485bus.motion.diagnosis import FOUND_OUT, diagnose, in_order, is_decided, is_stall_by_status, suspect_restart
from rs485bus.motion.drive import Drive
from rs485bus.motion.events import Changes, EventKind
from rs485bus.motion.knowledge import Questions
from rs485bus.motion.look_budget import SILENT, LookBudget, LookOutcomes, LookTime
from rs485bus.motion.other_courses import ForeignCourse
from rs485bus.motion.plan_lock import PlanLock
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import Fact
from rs485bus.motion.watched import Told, Watched

_log = logging.getLogger("rs485bus")

_SHOWN = 0.02
"""Seconds after which a drive that has stopped says why."""
_AGAIN = 0.05
"""Seconds after which it is seen whether a stop has ended; or a look that must wait for a late reply gives way."""
_FOREVER = float("inf")


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
        self._watched: dict[int, Watched] = {}
        self.plans = PlanLock()
        """Held while a plan of the drive is carried out."""
        self.questions = Questions(bus, drive)
        self._job: Job | None = None
        self._unanswered: dict[bytes, Job] = {}
        """Looks that were not answered, by their frames. The same one may be sent again where an equal one must wait,
        lest the late answer to the first is taken for its own."""
        self._wake = Wake(bus.call_at, self.review)
        self._rotated_at = NEVER
        self._outcomes = LookOutcomes()
        self._missed: Fact | None = None
        """What the last look was for, where that was not told: it gives way to whatever else is due."""
        self._must_tell: Fact | None = None
        """What the answer to it must tell."""
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
        self._watched[axis] = Watched(state, name, on_trouble, tell, Changes(state, tell))

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
        active, unheeded = False, self._drive.state.take_unheeded()
        for axis, watched in self._watched.items():
            try:
                if unheeded is not None:
                    raise unheeded
                active = self._review(axis, watched) or active
                watched.unjudged = False
            except Exception as error:
                self._cannot_judge(axis, watched, error)
        if not active:
            self._rest()
            return
        if self._since == NEVER:
            self._since = self._bus.now()
            self._budget.enter(self, self._look_time.seconds)
        self._look()

    def _review(self, axis: int, watched: Watched) -> bool:
        """The same, of one axis. Whether it is to be looked at."""
        watched.state.suspect(self._drive.restarted(axis))
        watched.changes.look()
        self._tell_of_restart(watched)
        if watched.course is not None and watched.course.goes_on and not watched.state.motion.may_move:
            told = None if watched.course.reached else watched.told
            why = None if told is None else self._diagnose(axis, watched, watched.course)
            self.leave(axis)  # it was stopped, and seen standing
            if told is not None:
                told(Verdict.DOUBTFUL, why)
        if watched.silent and self._drive.state.heard_at > self._since:
            watched.silent = False
            watched.tell(EventKind.BACK, "its drive answers again")
        if watched.starting or (watched.course is None and not self._may_move(axis, watched)):
            return False
        halt = self._halt_of(watched)
        if halt is None:
            self._judge(axis, watched, self._bus.now())
        elif halt.failed and watched.course is not None and not watched.course.goes_on:
            error = f"{watched.name} was stopped during {watched.course.what}, and could not be seen standing."
            self._end(axis, watched, Verdict.DOUBTFUL, MoveFailed(error))  # nobody waits longer for that
        return True

    def _halt_of(self, watched: Watched) -> Halt | None:
        """What stops it, if it is being stopped."""
        halt = self._bus.owner.units[self._drive.address].halt
        return halt if halt is not None and halt.motion in (watched.state.motion, self._drive.motion) else None

    def _cannot_judge(self, axis: int, watched: Watched, error: Exception) -> None:
        """The family's own code failed where it was to tell of an axis, or what to ask: it is stopped if it moves."""
        if not watched.unjudged:
            _log.error("%s: what its drive tells cannot be judged", watched.name, exc_info=error)
        watched.unjudged = True
        if watched.course is None and (watched.starting or not watched.state.motion.may_move):
            return
        if watched.told is not None or self._halt_of(watched) is None:
            failed = MoveFailed(f"{watched.name}: what it does cannot be judged, so that it was ended: {error!r}.")
            failed.__cause__ = error
            self._end(axis, watched, Verdict.DOUBTFUL, failed)

    def _tell_of_restart(self, watched: Watched, *, perhaps: bool = False) -> None:
        """Tell the owner that the drive has started anew, or `perhaps` has: its watchdog may be off."""
        told, watched.lost = watched.lost, watched.state.lost
        is_lost = watched.lost not in (told, "", watched.state.distrusted)
        if is_lost or perhaps:
            self._bus.owner.stops.restarted(self._bus.owner.units[self._drive.address])
        if is_lost:
            watched.tell(EventKind.RESTART, watched.lost)

    def _may_move(self, axis: int, watched: Watched) -> bool:
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

    def _judge(self, axis: int, watched: Watched, now: float) -> None:
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

    def _doubt(self, axis: int, watched: Watched, course: Course, now: float) -> None:
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

    def _diagnose(self, axis: int, watched: Watched, course: Course) -> MotionError:
        cause = possible_cause(self._bus.owner, self._drive)
        if suspect_restart(self._drive, axis, course, cause):
            self._tell_of_restart(watched, perhaps=True)
        return diagnose(self._drive, axis, watched.name, course, cause)

    def _end(self, axis: int, watched: Watched, verdict: Verdict, error: MotionError | None) -> None:
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
        try:
            self._ask_what_is_due()
        except Exception as error:
            for axis, watched in self._watched.items():
                if watched.course is not None:
                    self._cannot_judge(axis, watched, error)

    def _ask_what_is_due(self) -> None:
        owner, now = self._bus.owner, self._bus.now()
        unit = owner.units[self._drive.address]
        if self._job is not None or owner.gate.closed:
            return
        if unit.halt is not None or not owner.gate.connected:
            self._wake.at(now + _AGAIN)  # who stops it looks at it
            return
        patience = SILENT * max(self._interval(), unit.reply_timeout)
        unheard, untold = self._outcomes.in_vain(unit.reach.loss.counts)
        if unheard and now - max(self._drive.state.heard_at, self._since) > patience:
            self._fell_silent("stopped answering")
            return
        if untold:
            told_at = min(watched.told_where_at(self._drive.telling) for watched in self._watched.values())
            if now - max(told_at, self._since) > patience:
                self._fell_silent("did not tell where it is")
                return
        unit.expire(now)
        when, fact = self._next(now)
        when = max(when, self._outcomes.not_before)
        if when > now:
            self._wake.at(when)
            return
        request, tells = self.questions.for_a_look(fact, self._unanswered)
        self._must_tell = fact if tells else None
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

    def _answered(self, job: Job) -> None:
        self._job = None
        if job.outcome is Outcome.NOT_SENT:
            self.review()
            return
        took, fact = job.ended_at - job.sent_at, self._must_tell
        telling = fact in self._drive.telling
        if job.outcome is Outcome.REPLY:
            self._look_time.took(took)
            told = fact is None or self._tells((fact,), job)
            where = self._tells(self._drive.telling, job)
            self._outcomes.answered(job.ended_at, took, told=told, telling=telling, where=where)
            self._missed = None if told else self._missed
            if self._since != NEVER:
                self._budget.enter(self, self._look_time.seconds)
                self._look()  # what it said was reviewed when it came
            return
        self._outcomes.missed(job.ended_at, took, telling=telling)
        self._unanswered[job.request.adu] = job
        self.review()

    def _tells(self, facts: Iterable[Fact], job: Job) -> bool:
        """Whether an answer tells any of these facts. One that may be of any age is not looked into."""
        misheard = self._bus.owner.units[self._drive.address].misheard_at == job.ended_at
        return not misheard and any(self._drive.state.was_told(fact, job.ended_at) is not False for fact in facts)

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

    def _routine(self, fact: Fact, watched: Watched, course: Course, interval: float) -> float:
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

    def _fell_silent(self, why: str) -> None:
        self._since = self._bus.now()
        for axis, watched in self._watched.items():
            if watched.course is not None:
                course, watched.state.between = watched.course, watched.course.between
                silent = MoveFailed(f"{watched.name} {why} during {course.what}.")
                silent.__cause__ = self._drive.state.misunderstood
                self._end(axis, watched, Verdict.SILENT, silent)
