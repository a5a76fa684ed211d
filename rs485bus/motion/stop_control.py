"""How one axis is stopped, and what becomes of what it was told to do."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Sequence
from typing import Any

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle, settle
from rs485bus.bus.schedule.job import Urgency
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.units.motion import Motion
from rs485bus.errors import (
    BusClosed,
    BusError,
    EmergencyStopped,
    MotionError,
    MotionInterrupted,
    MoveCancelled,
    NotSent,
    RearmRequired,
    StopUnconfirmed,
)
from rs485bus.motion.command_queue import CommandQueue
from rs485bus.motion.diagnosis import is_stall_by_status
from rs485bus.motion.drive import Drive
from rs485bus.motion.events import EventKind
from rs485bus.motion.knowledge import AxisKnowledge
from rs485bus.motion.move import Move
from rs485bus.motion.state import Fact
from rs485bus.motion.supervisor import Supervisor

_STOPS = 3
_log = logging.getLogger("rs485bus")


class StopControl:
    """Stops one axis. The owner does that, whatever becomes of who asked for it.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        axis: which one of the drive it is.
        name: names it in messages.
        supervisor: what looks at the drive.
        on_plans_off: called when what is queued will not be carried out as it was planned.
        on_stop: called before it is stopped, whoever does it.
        tell: called with what happens to the axis.
        make_safe: as for `CommandQueue`.
    """

    def __init__(
        self,
        bus: Bus,
        drive: Drive,
        axis: int,
        name: str,
        supervisor: Supervisor,
        on_plans_off: Callable[[], None],
        on_stop: Callable[[], None],
        make_safe: Callable[[Handle[Any]], Awaitable[bool]],
        tell: Callable[[EventKind, str], None],
    ) -> None:
        self.queue = CommandQueue(bus, name, on_plans_off, self._stop_what_failed, make_safe)
        self.blocked = ""
        """Why it moves only after `enable()`."""
        self.others: Sequence[StopControl] = ()
        """Those of the drive's other axes, where a stop of one may stop them all."""
        self.is_failing = False
        """Something is wrong with what it carries out. That finds out what, and has the axis stand."""
        self.failure: Handle[Any] | None = None
        """The last failure of something that nobody waited for."""
        self.was_cut_off = False
        """The port was lost while it went on with something of which nobody waited for the end; nobody was told."""
        self._bus = bus
        self._drive = drive
        self._axis = axis
        self._name = name
        self._motion = drive.state.axes[axis].motion
        self._supervisor = supervisor
        self.tell = tell
        self._on_stop = on_stop
        # What confirms a stop goes out over noise, too.
        self._knowledge = AxisKnowledge(bus, drive, axis, name, supervisor.questions, Urgency.CONFIRM)

    # What users ask for

    def stop_now(self, *, emergency: bool) -> Handle[None]:
        """Drop what is queued, and stop."""
        self.check_open()
        self.was_cut_off = False  # it was not to go on
        self.queue.interrupt(MoveCancelled(f"{self._name} was stopped."))
        return self.begin_stop(emergency=emergency)

    def begin_stop(self, *, emergency: bool, why: MotionError | None = None, for_group: bool = False) -> Handle[None]:
        """Stop; nothing else begins before it was seen standing. `why`: what is wrong, if something is. `for_group`:
        because of another axis of its group, which may be one that is stopped with it, and tells itself what is wrong.
        """
        handle: Handle[None] = Handle(f"stop of {self._name}", self._bus.unseen)
        if self.queue.current is None:
            self._supervisor.leave(self._axis)  # else who carries that out finds out why it has ended

        def told(future: asyncio.Future[Halted]) -> None:
            if not future.result().standing:
                handle.fail(self.unconfirmed())
                self.tell(EventKind.FAILED, str(handle.error))
            elif self._bus.closing:
                self._ended(handle)
            else:
                self._bus.spawn(self._see_it_stay(handle), f"rs485bus {handle.what}")

        self._halt(emergency=emergency, why=why, for_group=for_group).add_done_callback(told)
        for each in (self, *self._taken_along(emergency)):
            each.queue.hold(handle)
        return handle

    async def _see_it_stay(self, handle: Handle[None]) -> None:
        """See it stand by its positions, too: where many are stopped at once the owner goes by a status, which has been
        seen to lie."""
        told = self._motion.commanded_at
        try:
            for _ in range(_STOPS):
                if self.is_stopping or self._motion.commanded_at != told:
                    return
                if await self._knowledge.stands():
                    self._drive.state.axes[self._axis].stood()
                    return
                if not (await asyncio.shield(self._halt(emergency=True))).standing:
                    break
            handle.fail(self.unconfirmed())
            self.tell(EventKind.FAILED, str(handle.error))
        except BusError:
            pass  # nobody can be asked any more
        finally:
            if not handle.done():
                self._ended(handle)

    def _ended(self, handle: Handle[None]) -> None:
        handle.finish(None)
        self.tell(EventKind.STOP, "it was stopped, and stands")

    def check_open(self) -> None:
        """Raise `BusClosed` if the bus is closed, and `WrongThread` for a call from another thread."""
        self._bus.check_thread()
        if self._bus.owner.gate.closed:
            raise BusClosed(f"{self._name}: the bus is closed.")

    def check_ready(self) -> None:
        """Raise what keeps the axis from taking another command."""
        self.check_open()
        if self._bus.closing:
            raise BusClosed(f"{self._name}: the bus is being closed. Nothing is set in motion any more.")
        if not self._bus.connected:
            turned = " It turned, and is stopped as soon as the port is there again." if self.was_cut_off else ""
            self.was_cut_off = False
            raise NotSent(
                f"{self._name}: the port is lost. What is asked for now would happen whenever it is there again: wait "
                f"for bus.connected, then ask again.{turned}"
            )
        if self._bus.latched:
            raise EmergencyStopped(
                f"{self._name}: the bus is latched by an emergency stop. clear_emergency_stop(), then enable() the "
                "axis."
            )
        self.queue.check()

    def check_rearm(self) -> None:
        """Raise `RearmRequired` where it must be enabled first."""
        why = self._bus.owner.units[self._drive.address].locked or self.blocked
        if why:
            raise RearmRequired(f"{self._name} moves only after {self._remedy}: {why}.")

    def forgive(self) -> None:
        """Take commands again, whatever has failed that nobody has seen."""
        self.was_cut_off = False
        self.queue.forgive()

    def check_cut_off(self) -> None:
        """Raise `MotionInterrupted`, once, where the loss of the port has ended what it went on with."""
        if self.was_cut_off:
            self.was_cut_off = False
            raise MotionInterrupted(
                f"{self._name}: the port was lost while it turned, and it was stopped when that was there again. This "
                "command was not begun: see where the axis stands, then ask again."
            )

    @property
    def _remedy(self) -> str:
        """After what it moves again."""
        return "renew()" if self._bus.owner.units[self._drive.address].stood and not self.blocked else "enable()"

    def _stop_what_failed(self) -> None:
        if self._motion.may_move:
            self.begin_stop(emergency=True)

    # What its commands need

    async def stand_still(
        self, *, emergency: bool = False, motion: Motion | None = None, why: MotionError | None = None
    ) -> None:
        """Stop what it was told before, and see it stand. Raises `StopUnconfirmed`.

        Args:
            emergency: as fast as the drive can.
            motion: what is stopped, where that is known to be more than what a stop of this axis stops.
            why: what is wrong, if something is.
        """
        self._supervisor.leave(self._axis)
        halted = await asyncio.shield(self._halt(emergency=emergency, motion=motion, why=why))
        if not halted.standing:
            raise self.unconfirmed()

    async def stopped(self) -> None:
        """Wait for the end of a stop that is under way, whoever asked for it. Raises `StopUnconfirmed`."""
        if not await self.queue.held():
            raise self.unconfirmed()
        halt = self._bus.owner.units[self._drive.address].halt
        if halt is not None and self.is_stopping:
            halted: asyncio.Future[Halted] = asyncio.get_running_loop().create_future()
            halt.listen(lambda ended: settle(halted, ended))
            if not (await halted).standing:
                raise self.unconfirmed()

    async def block(self, why: str, *, until_standing: bool = False) -> bool:
        """Nobody knows what the axis does: stop it, and let it move only after `enable()`; or, where it must be known
        but that it stands, where it was not seen standing. Whether it was."""
        self.blocked = why
        self._supervisor.leave(self._axis)
        halted = await asyncio.shield(self._halt(emergency=True))
        if until_standing and halted.standing:
            self.blocked = ""
        return halted.standing

    def unconfirmed(self) -> StopUnconfirmed:
        """It was stopped, and not seen standing."""
        self.blocked = "it was told to stop and could not be seen standing"
        away = "" if self._bus.connected else ": the port is gone, and it is stopped as soon as that is there again"
        return StopUnconfirmed(
            f"{self._name} was told to stop and could not be seen standing{away}. Look at the machine; use the "
            "hard-wired emergency stop. It moves only after enable()."
        )

    @property
    def is_stopping(self) -> bool:
        """Whether it is being stopped."""
        return self.is_stopping_all(self._motion)

    def is_stopping_all(self, motion: Motion) -> bool:
        """Whether all of a motion of its drive is being stopped."""
        halt = self._bus.owner.units[self._drive.address].halt
        return halt is not None and halt.motion in (motion, self._drive.motion)

    def fail_unawaited(self, what: str, error: MotionError, *, emergency: bool, foreign: bool) -> None:
        """Something is wrong with an axis of which nobody waits for the end. It is stopped; who gives the next command
        is told, and whoever leaves the block of the bus. `foreign`: nobody here began what it did."""
        _log.warning("%s", error)
        # Of a failure that is told of several axes of a drive, who has seen one has seen all.
        told = next((other.failure for other in self.others if other.failure and not other.failure.seen), None)
        failure = self.failure = told or Handle(what, self._bus.unseen)
        kept = [other for other in self._taken_along(emergency) if other.keeps]
        by_status = is_stall_by_status(self._drive, self._axis, error)
        stop = self.begin_stop(emergency=emergency, why=error)
        if by_status:
            stop.add_done_callback(lambda _: self._reconsider(stop, failure, error if foreign else None))
        self.queue.fail(failure, error)
        for other in kept:
            other.queue.fail(failure, error)  # who sees it once has seen it

    def _reconsider(self, stop: Handle[None], failure: Handle[Any], untold: MotionError | None) -> None:
        """A shaft was taken for held, by a status that says that the motor is driven. Where that says so after a stop,
        too, it is stuck: nothing was wrong. Else it is told what is, where that was not told yet."""
        state = self._drive.state.axes[self._axis]
        stuck = stop.error is None and state.value(Fact.PUSHES) and state.standstill.unmoved
        if untold is not None and not stuck:
            self.tell(EventKind.STALL, str(untold))
        if stuck and self.failure is failure:
            what = "its status goes on saying that it is driven, after a stop, and it stands: that status is stuck"
            _log.warning("%s: %s", self._name, what)
            self.tell(EventKind.STOP, what)
            failure.seen = True
            self.queue.forgive()

    # What its group needs

    @property
    def condition(self) -> str:
        """How it was just now, in words: that it stood only where it was seen to."""
        state, halt = self._drive.state.axes[self._axis], self._bus.owner.units[self._drive.address].halt
        if not self._motion.may_move:
            return "stood" if state.stands or state.stood_at is not None else "was not told to move"
        if not self._bus.connected:
            return "might turn, with its port away, and is stopped as soon as that is there again"
        if halt is not None and self.is_stopping and not halt.failed:
            return "was being stopped"
        return "was told to stop and could not be seen standing" if self.blocked else "might turn"

    def give_up(self, handle: Handle[Any], error: Exception) -> None:
        """End a command, and what is queued behind it, because what it is a part of has ended. Nothing of it that is
        on its way to the drive is sent any more; `stop_if_moving` stops what was."""
        if self.queue.current is handle:
            self.queue.interrupt(error)
            self._motion.stop()
        else:
            self.queue.cut(handle, error)

    def stop_if_moving(self) -> None:
        """Stop it, where it may move and is not being stopped already."""
        if self._motion.may_move and self._bus.connected and not self.is_stopping:
            self.begin_stop(emergency=False, for_group=True)

    # What the bus tells

    def abandon(self, why: str) -> None:
        """The bus stops it, for that reason."""
        self.queue.interrupt(MoveCancelled(f"{self._name}: {why}."))
        self._on_stop()

    def interrupted(self, unheard: float, reason: str) -> None:
        """The bus stopped it for safety, or lost it. It had been unheard for so many seconds."""
        told = f"{self._name}: {reason}. It is stopped as soon as the port is there again."
        error: MotionError | NotSent = NotSent(told)
        current = self.queue.current
        begun = isinstance(current, Move) and current.started_at is not None  # it stands already, perhaps
        if self._motion.may_move or begun:
            error = MotionInterrupted(f"{told} How far it went is not known until then.")
        if self._bus.owner.units[self._drive.address].locked:
            why = f" was unheard for {unheard:.2f} s ({reason})" if unheard else f": {reason}"
            error = RearmRequired(f"{self._name}{why}. It moves only after {self._remedy}.")
        course = self._supervisor.course(self._axis)
        keeps = current is None and course is not None and course.keeps and self._motion.may_move
        self.was_cut_off = self.was_cut_off or (keeps and isinstance(error, NotSent))
        _log.warning("%s", error)
        self.tell(EventKind.LOST if isinstance(error, NotSent) else EventKind.TRIP, str(error))
        self.queue.interrupt(error, MoveCancelled(f"Cancelled: {error}"))

    @property
    def keeps(self) -> bool:
        """Whether it goes on with something of which nobody waits for the end."""
        return self.queue.current is None and self._motion.may_move

    def _taken_along(self, emergency: bool) -> Sequence[StopControl]:
        """Those of the axes that a stop of this one stops, too."""
        return self.others if self._stopped_with(emergency) is not self._motion else ()

    def _stopped_with(self, emergency: bool) -> Motion:
        """What a stop of this axis stops; all of its drive, where that cannot be told."""
        try:
            return self._drive.stopped_with(self._axis, emergency)
        except Exception:
            _log.exception("%s: it cannot be told what is stopped with it", self._name)
            return self._drive.motion

    def _take_along(self, why: MotionError) -> None:
        """It is stopped, because another one is with which it is stopped."""
        kept = self.keeps
        self.queue.interrupt(why)
        if kept and not isinstance(why, MoveCancelled):
            self.queue.fail(Handle(f"motion of {self._name}"), why)  # whoever commands it next is told
        self._supervisor.leave(self._axis)
        self._on_stop()

    def _halt(
        self, *, emergency: bool, motion: Motion | None = None, why: MotionError | None = None, for_group: bool = False
    ) -> asyncio.Future[Halted]:
        """Have the owner stop it, or more than it. That happens whether the future is awaited or not."""
        self._on_stop()
        halted: asyncio.Future[Halted] = asyncio.get_running_loop().create_future()
        if self._bus.closed:
            halted.set_result(Halted(self._drive.address, self._drive.family, False, 0))
            return halted
        if motion is None:
            motion, joint = self._stopped_with(emergency), self.queue.joint
            stopped = MoveCancelled(f"{self._name} was stopped, and what moves with it.")
            for other in self._taken_along(emergency):
                together = joint is not None and other.queue.joint is joint
                # Else they stand still before what they do together, or it is the one because of which all stop.
                if not together and not (for_group and other.is_failing):
                    other._take_along(why or stopped)
        # Whoever asks for a stop may know of a motion that is not known here.
        motion.moves()
        self._bus.halt(self._drive, motion, emergency=emergency, told=lambda ended: settle(halted, ended))
        return halted
