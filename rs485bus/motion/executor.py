"""Carries out the commands of one axis, each once. What families differ in is in their plans."""

from __future__ import annotations

import asyncio
import functools
import math
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from typing import Any

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.watchdog.guard import admit_and_arm
from rs485bus.errors import (
    DriveFault,
    LimitReached,
    MotionError,
    MoveFailed,
    NoReply,
    NotEnabled,
    RearmRequired,
)
from rs485bus.motion.carrier import PlanCarrier
from rs485bus.motion.courses import Course, MoveCourse, Verdict
from rs485bus.motion.diagnosis import UNSEEN
from rs485bus.motion.drive import Drive
from rs485bus.motion.group.member import GroupMemberMove
from rs485bus.motion.joint import Joint, Part, PlanOfAll
from rs485bus.motion.knowledge import AxisKnowledge
from rs485bus.motion.move import Move, MoveState, Task
from rs485bus.motion.other_courses import HomingCourse
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Ended, Plan
from rs485bus.motion.reference import Reference
from rs485bus.motion.retargeting import Change, Retargeting
from rs485bus.motion.state import Fact
from rs485bus.motion.stop_control import StopControl
from rs485bus.motion.supervisor import Supervisor
from rs485bus.motion.watched import Told

_WATCH = 0.06
"""Seconds between two looks at an axis on which others depend."""
_LATE = 0.02
"""Seconds after its start was sent in which a drive can begin to move, at most."""


class MoveExecutor:
    """Carries out commands.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        axis: which one of the drive it is.
        name: names it in messages.
        stops: stops it.
        supervisor: looks at it.
    """

    def __init__(
        self, bus: Bus, drive: Drive, axis: int, name: str, stops: StopControl, supervisor: Supervisor
    ) -> None:
        self.tolerance = 0
        """Counts by which it may differ from its target when it has arrived."""
        self.commanded: int | None = None
        """The target of the last move, if that was reached and nothing has happened since."""
        self.changeable: Move | None = None
        """The move under way, where it can be sent elsewhere."""
        self.knowledge = AxisKnowledge(bus, drive, axis, name, supervisor.questions)
        self._bus = bus
        self._drive = drive
        self._axis = axis
        self._name = name
        self._stops = stops
        self._supervisor = supervisor
        self._state = self.knowledge.state
        self._carrier = PlanCarrier(bus, drive, axis, name, self.knowledge, stops, supervisor, self.stumble)
        self._reference = Reference(bus, drive, axis, name, self.knowledge, self._carrier, lambda: self.tolerance)
        self.carry = self._carrier.carry
        self._retargeting = Retargeting(bus, drive, axis, name, self.knowledge, self._carrier)
        self._wake = asyncio.Event()
        self.told: Told = lambda verdict, error: None
        """Takes the verdict on what is waited for."""
        supervisor.watch(axis, name, functools.partial(self.on_trouble, foreign=True), stops.tell)

    # Commands

    async def enable(self) -> None:
        """Energise the motor; after a stop for safety, stop once more first."""
        unit, state = self._bus.owner.units[self._drive.address], self._state
        if unit.lapsed:
            raise RearmRequired(f"{self._name} was stopped because {unit.locked}: renew() the lease, then enable().")
        if unit.locked or self._stops.blocked or unit.halt is not None or unit.rearm is not None:
            await self._stops.stand_still(emergency=True, motion=self._drive.motion)
            if unit.rearm is not None:
                await self._rearm(unit.rearm)  # where that fails it stays locked: its watchdog may be armed
            unit.locked = self._stops.blocked = ""
        await self.carry(self._drive.set_up)
        if state.holds is None and not await self.knowledge.stands():
            await self._stops.stand_still(motion=self._drive.motion)  # another program left it turning
        await self.carry(lambda: self._drive.enable(self._axis))
        await self.knowledge.see_restart()

    async def disable(self) -> None:
        """Let go of the motor."""
        if self._state.motion.may_move:
            await self._stops.stand_still()
        await self.carry(lambda: self._drive.disable(self._axis))
        self._state.stood_at = self.commanded = None

    async def zero(self) -> None:
        """Make the position at which it then stands its zero."""
        await self.carry(self._drive.set_up)
        await self._carrier.have_it_stand()
        self.commanded = None
        await self._reference.zero()
        self.commanded = 0

    async def seek(self, move: Move, plan: Callable[[], Plan[None]], *, by_reference: bool, at_zero: bool) -> int:
        """Have the drive find its reference by a routine of its own, or go there `by_reference` to the one that is set
        already; where that ended, which is `at_zero` or wherever the drive then says."""
        if by_reference:
            await self.ready()
        else:
            self._stops.check_rearm()
            await self.carry(self._drive.set_up)
            await self._carrier.have_it_stand()
            await self.knowledge.see_restart()
            await self.knowledge.afresh(Fact.ENABLED, Fact.FAULT)
            self._check_able()
        move.state = MoveState.STARTING
        self.commanded = None
        task = Task(move, start=self._state.value(Fact.POSITION), ended=lambda step: self._see_it_found(step, move))
        self._state.counts_anew = not by_reference
        try:
            await self.carry(plan, task)
        finally:
            self._state.counts_anew = False
        position = await self._reference.take(at_zero=at_zero)
        self.commanded = 0 if at_zero else position
        return position

    async def move(
        self,
        move: Move,
        target_from: Callable[[int], int],
        parameters: MotionParameters,
        plan: Callable[[int, MotionParameters], Plan[None]] | None = None,
    ) -> int:
        """Go to a target, which may depend on where the move starts; where it ended. `plan` tells the drive otherwise
        than `Drive.move`."""
        task = Task(move, start=await self.ready())
        if isinstance(move, GroupMemberMove):
            await move.prepared()
            task.start = await self.ready()  # the others may have taken their time
        assert task.start is not None
        start, target, ability = task.start, target_from(task.start), self._drive.ability(self._axis)
        task.target = target
        way = abs(self._state.rule.moved(start, target))
        if isinstance(move, GroupMemberMove):
            turns = way / ability.counts_per_turn if way > self.tolerance else 0.0
            parameters, task.slot = await move.agree(turns, target)
        profile = parameters.profile(way / ability.counts_per_turn)
        move.rpm, move.acceleration = parameters.rpm, parameters.acceleration
        move.eta = self._bus.now() + profile.duration
        told = parameters
        await self.set_off(
            task,
            lambda: plan(target, told) if plan is not None else self._drive.move(self._axis, target, told),
            (target, told),
            self._drive.move_all,
        )
        assert move.started_at is not None
        course = MoveCourse(
            self.short(move),
            self._state,
            move.started_at,
            self._drive.start_grace,
            start=start,
            target=target,
            tolerance=self.tolerance,
            profile=profile,
            counts_per_turn=ability.counts_per_turn,
            late=min(self._bus.now() - move.started_at, _LATE),
            # Where a drive counts from after a restart, it could have restarted instead of arriving.
            proof=self._drive.marks(self._axis),
        )
        if isinstance(move, GroupMemberMove):
            course.interval = _WATCH
        move.eta = move.started_at + profile.duration
        self.changeable = move if plan is None else None
        try:
            await self.see_it_end(move, course)
        finally:
            self.changeable = None
            if self._retargeting.change is not None:
                self._retargeting.drop("its move ended before the target was changed")
        self.commanded = course.target
        position: int = self._state.value(Fact.POSITION)
        if isinstance(move, GroupMemberMove):
            await self._stay(move)
        return position

    def change(self, change: Change) -> None:
        """Send the move under way elsewhere."""
        self._retargeting.ask(change)
        self._wake.set()

    async def ready(self, *, standing: bool = True) -> int:
        """Know where the axis is, and that it may be moved; where it is.

        Raises:
            RearmRequired, ReferenceLost, NotEnabled: it may not.
        """
        state, knowledge = self._state, self.knowledge
        self._stops.check_rearm()
        await self.carry(self._drive.set_up)
        if standing:
            knowledge.check_reference()
        lost = state.lost
        if standing and state.motion.may_move:
            await self._stops.stand_still()
        await knowledge.see_restart(Fact.POSITION)
        if standing:
            await self._carrier.have_it_stand()
            knowledge.notice_restart()
            if state.stood_at is None:
                self.commanded = None  # something may have moved it since
        if standing or state.lost != lost:
            knowledge.check_reference()
        await self.carry(lambda: self._drive.resume(self._axis))
        await knowledge.know((Fact.ENABLED,))
        await knowledge.know((Fact.POSITION,))
        self._check_able()
        self._stops.check_cut_off()
        position: int = state.value(Fact.POSITION)
        if standing:
            state.stood_at = position
        if self.commanded is not None and state.may_be_moved:
            was_moved = abs(state.rule.moved(self.commanded, position)) > self.tolerance
            self.commanded = None if was_moved else self.commanded
        return position

    async def make_safe(self, failed: Handle[Any]) -> bool:
        """See it stand whose move has failed, or stop it: it may have begun. Whether it is being stopped for that."""
        if not isinstance(failed, Move) or not self._state.motion.may_move or self._stops.is_stopping:
            return False
        self.stumble()
        if stops := not await self._carrier.is_seen_standing():
            self._stops.stop_if_moving()
        return stops

    # Parts of them

    async def set_off(self, task: Task, make: Callable[[], Plan[None]], wanted: object, of_all: PlanOfAll) -> None:
        """Set the axis in motion, by a plan whose last step is the start; by one `of_all` that are `wanted` to do
        something together, where it is not alone."""
        self._supervisor.check_room(self._name)
        joint = self._stops.queue.joint
        task.move.state = MoveState.STARTING
        self.commanded = None
        if isinstance(joint, Joint):
            await joint.set_off(self._axis, Part(self._carrier, task, wanted, of_all))
        else:
            await self.carry(make, task)
        task.move.state = MoveState.MOVING

    async def _rearm(self, timeout: float) -> None:
        if not await admit_and_arm(self._bus, self._drive, timeout):
            raise RearmRequired(f"{self._name}: its watchdog could not be armed again.")

    def _check_able(self) -> None:
        """Raise what keeps it from moving, as far as is known."""
        state = self._state
        fault = state.value(Fact.FAULT)
        if fault:
            raise DriveFault(f"{self._name} reports {fault}. {self._drive.fault_remedy}".rstrip())
        enabled = state.value(Fact.ENABLED)
        if enabled is False or (enabled is None and not state.holds):
            state.holds = False
            if fault := state.value(Fact.FAULT):
                raise DriveFault(f"{self._name}: the drive reports {fault}. {self._drive.fault_remedy}".rstrip())
            why = ", since the port was lost while it turned" if self._stops.was_cut_off else ""
            raise NotEnabled(f"{self._name} is not enabled{why}: enable() it first.")
        state.holds = True

    # Seeing them end

    async def _see_it_found(self, step: Ended, move: Move) -> None:
        """Wait for the end of a routine of the drive's own."""
        assert move.started_at is not None
        move.state = MoveState.MOVING
        begun = self.short(move), self._state, move.started_at, self._drive.start_grace
        course = HomingCourse(
            *begun,
            done=step.done,
            watch=self._drive.tells(*step.watch),
            timeout=step.timeout,
        )
        await self.see_it_end(move, course)

    async def see_it_end(
        self,
        move: Move,
        course: Course,
        over: float = math.inf,
        end_it: Callable[[], Awaitable[None]] | None = None,
        *,
        reached: bool = False,
    ) -> None:
        """Wait until a course has reached its speed, or has ended. Raises what is wrong with it.

        Args:
            move: what it is a part of.
            course: how it goes.
            over: when it is to be ended, where the drive does not do that by itself.
            end_it: tells the drive to.
            reached: do not wait for its speed.
        """
        ended: list[tuple[Verdict, MotionError | None]] = []
        self._wake.clear()
        self._stops.is_failing = False

        def told(verdict: Verdict, error: MotionError | None) -> None:
            self._stops.is_failing = verdict is Verdict.DOUBTFUL or error is not None
            if verdict is Verdict.DOUBTFUL and error is None:
                self.stumble()
            elif not ended:
                ended.append((verdict, error))
                self._wake.set()
            elif error is not None:
                self.on_trouble(error)

        self.told = told
        if reached:
            ended.append((Verdict.REACHED, None))
        self._supervisor.follow(self._axis, course, told)
        while not ended:
            with anyio.move_on_after(over - self._bus.now()):
                await self._wake.wait()
            self._wake.clear()
            if end_it is not None and not ended and self._bus.now() >= over:
                over = math.inf
                await end_it()
                self._go_on(course, told, ended)
            if self._retargeting.change is not None and isinstance(course, MoveCourse) and not ended:
                changed = await self._retargeting.make(move, course)
                if changed and ended and ended[0][1] is None:
                    ended.clear()  # meanwhile it had arrived where it went before
                self._go_on(course, told, ended)
        verdict, error = ended[0]
        if error is not None:
            self.stumble()
            if verdict is Verdict.SILENT:
                standing = await self._stops.block("its drive stopped answering", until_standing=True)
                await self.knowledge.see_after_silence(heard=standing)
                if not standing:
                    raise MoveFailed(f"{error} {UNSEEN}") from error
            else:
                # One that was not seen to move may start after all.
                await self._carrier.stop_after(error, surely=not self._state.standstill.has_moved)
            raise error

    def _go_on(self, course: Course, told: Told, ended: Sequence[object]) -> None:
        """Look at it further, by what it was told since, unless it has ended meanwhile."""
        if not ended:
            self._supervisor.follow(self._axis, course, told)

    async def _stay(self, move: GroupMemberMove) -> None:
        """Stay where it has arrived until all have."""
        while not await move.all_arrived(_WATCH):
            with suppress(NoReply):
                await self.knowledge.afresh(Fact.POSITION)
            self.knowledge.check_reference()
        await move.ended()

    def was_stopped(self) -> None:
        """It is being stopped: it need not be where it was sent."""
        self.commanded = None
        self.stumble()

    def stumble(self) -> None:
        """What it carries out is about to fail. Others that depend on that are stopped, while it finds out why."""
        current = self._stops.queue.current
        if isinstance(current, GroupMemberMove):
            current.stumble()

    def on_trouble(self, error: MotionError, *, foreign: bool = False) -> None:
        """Something is wrong with an axis of which nobody waits for the end."""
        hard = not isinstance(error, LimitReached | NotEnabled)
        self._stops.fail_unawaited(f"motion of {self._name}", error, emergency=hard, foreign=foreign)

    def short(self, move: Move) -> str:
        """The name of a move, without that of the axis."""
        return move.what.removesuffix(f" of {self._name}")
