"""How one axis is stopped, and what becomes of what it was told to do."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from typing import Any

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle, settle
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.bus.units.motion import Motion
from rs485bus.errors import BusClosed, BusError, MotionError, MoveCancelled, NotSent, RearmRequired, StopUnconfirmed
from rs485bus.motion.command_queue import CommandQueue
from rs485bus.motion.group.member import GroupMemberMove
from rs485bus.motion.move import Move

_log = logging.getLogger("rs485bus")


class Halting(ABC):
    """One axis, as it is stopped. The owner does that, whatever becomes of who asked for it.

    Args:
        bus: the bus its drive is on.
        attached: its drive, as the bus knows it.
        motion: what of the drive it is.
        name: the axis, in messages.
    """

    def __init__(self, bus: Bus, attached: DeviceAdapter, motion: Motion, name: str) -> None:
        self.bus = bus
        self.attached = attached
        self.motion = motion
        self.name = name
        self._orders = CommandQueue(
            bus, name, self._forget_plans, lambda: self._begin_stop(emergency=True), self._after_failure
        )
        self._blocked = ""
        """Why it moves only after `enable()`."""
        self._running = False
        """It was told to keep a speed."""

    @abstractmethod
    def _forget(self) -> None:
        """Something happens to the axis: what was known of where it stands is over."""

    @abstractmethod
    def _forget_plans(self) -> None:
        """What is queued will not be carried out as it was planned."""

    @abstractmethod
    async def _is_seen_standing(self) -> bool:
        """Ask the drive whether the axis stands, once what was sent last would have set it in motion."""

    async def _after_failure(self, handle: Handle[Any]) -> None:
        """A command has failed. If it was to move the axis, see that it stands, or stop it: a drive that refuses a
        command may have begun it, and what it did before it goes on doing."""
        if not isinstance(handle, Move) or not self.motion.may_move or self._is_being_stopped():
            return
        self._stumble()
        try:
            standing = await self._is_seen_standing()
        except BusError:
            standing = False
        if not standing:
            self.stop_if_moving()

    def _halt(self, *, emergency: bool, motion: Motion | None = None) -> asyncio.Future[Halted]:
        """Have the owner stop it, or more than it. That happens whether the future is awaited or not."""
        self._stumble()
        halted: asyncio.Future[Halted] = asyncio.get_running_loop().create_future()
        self._forget()
        self._running = False
        motion = motion or self.motion
        self.bus.halt(self.attached, motion, emergency=emergency, told=lambda ended: settle(halted, ended))
        return halted

    def _stumble(self) -> None:
        """What it carries out is about to fail. Others that depend on that are stopped, while it finds out why."""
        if isinstance(self._orders.current, GroupMemberMove):
            self._orders.current.stumble()

    async def _halted(self, halted: asyncio.Future[Halted]) -> Halted:
        return await asyncio.shield(halted)

    async def _stand_still(self) -> None:
        """Stop what it was told before, with its ramp, and see it stand."""
        halted = await self._halted(self._halt(emergency=False))
        if not halted.standing:
            raise self._unconfirmed()

    def check_open(self) -> None:
        """Raise `BusClosed` if the bus is closed, and `WrongThread` for a call from another thread."""
        self.bus.check_thread()
        if self.bus.owner.gate.closed:
            raise BusClosed(f"{self.name}: the bus is closed.")

    def _stop_now(self, emergency: bool) -> Handle[None]:
        self.check_open()
        self._orders.interrupt(MoveCancelled(f"{self.name} was stopped."))
        return self._begin_stop(emergency=emergency)

    def _begin_stop(self, *, emergency: bool) -> Handle[None]:
        """Have the owner stop it; nothing else begins before it was seen standing."""
        handle: Handle[None] = Handle(f"stop of {self.name}", self.bus.unseen)

        def told(future: asyncio.Future[Halted]) -> None:
            if future.result().standing:
                handle.finish(None)
            else:
                handle.fail(self._unconfirmed())

        self._halt(emergency=emergency).add_done_callback(told)
        self._orders.hold(handle)
        return handle

    def _unconfirmed(self) -> StopUnconfirmed:
        self._blocked = "it was told to stop and could not be seen standing"
        away = "" if self.bus.connected else ": the port is gone, and it is stopped as soon as that is there again"
        return StopUnconfirmed(
            f"{self.name} was told to stop and could not be seen standing{away}. Look at the machine; use the "
            "hard-wired emergency stop. It moves only after enable()."
        )

    def give_up(self, handle: Handle[Any], error: Exception) -> None:
        """End a command, and what is queued behind it, because what it is a part of has ended. Nothing of it that is
        on its way to the drive is sent any more; `stop_if_moving` stops what was."""
        if self._orders.current is handle:
            self._orders.interrupt(error)
            self.motion.stop()
        else:
            self._orders.cut(handle, error)

    def stop_if_moving(self) -> None:
        """Stop it, where it may move and is not being stopped already."""
        if self.motion.may_move and self.bus.connected and not self._is_being_stopped():
            self._begin_stop(emergency=False)

    def _is_being_stopped(self) -> bool:
        halt = self.bus.owner.units[self.attached.address].halt
        return halt is not None and halt.motion in (self.motion, self.attached.motion)

    async def _block(self, why: str) -> None:
        """It is not known what the axis does: stop it, and let it move only after `enable()`."""
        self._blocked = why
        await self._halted(self._halt(emergency=True))

    def abandon(self, why: str) -> None:
        """End everything that is queued. For the bus."""
        self._orders.interrupt(MoveCancelled(f"{self.name}: {why}."))
        self._forget()

    def interrupted(self, error: MotionError | NotSent) -> None:
        """The bus stopped the axis for safety, or lost it. For the bus."""
        _log.warning("%s", error)
        self._orders.interrupt(error, MoveCancelled(f"Cancelled: {error}"))
        if self.motion.may_move:
            self._forget()  # else it stands where it stood, unless its drive restarts

    def _was_interrupted(self, unheard: float, reason: str) -> None:
        """The bus stopped the drive for safety, or lost it."""
        if self.bus.owner.units[self.attached.address].locked:
            self.interrupted(
                RearmRequired(f"{self.name} was unheard for {unheard:.2f} s ({reason}). It moves only after enable().")
            )
        else:
            self.interrupted(NotSent(f"{self.name}: {reason}. It is stopped as soon as the port is there again."))

    def _check_rearm(self) -> None:
        locked = self.bus.owner.units[self.attached.address].locked or self._blocked
        if locked:
            raise RearmRequired(f"{self.name} moves only after enable(): {locked}.")
