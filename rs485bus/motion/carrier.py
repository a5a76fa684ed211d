"""Carries out plans: each step with its repeat rule, a start exactly once. No error leaves the motor going."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.bus.schedule.repeating import pause_of
from rs485bus.bus.units.motion import Motion
from rs485bus.errors import (
    BusError,
    DeviceOffline,
    DeviceRefused,
    DriveFault,
    MotionError,
    MotorStalled,
    MoveFailed,
    NoReply,
    NotStanding,
    OutcomeUnknown,
    RequestFailed,
    StopUnconfirmed,
)
from rs485bus.motion.diagnosis import not_seen_standing
from rs485bus.motion.drive import Drive
from rs485bus.motion.knowledge import AxisKnowledge
from rs485bus.motion.look_budget import SILENT
from rs485bus.motion.move import Task
from rs485bus.motion.plan import (
    AnswersAgain,
    Ask,
    Ended,
    KeepFed,
    Know,
    MustStand,
    OthersStand,
    Pause,
    Plan,
    Stand,
    Start,
    Step,
)
from rs485bus.motion.profile import is_speed
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import Fact
from rs485bus.motion.stop_control import StopControl
from rs485bus.motion.supervisor import Supervisor
from rs485bus.motion.upkeep import answers_again, ask, keep_fed, others_stand
from rs485bus.wire.exceptions import is_busy
from rs485bus.wire.registers import Repeat

T = TypeVar("T")

_log = logging.getLogger("rs485bus")

_ATTEMPTS = 3
_PATIENCE = 2.0
"""Seconds in which a drive may answer again that did not say whether it took a move."""
_ASK_AGAIN = 0.02
_TOO_SHORT = 4
"""A way of less than so many times what a standing axis may seem to move is not to be seen."""


class _NotTaken(Exception):
    """A start was lost on its way, as was seen."""

    def __init__(self, unknown: OutcomeUnknown) -> None:
        super().__init__(str(unknown))
        self.unknown = unknown


class PlanCarrier:
    """Carries out the plans of one axis.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        axis: which one of the drive it is.
        name: names it in messages.
        knowledge: what is known of it.
        stops: stops it.
        supervisor: looks at it.
        stumble: called when what it carries out is about to fail, before it is found out why.
    """

    def __init__(
        self,
        bus: Bus,
        drive: Drive,
        axis: int,
        name: str,
        knowledge: AxisKnowledge,
        stops: StopControl,
        supervisor: Supervisor,
        stumble: Callable[[], None],
    ) -> None:
        self._bus = bus
        self._drive = drive
        self._axis = axis
        self._name = name
        self._knowledge = knowledge
        self._state = knowledge.state
        self._stops = stops
        self._supervisor = supervisor
        self._stumble = stumble

    async def carry(self, make: Callable[[], Plan[T]], task: Task | None = None) -> T:
        """Carry out a plan. Where its start is seen to have been lost, or it is not known whether the drive was told
        all that comes before that, it is carried out once more from its beginning."""
        lost = 0
        while True:
            try:
                async with self._supervisor.plans:
                    return await self._walk(make(), task)
            except _NotTaken as not_taken:
                assert task is not None
                lost += 1
                if lost == _ATTEMPTS:
                    await self._give_up(not_taken.unknown, task)
                    raise not_taken.unknown from None
                task.slot = None  # only the first attempt goes out with the others
            except BusError as error:
                if task is None or task.begun or not isinstance(error, OutcomeUnknown):
                    refused = isinstance(error, DeviceRefused)
                    if task is not None and task.begun and not (task.under_way and refused):
                        await self.stop_after(error)
                    raise
                lost += 1
                if lost == _ATTEMPTS:
                    raise MoveFailed(f"{self._name} could not be told its move: {error}") from error

    async def stop_after(self, error: BusError, *, surely: bool = False) -> None:
        """See that an axis stands whose command has failed; `surely` where it may start yet, though it stands.

        Raises:
            MotionError: it was not seen standing, either: what is wrong with it is said first, where that is known.
        """
        self._stumble()
        hard = isinstance(error, DriveFault | MotorStalled)
        if not self._state.motion.may_move or self._stops.blocked or self._stops.is_stopping:
            self._supervisor.leave(self._axis)
        elif (hard or surely or not await self.is_seen_standing()) and self._bus.connected:
            try:
                await self._stops.stand_still(emergency=hard, why=error if isinstance(error, DriveFault) else None)
            except StopUnconfirmed as unconfirmed:
                raise not_seen_standing(unconfirmed, error) from error

    async def is_seen_standing(self) -> bool:
        """Whether the axis stands, once what was sent last would have set it in motion. On a pair that is never quiet
        that is not waited for: it is stopped at once."""
        if self._bus.owner.pair.was_noisy(self._bus.now()):
            return False
        state = self._state
        settled = state.motion.commanded_at + self._drive.start_grace
        self._supervisor.begin(self._axis)
        try:
            await anyio.sleep(max(0.0, settled - self._bus.now()))
            stands = await self._knowledge.stands() and state.standstill.confirmed
        except BusError:
            stands = False
        except Exception:
            _log.exception("%s: it cannot be judged whether it stands", self._name)
            stands = False
        self._supervisor.leave(self._axis)
        if not stands or state.standstill.until < settled or state.value(Fact.STALLED):
            return False
        state.stood()
        return True

    # Steps

    async def _walk(self, plan: Plan[T], task: Task | None) -> T:
        to_start = () if task is None else ((self, task), *task.partners)
        try:
            step = next(plan)
            while True:
                for carrier, each in to_start:
                    # Before the next step hides that: what it writes may be what a restart would have erased.
                    await carrier._knowledge.see_silence(by_reference=each.target is not None)
                to_start = () if isinstance(step, Start) else to_start
                try:
                    outcome = await self._do(step, task)
                except (RequestFailed, MotionError) as error:
                    step = plan.throw(error)
                else:
                    step = plan.send(outcome)
        except StopIteration as end:
            result: T = end.value
            return result
        finally:
            plan.close()

    async def _do(self, step: Step, task: Task | None) -> Any:
        """Carry out one step; what comes of it."""
        if isinstance(step, Ask):
            motion = self._state.motion if task is not None or step.turns else None
            return await ask(self._bus, self._supervisor, self._axis, step, motion)
        if isinstance(step, Know):
            return await self._knowledge.know(step.facts, since=self._bus.now() if step.afresh else None)
        if isinstance(step, Start):
            assert task is not None
            return await self._start(step, task)
        if isinstance(step, Ended):
            assert task is not None
            assert task.ended is not None
            return await task.ended(step)
        if isinstance(step, Stand):
            return await self._stand(step, task)
        if isinstance(step, OthersStand):
            return await self._others_stand(task)
        if isinstance(step, KeepFed):
            return await keep_fed(self._bus, self._drive, step)
        if isinstance(step, MustStand):
            return await self._check_standing(step)
        if isinstance(step, AnswersAgain):
            return await answers_again(self._bus, self._supervisor, self._axis, step)
        assert isinstance(step, Pause)
        return await anyio.sleep(step.seconds)

    async def have_it_stand(self) -> None:
        """Stop it where it moves."""
        if self._state.motion.may_move or not await self._knowledge.stands():
            await self._stops.stand_still()

    async def _stand(self, step: Stand, task: Task | None) -> None:
        if step.surely or (step.whole and self._drive.motion.may_move):
            await self._stops.stand_still(motion=self._drive.motion if step.whole else None)
        for carrier, each in self._all(task):
            await carrier.have_it_stand()
            if each is not None:
                # It begins here: what it went before is no sign that the start was taken.
                each.before, each.start = 0.0, carrier._state.value(Fact.POSITION)

    def _all(self, task: Task | None) -> Sequence[tuple[PlanCarrier, Task | None]]:
        """Those whom a plan sets in motion."""
        return ((self, task), *(() if task is None else task.partners))

    async def _others_stand(self, task: Task | None) -> None:
        mine = {carrier._axis for carrier, _ in self._all(task)}
        others = [state.motion for axis, state in enumerate(self._drive.state.axes) if axis not in mine]
        await others_stand(self._bus, self._name, others, self._stops.others, self._supervisor.plans)

    async def _check_standing(self, step: MustStand) -> None:
        if not await self._knowledge.stands():
            raise NotStanding(
                f"{self._name} turns, and must stand for this: {step.what}. stop() it first. Nothing was sent."
            )

    # Starts

    async def _start(self, step: Start, task: Task) -> bytes:
        """Send the start, and know whether the drive took it."""
        everybody = ((self, task), *task.partners)
        began = self._bus.now()
        for carrier, each in everybody:
            carrier._state.ramp_stop, carrier._state.ramp_takes = step.stop, step.stopping
            carrier._state.told_at = NEVER
            self._supervisor.begin(carrier._axis)
            each.begun, each.lost = True, carrier._state.lost
            each.move.started_at = began if each.since is None else each.since
        motion = self._state.motion if not task.partners else self._drive.motion
        # One that turns is not left alone for longer than any that turns: a drive that does not answer is stopped.
        patience = max(1.0, SILENT * self._supervisor.interval)
        timeout = patience if step.repeat is Repeat.SAFE and any(each.before for _, each in everybody) else None
        try:
            return await self._say_start(step, everybody, motion, task.slot, timeout)
        except (OutcomeUnknown, NoReply) as unknown:
            await self._settle(step, task, _as_unknown(unknown))
            return b""
        finally:
            for carrier, each in everybody:
                sent_at = carrier._state.motion.commanded_at
                each.move.started_at = sent_at if each.since is None and sent_at >= began else each.since

    async def _say_start(
        self,
        step: Start,
        everybody: Sequence[tuple[PlanCarrier, Task]],
        motion: Motion,
        slot: BurstSlot | None,
        timeout: float | None,
    ) -> bytes:
        """Send the start. A drive that is busy may restart meanwhile: it is not said again before that is known."""
        repeat = Repeat.NEVER if step.repeat is Repeat.VERIFY else step.repeat
        again = repeat is not Repeat.SAFE and slot is None  # else the owner does, or others wait for it
        epoch, busy = motion.epoch, 0
        while True:
            try:
                return await self._bus.ask(
                    step.request, repeat=repeat, moves=True, motion=motion, slot=slot, timeout=timeout
                )
            except DeviceRefused as error:
                busy += 1
                if not (again and is_busy(error.code) and busy <= self._bus.config.retries):
                    raise
                refused = error
            await anyio.sleep(pause_of(busy))
            for carrier, each in everybody:
                stood_at = None if each.before or each.under_way else each.start
                await carrier._knowledge.see_put_off(stood_at, each.target)
            if motion.epoch != epoch:
                raise refused  # it was stopped meanwhile

    async def _settle(self, step: Start, task: Task, unknown: OutcomeUnknown) -> None:
        """See whether a start was taken whose answer was lost. Raises `_NotTaken` if it was not."""
        state = self._state
        try:
            for carrier, each in ((self, task), *task.partners):
                await carrier._ask_after(step, each)
            # All are asked: each may find that its drive has restarted.
            taken = True in {carrier._was_taken(step, each) for carrier, each in ((self, task), *task.partners)}
        except RequestFailed as error:
            self._stumble()
            if isinstance(error, NoReply | DeviceOffline) and not self._drive.tells_restarts:
                state.suspect("its drive did not say whether it took its last move, and may have restarted.")
            if task.start is not None:
                state.between = (task.start, task.target)
            await self._stops.block(f"nobody knows whether {task.move.what} started ({unknown})")
            raise unknown from None
        if not taken:
            raise _NotTaken(unknown) from None

    async def _ask_after(self, step: Start, task: Task) -> None:
        """Ask for all that shows whether a start was taken, once it has had its time to show."""
        state = self._state
        speed = () if task.rpm is None else (Fact.SPEED,)
        shows_at = state.motion.commanded_at + self._drive.start_grace + step.shows_after
        await anyio.sleep(max(0.0, shows_at - self._bus.now()))
        # What may be repeated was repeated meanwhile.
        patience = self._bus.now() + (0.0 if task.before and step.repeat is Repeat.SAFE else _PATIENCE)
        while True:
            try:
                facts = (*self._drive.marks(self._axis), *step.signs, *speed)
                await self._knowledge.know(facts, since=state.motion.commanded_at)
                await self._knowledge.stands()
                return
            except NoReply:
                # A drive that restarts is away for a moment; what it says then tells that it did. But others that have
                # started with it do not go on alone.
                if self._bus.now() > patience or task.slot is not None:
                    raise
                await anyio.sleep(_ASK_AGAIN)

    def _was_taken(self, step: Start, task: Task) -> bool:
        """Whether what was asked shows that a start was taken.

        Raises:
            ReferenceLost: the drive has restarted.
            OutcomeUnknown: nobody can tell, and it must not be said again.
        """
        state = self._state
        self._knowledge.notice_restart()
        gone = 0 if task.start is None else state.rule.moved(task.start, state.value(Fact.POSITION))
        if task.before and gone * task.before < 0 and abs(gone) > state.jump:
            state.suspect("it is behind where it turned: the drive may have restarted.")
        if state.lost and (state.lost != task.lost or task.target is not None):
            self._knowledge.check_reference()
        if step.taken is not None and step.taken():
            return True
        if task.rpm == 0:
            return state.stands is True
        if not state.stands:
            return is_speed(state.value(Fact.SPEED), task.rpm) if task.before and task.rpm else not task.under_way
        if task.under_way and task.target is not None:
            there = state.rule.moved(task.target, state.value(Fact.POSITION))
            if abs(there) <= state.jump:
                return True  # it has gone there meanwhile
        if task.before or task.under_way:
            raise OutcomeUnknown(f"{self._name} stands, though it turned when it was told something else.")
        short = task.target is not None and abs(task.target - (task.start or 0)) <= _TOO_SHORT * state.rule.same
        if step.once and short:
            raise OutcomeUnknown(f"{self._name}: a move so short is not to be seen in its position.")
        return task.start is not None and abs(gone) > state.rule.same

    async def _give_up(self, unknown: OutcomeUnknown, task: Task) -> None:
        """A start was lost again and again."""
        if task.before or task.under_way:
            await self._stops.block(f"nobody knows what it does now ({unknown})")
        else:
            await self.stop_after(unknown)


def _as_unknown(error: OutcomeUnknown | NoReply) -> OutcomeUnknown:
    """Nobody knows what became of a start, be it one that may be repeated."""
    if isinstance(error, OutcomeUnknown):
        return error
    return OutcomeUnknown(str(error), address=error.address, request=error.request, attempts=error.attempts)
