"""Sends a move that is under way elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.errors import MotionError, MoveCancelled, OutcomeUnknown, RequestFailed
from rs485bus.motion.carrier import PlanCarrier
from rs485bus.motion.courses import MoveCourse
from rs485bus.motion.drive import Drive
from rs485bus.motion.knowledge import AxisKnowledge
from rs485bus.motion.move import Move, Task
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.profile import seconds_to
from rs485bus.motion.state import FRESH, Fact


@dataclass(frozen=True, slots=True)
class Change:
    """Where a move under way is to go instead."""

    handle: Handle[None]
    position: float
    """In the axis' units."""
    target: int
    parameters: MotionParameters


class Retargeting:
    """Changes the target of the move under way of one axis; the newest change counts.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        axis: which one of the drive it is.
        name: names it in messages.
        knowledge: what is known of it.
        carrier: carries out its plans.
    """

    def __init__(
        self, bus: Bus, drive: Drive, axis: int, name: str, knowledge: AxisKnowledge, carrier: PlanCarrier
    ) -> None:
        self.change: Change | None = None
        """What is to be made of it, if something is."""
        self._bus = bus
        self._drive = drive
        self._axis = axis
        self._name = name
        self._knowledge = knowledge
        self._state = knowledge.state
        self._carrier = carrier

    def ask(self, change: Change) -> None:
        """Have the move under way sent elsewhere."""
        if self.change is not None:
            self.drop("another change of its target came first")
        self.change = change

    def drop(self, why: str) -> None:
        """What was asked for is not made."""
        change, self.change = self.change, None
        assert change is not None
        change.handle.fail(MoveCancelled(f"{self._name}: {why}."))

    async def make(self, move: Move, course: MoveCourse) -> bool:
        """Have the drive told what was asked for; whether it was. Raises what ends the move."""
        change, self.change = self.change, None
        assert change is not None
        try:
            return await self._send(move, course, change)
        except (RequestFailed, MotionError) as error:
            change.handle.fail(error)
            if not isinstance(error, RequestFailed) or isinstance(error, OutcomeUnknown):
                raise
            return False  # the move goes on to where it went
        except BaseException as error:
            change.handle.fail(MoveCancelled(f"{self._name}: its target was not changed ({error!r})."))
            raise

    async def _send(self, move: Move, course: MoveCourse, change: Change) -> bool:
        state, parameters = self._state, change.parameters
        await anyio.sleep(max(0.0, course.begun_at - self._bus.now()))
        if await self._knowledge.stands():
            # It has ended, or its drive has restarted: nothing may set it in motion again.
            change.handle.fail(MoveCancelled(f"{self._name} stood still before its target was changed."))
            return False
        await self._knowledge.see_restart()
        self._knowledge.check_reference()
        await self._knowledge.know((Fact.SPEED, Fact.POSITION), since=self._bus.now() - FRESH)
        speed, position = float(state.value(Fact.SPEED) or 0.0), state.value(Fact.POSITION)
        task = Task(move, start=position, target=change.target, before=speed, under_way=True)
        await self._carrier.carry(lambda: self._drive.retarget(self._axis, change.target, parameters, speed), task)
        sent_at = state.motion.commanded_at
        turns = state.rule.moved(position, change.target) / self._drive.ability(self._axis).counts_per_turn
        eta = sent_at + seconds_to(turns, parameters.rpm, parameters.acceleration, speed)
        course.change(change.target, eta, None)
        move.target, move.rpm, move.acceleration = change.position, parameters.rpm, parameters.acceleration
        move.eta = eta
        change.handle.finish(None)
        return True
