"""An axis on its way: how it is looked at until it has arrived, and what is known of where it stands.

Positions here are counts of the drive. A jump that cannot be explained (a drive that restarted counts from zero) ends
the trust in them.
"""

from __future__ import annotations

import asyncio
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import anyio

from rs485bus.bus.bus import Bus
from rs485bus.bus.schedule.job import Urgency
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.halting import Halting
from rs485bus.errors import DeviceOffline, MoveFailed, MoveTimeout, NoReply, ReferenceLost
from rs485bus.motion.group.member import GroupMemberMove
from rs485bus.motion.move import Move

FRESH = 0.25
"""Seconds for which what was seen of a standing axis is taken to hold."""
_POLL_SHORTEST, _POLL_LONGEST = 0.01, 0.05
_WATCH = 0.06
"""Seconds between two looks at an axis on which others depend."""


@dataclass(frozen=True, slots=True)
class Look:
    """What a drive said of its axis."""

    at: float
    """When it was asked, on the event loop's clock."""
    position: int
    moving: bool
    enabled: bool


class Travel(Halting):
    """One axis, as it is looked at. Arguments as for `Conduct`."""

    counts_per_turn: int
    tells_restarts = False
    """Whether a restart of the drive is noticed by what it says afterwards, not by its position alone."""

    def __init__(self, bus: Bus, attached: DeviceAdapter, motion: Motion, name: str, tolerance: int) -> None:
        super().__init__(bus, attached, motion, name)
        self.tolerance = tolerance
        self._commanded: int | None = None
        """The target of the last move, if it was reached and nothing happened since."""
        self._seen: Look | None = None
        """How it was last seen standing, if nothing happened since."""
        self._enabled: bool | None = None
        self._lost = ""
        """Why its positions are not to be trusted."""
        self._between: tuple[int, int] | None = None
        """From where to where a move went of which nobody knows what became."""
        self._way = (0, 0)
        """From where to where the move under way goes, in counts."""
        self._stands = asyncio.Event()

    # What families do

    @abstractmethod
    async def _look(self, *, quick: bool = False) -> Look:
        """Ask the drive where the axis is, whether it moves and, unless it is to be `quick`, whether it is enabled."""

    async def _seems_to_move(self, rpm: float) -> bool:
        """Whether it moves as it should, with a speed given, as far as can be told at little cost."""
        return (await self._look(quick=True)).moving

    async def _meanwhile(self, move: Move) -> None:
        """Called during a move each time before the axis is looked at."""

    # Under way

    async def _arrive(self, move: Move, arrived: Callable[[Look], bool]) -> Look:
        """Wait until the motor stands; look when it should, not all the time."""
        assert move.started_at is not None
        assert move.eta is not None
        pause = min(max((move.eta - move.started_at) / 50, _POLL_SHORTEST), _POLL_LONGEST)
        self._stands.clear()
        while True:
            answers = True
            with anyio.move_on_after(max(0.0, move.eta - self.bus.now())):
                if isinstance(move, GroupMemberMove):
                    answers = await self._watch(move)
                else:
                    await self._stands.wait()
            if not answers:
                raise await self._fell_silent(move)
            self._stands.clear()
            await self._meanwhile(move)
            asked = self.bus.now()
            look = await self._look_during(move)
            grace = self.attached.may_start_until(self.motion)
            if look is None or self._keeps_up(move, look):
                pass  # so slow that it may seem to stand
            elif not look.moving and (arrived(look) or look.at > grace):
                self.motion.stands(look.at)
                return look
            # On a full or bad line an answer takes a while, and says nothing of the time in which it was waited for.
            if asked > 2 * move.eta - move.started_at + 1:
                raise self._too_late(move)
            await anyio.sleep(pause)

    async def _look_during(self, move: Move) -> Look | None:
        """How it is in the middle of a move; None if it did not answer. Raises `MoveFailed` if it does not any more."""
        try:
            return await self._look(quick=True)
        except NoReply:
            return None
        except DeviceOffline as error:
            raise await self._fell_silent(move) from error

    async def _fell_silent(self, move: Move) -> MoveFailed:
        """Its drive does not answer any more."""
        self._suspect("its drive stopped answering and may have restarted.")
        await self._block(f"its drive stopped answering during {move.what}")
        return MoveFailed(f"{self.name} stopped answering during {move.what}.")

    async def _answers(self) -> bool:
        """Whether its drive answers to something that need not wait for the late answer to something else."""
        late = self.bus.owner.units[self.attached.address].late
        reads = self.attached.reads()
        request = next((read for read in reads if not late.must_wait(read)), reads[0])
        try:
            await self.bus.ask(request, urgency=Urgency.POLL)
        except (NoReply, DeviceOffline):
            return False
        return True

    async def _watch(self, move: GroupMemberMove) -> bool:
        """Look often at an axis that others depend on, as long as it moves as it should. False if it does not answer
        any more."""
        assert move.rpm is not None
        while not self._stands.is_set():
            with anyio.move_on_after(_WATCH):
                await self._stands.wait()
            try:
                if not await self._seems_to_move(move.rpm):
                    return True
            except (NoReply, DeviceOffline):
                if not await self._answers():
                    return False
        return True

    def _keeps_up(self, move: Move, look: Look) -> bool:
        """Whether an axis that others depend on is on its way, and where it should be by now."""
        if not isinstance(move, GroupMemberMove) or move.profile is None or self._near(look.position, self._way[1]):
            return False
        assert move.started_at is not None
        assert move.eta is not None
        expected = move.profile.turns_after(look.at - move.started_at - self.attached.start_grace)
        gone = abs(look.position - self._way[0])
        return look.at < move.eta and gone + self.tolerance >= expected * self.counts_per_turn

    async def _stay(self, move: GroupMemberMove, arrived: Look) -> None:
        """Stay where it has arrived until all have."""
        while not await move.all_arrived(_WATCH):
            look = await self._look_during(move)
            if look is not None:
                self._check_reference(look, arrived)
                self._seen = look
        await move.ended()

    def _too_late(self, move: Move) -> MoveTimeout:
        self._begin_stop(emergency=False)
        return MoveTimeout(f"{self.name}: {move.what} takes more than twice its time, and a second. It was stopped.")

    # What is known

    def _suspect(self, why: str) -> None:
        """The drive may have restarted unseen: its positions are not to be trusted, unless it would tell."""
        if not self.tells_restarts:
            self._lost = why

    def _check_reference(self, look: Look, seen: Look | None) -> None:
        """Notice what cannot be explained since the axis was last seen standing."""
        if self._enabled and not look.enabled:
            self._lost = "its motor is not enabled any more, and nobody disabled it: the drive may have restarted."
        elif seen is not None and not self._near(seen.position, look.position):
            self._lost = (
                f"it stands {look.position - seen.position} counts from where it stood, and nobody moved it: "
                "the drive may have restarted."
            )
        else:
            return
        self.bus.owner.stops.restarted(self.bus.owner.units[self.attached.address])
        self._enabled = look.enabled
        self._forget()
        raise ReferenceLost(f"{self.name}: {self._lost} home() it or set_zero() first.")

    def _check_arrival(self, move: Move) -> None:
        """Notice that it was just seen at its target sooner than it can have gone there."""
        assert move.started_at is not None
        assert move.eta is not None
        # When it was asked tells nothing of how long that took: the answer may have been lost, or waited for the wire.
        if self.bus.now() - move.started_at < (move.eta - move.started_at) / 2 - FRESH:
            self._lost = "it was at its target sooner than it can have gone there: the drive may have restarted."
            raise ReferenceLost(f"{self.name}: {self._lost} home() it or set_zero() first.")

    def told_standing(self) -> None:
        """The drive said, unasked by the axis, that it stands: worth a look."""
        self._stands.set()

    def _forget(self) -> None:
        """Something happens to the axis: what was known of where it stands is over."""
        self._commanded = None
        self._seen = None

    def _near(self, a: int, b: int) -> bool:
        return abs(a - b) <= self.tolerance
