"""Carries out what an axis goes on with: runs, streams, and what it is told until it is told otherwise."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from contextlib import suppress

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.errors import BusError, LimitReached, MotionError, MoveFailed
from rs485bus.motion.courses import Course, Verdict
from rs485bus.motion.drive import Drive
from rs485bus.motion.executor import MoveExecutor
from rs485bus.motion.joint import PlanOfAll
from rs485bus.motion.move import Move, MoveState, Task
from rs485bus.motion.other_courses import ForeignCourse
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Plan
from rs485bus.motion.profile import RunProfile
from rs485bus.motion.run_course import RunCourse
from rs485bus.motion.run_limits import RunLimits
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import Fact
from rs485bus.motion.stop_control import StopControl
from rs485bus.motion.supervisor import Supervisor

_WAY, _WAY_TIME = 0.05, 0.1
"""By how much the way of a run for a time may differ from what it should be: as a part of it, or in seconds."""
_AT_ONCE = 0.01
"""Seconds between a start and its repetition that make no difference."""


class RunExecutor:
    """Carries out runs.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        axis: which one of the drive it is.
        name: names it in messages.
        executor: carries out its moves, and what runs have in common with them.
        stops: stops it.
        supervisor: looks at it.
    """

    def __init__(
        self,
        bus: Bus,
        drive: Drive,
        axis: int,
        name: str,
        executor: MoveExecutor,
        stops: StopControl,
        supervisor: Supervisor,
    ) -> None:
        self._bus = bus
        self._drive = drive
        self._axis = axis
        self._name = name
        self._executor = executor
        self._stops = stops
        self._supervisor = supervisor
        self._state = drive.state.axes[axis]
        self._overtaken = False
        """Another run follows the one that is carried out."""

    async def run(
        self,
        move: Move,
        rpm: float,
        parameters: MotionParameters,
        duration: float | None,
        ticks: int | None,
        limits: tuple[int, int] | None,
    ) -> int:
        """Change to a speed, in the drive's direction: until that is reached; for a time, until it stands again. It is
        stopped by its ramp before it leaves the limits, in counts. Where it was seen last: nothing is asked once it is
        known that the run is done."""
        move.rpm, move.acceleration = abs(rpm), parameters.acceleration
        self._overtaken = False
        start = await self._executor.ready(standing=False)
        task = Task(move, start=start, rpm=rpm, before=await self._speed())
        rate = min(parameters.acceleration, parameters.slowing_down)
        profile = RunProfile(rpm, rate, task.before, duration)
        since = self._state.known(Fact.POSITION).at
        if limits is not None and rpm and not (start < limits[1] if rpm > 0 else start > limits[0]):
            raise LimitReached(f"{self._name} stands at the end of its limits already, and can only run the other way.")
        counted = duration if ticks is None and rpm else None  # here, and not by the drive
        if counted is None:
            await self._run_off(task, rpm, parameters, ticks)
        else:
            # It is told no more than it comes to: its ramp down is then for the speed that it has.
            step = self._drive.ability(self._axis).rpm_step
            task.rpm = profile.last_speed if abs(profile.last_speed) >= step else math.copysign(step, rpm)
            await self._run_for(task, task.rpm, parameters, counted)
        counts_per_turn = self._drive.ability(self._axis).counts_per_turn
        if counted is not None:
            move.started_at = await self._began_at(task, profile, counts_per_turn)
        assert move.started_at is not None
        course = RunCourse(
            self._executor.short(move),
            self._state,
            move.started_at,
            self._drive.start_grace,
            profile=profile,
            counts_per_turn=counts_per_turn,
            may_restart=not self._drive.tells_restarts,
            limits=None if limits is None else RunLimits(*limits, rate / 60 * counts_per_turn, self._attempt),
        )
        move.eta = course.eta
        if duration is None or not rpm:
            await self._executor.see_it_end(move, course, reached=self._overtaken)
            return self._seen_at
        drift = task.before * (move.started_at - since) / 60
        if counted is None:
            await self._executor.see_it_end(move, course)
        else:
            try:
                await self._executor.see_it_end(move, course, move.started_at + counted, self._slow_down)
            except MoveFailed as error:
                if type(error) is MoveFailed:
                    # Where its ramp was not acknowledged, it was stopped harder at the end: how far it went says more.
                    self._check_way(task, course, drift)
                raise
        self._check_way(task, course, drift)
        return self._seen_at

    def overtake(self) -> None:
        """Do not wait for the speed of the run that is carried out: another one follows."""
        self._overtaken = True
        course = self._supervisor.course(self._axis)
        if isinstance(course, RunCourse):
            course.reached = True
            self._executor.told(Verdict.REACHED, None)

    async def stream(self, move: Move, begin: Callable[[float], Awaitable[Course]], *, by_reference: bool) -> int:
        """Have it follow speeds that are told as they come, from the one on that it has; where that ended."""
        await self._executor.ready(standing=False)
        if by_reference:
            self._executor.knowledge.check_reference()
        return await self.follow(move, begin)

    async def follow(self, move: Move, begin: Callable[[float], Awaitable[Course]]) -> int:
        """The same, once it is ready: of one that is told its speeds together with others, say."""
        self._executor.commanded = None
        move.state, move.started_at = MoveState.MOVING, self._bus.now()
        await self._executor.see_it_end(move, await begin(await self._speed()))
        return self._seen_at

    async def push(
        self, move: Move, wanted: object, plan: Callable[[], Plan[None]], of_all: PlanOfAll, what: str
    ) -> int:
        """Have it do something by a plan that goes on until it is told otherwise. Done once it was told; where it was
        seen last."""
        task = Task(move, start=await self._executor.ready(standing=False))
        await self._executor.set_off(task, plan, wanted, of_all)
        assert move.started_at is not None
        course = ForeignCourse(what, self._state, move.started_at, self._drive.start_grace, kept=True)

        def told(_: Verdict, error: MotionError | None) -> None:
            if error is not None:
                self._executor.on_trouble(error)

        self._supervisor.follow(self._axis, course, told)
        return self._seen_at

    # Parts of them

    @property
    def _seen_at(self) -> int:
        """Where it was seen last, in counts."""
        position: int = self._state.last(Fact.POSITION).value
        return position

    @property
    def _attempt(self) -> float:
        """Seconds that an attempt to tell the drive something may take in vain."""
        return self._bus.owner.units[self._drive.address].reply_timeout

    async def _run_off(self, task: Task, rpm: float, parameters: MotionParameters, ticks: int | None) -> None:
        """Tell it a speed."""
        await self._executor.set_off(
            task,
            lambda: self._drive.run(self._axis, rpm, parameters, ticks),
            (rpm, parameters),
            self._drive.run_all,
        )

    def _check_way(self, task: Task, course: RunCourse, drift: float) -> None:
        """Raise `MoveFailed` where a run for a time has not gone as far as it should have, and some turns that it went
        before it was told."""
        state, profile = self._state, course.profile
        counts = state.rule.moved(task.start or 0, state.last(Fact.POSITION).value)
        went = counts / self._drive.ability(self._axis).counts_per_turn
        wanted = drift + profile.turns_after(profile.ends_after)
        if abs(went - wanted) > max(_WAY * abs(wanted), _WAY_TIME * abs(profile.rpm) / 60):
            halted_by = self._drive.halted_by(self._axis)
            why = f": {halted_by}" if halted_by else f". {self._drive.what_else(self._axis)}"
            if abs(went) > abs(wanted):
                why = ". It heard late that it was to stop, or its ramps are not what it was told."
            raise MoveFailed(
                f"{self._name} went {went:.3f} turns in its {course.what} for {profile.duration:g} s, and should have "
                f"gone {wanted:.3f}{why}"
            )

    async def _run_for(self, task: Task, rpm: float, parameters: MotionParameters, seconds: float) -> None:
        """Tell it a speed for a time that is counted here. It is stopped when that is over since its start was first
        sent, though the drive has not answered yet."""
        began, told = self._bus.now(), False

        def look() -> None:
            now, first = self._bus.now(), self._state.told_at
            over = (first if first >= began else now) + seconds
            if told or self._bus.closed:
                return
            if over > now:
                self._bus.after(over - now, look)
            else:
                self._bus.spawn(stop(), f"end of {task.move.what}")

        async def stop() -> None:
            with suppress(BusError):  # it is stopped once more when the drive has answered
                await self._slow_down()

        self._bus.after(seconds, look)
        try:
            await self._run_off(task, rpm, parameters, None)
        finally:
            told = True

    async def _slow_down(self) -> None:
        """Stop it by its ramp, and the axes with it that it was set in motion with: that waits for no late reply to
        what was said before, and is repeated until it is seen to stand."""
        alone = self._stops.queue.joint is None
        if self._stops.is_stopping_all(self._state.motion if alone else self._drive.motion):
            self._supervisor.leave(self._axis)
            await self._stops.stopped()  # to say it again may begin its ramp anew
        else:
            await self._stops.stand_still(motion=None if alone else self._drive.motion)

    async def _began_at(self, task: Task, profile: RunProfile, counts_per_turn: int) -> float:
        """When it was set in motion, for a time that is counted here. Where its start was said more than once, its
        position shows which one it heard; where that shows nothing in time, it may have been the first."""
        state, last = self._state, task.move.started_at
        assert last is not None
        first = state.told_at if state.told_at > NEVER else last
        if last - first < _AT_ONCE or task.before or task.start is None:
            return min(first, last)
        with suppress(BusError), anyio.move_on_after(first + (profile.duration or 0.0) - self._bus.now()):
            await self._executor.knowledge.afresh(Fact.POSITION)
            seen = state.known(Fact.POSITION)
            turns = state.rule.moved(task.start, seen.value) / counts_per_turn
            return min(max(first, seen.at - profile.seconds_to(turns)), last)
        return first

    async def _speed(self) -> float:
        """How fast it turns, in rpm, before it is told another speed."""
        course = self._supervisor.course(self._axis)
        if isinstance(course, RunCourse) and course.keeps:
            return course.profile.rpm
        if not self._state.motion.may_move:
            return 0.0
        await self._executor.knowledge.afresh(Fact.SPEED)
        return float(self._state.value(Fact.SPEED) or 0.0)
