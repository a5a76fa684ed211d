"""How the moves of one axis are carried out, exactly once. What families differ in is left to them.

Positions here are counts of the drive. Before a move, and before its repetition, position and enable state are known;
a jump that cannot be explained (a drive that restarted counts from zero) ends the trust in positions.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Awaitable, Callable

import anyio

from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.bus.watchdog.guard import admit_and_arm
from rs485bus.devices.travel import FRESH, Look, Travel
from rs485bus.errors import (
    DeviceOffline,
    MotionError,
    MoveFailed,
    NoReply,
    NotEnabled,
    OutcomeUnknown,
    RearmRequired,
    ReferenceLost,
    RequestFailed,
)
from rs485bus.motion.group.member import GroupMemberMove
from rs485bus.motion.move import Move, MoveState
from rs485bus.motion.parameters import MotionParameters
from rs485bus.wire.frames import Request

_ATTEMPTS = 3
_POLL = 0.05
_PATIENCE = 2.0
"""Seconds in which a drive may answer again that did not say whether it took a move."""
_SPEED_TOLERANCE = 0.03


class Conduct(Travel):
    """One axis, as moves are carried out on it.

    Args:
        bus: the bus its drive is on.
        attached: its drive, as the bus knows it.
        motion: what of the drive it is.
        name: the axis, in messages.
        tolerance: counts by which a position may differ from another that is to be the same.
    """

    # What families do

    async def _set_up(self) -> None:
        """Read and write what must be known and right before anything else. Called before each command: be quick
        where it is done already."""

    async def _turns(self) -> bool:
        """Whether the motor turns, whoever told it to."""
        return (await self._look(quick=True)).moving

    @abstractmethod
    async def _read_velocity(self) -> float:
        """rpm, in the drive's direction."""

    async def _write_ahead(self, target: int, pace: MotionParameters) -> None:
        """Tell the drive all of a move that it can be told before it starts. Nothing moves by it."""

    @abstractmethod
    async def _send_start(self, target: int, pace: MotionParameters, slot: BurstSlot | None) -> None:
        """Start the move that was written ahead, by one frame: at once, or when it is its turn. Raises
        `OutcomeUnknown` if nobody knows whether it started."""

    @abstractmethod
    def start_frame(self, target: int, pace: MotionParameters) -> Request:
        """Such a frame."""

    @abstractmethod
    async def _send_run(self, rpm: float, pace: MotionParameters, ticks: int | None) -> None:
        """Change to a speed, in the drive's direction, perhaps for a time. Raises as `_send_start`."""

    @abstractmethod
    async def _send_enable(self, on: bool) -> None:
        """Energise the motor, or let go of it."""

    @abstractmethod
    async def _send_zero(self) -> None:
        """Make the position at which it stands the drive's zero."""

    @abstractmethod
    async def _why(self, look: Look, target: int) -> MotionError:
        """Why it stands where it should not, from what the drive reports."""

    # Moves

    async def _carry_out(
        self,
        move: Move,
        target_from: Callable[[Look], int],
        pace: MotionParameters,
        send: Callable[[], Awaitable[None]] | None = None,
        *,
        once: bool = False,
    ) -> Look:
        """A move to a target, from start to arrival.

        `send` starts it in another way than `_write_ahead` and `_send_start` do; `once` as for `_begin`.
        """
        before = await self._prepare()
        slot = None
        if isinstance(move, GroupMemberMove):
            await move.prepared()
            if self.bus.now() - before.at > FRESH:  # the others took their time
                before = await self._prepare()
        target = target_from(before)
        turns = abs(target - before.position) / self.counts_per_turn
        if isinstance(move, GroupMemberMove):
            pace, slot = await move.agree(0.0 if self._near(target, before.position) else turns, target)
            move.profile = pace.profile(turns)
        move.rpm, move.acceleration = pace.rpm, pace.acceleration
        seconds = pace.seconds(turns)
        self._forget()
        move.state = MoveState.STARTING
        self._way = (before.position, target)
        move.eta = self.bus.now() + seconds

        async def start() -> None:
            nonlocal slot
            await self._surely_write_ahead(target, pace)
            # Only the first attempt goes out with the others, when it is its turn.
            place, slot = slot, None
            try:
                await self._send_start(target, pace, place)
            finally:
                if place is not None and move.started_at is not None:
                    move.started_at = max(move.started_at, self.motion.commanded_at)

        await self._begin(move, before, target, send or start, once=once)
        move.state = MoveState.MOVING
        assert move.started_at is not None
        move.eta = move.started_at + seconds
        look = await self._arrive(move, lambda look: self._near(look.position, self._way[1]))
        target = self._way[1]
        if not self._near(look.position, target):
            self._stumble()
            raise await self._why(look, target)
        self._check_arrival(move)
        self._commanded, self._seen = target, look
        return look

    async def _carry_out_run(
        self, move: Move, rpm: float, pace: MotionParameters, duration: float | None, ticks: int | None
    ) -> None:
        """A run at a speed, until that is reached; one for a time until the motor stands again."""
        move.rpm, move.acceleration = abs(rpm), pace.acceleration
        before = await self._prepare(standing=False)
        ramp = 0.0 if pace.acceleration == float("inf") else 2 * pace.rpm / pace.acceleration
        self._forget()
        move.state = MoveState.STARTING
        await self._begin(move, before, None, lambda: self._send_run(rpm, pace, ticks))
        move.state = MoveState.MOVING
        assert move.started_at is not None
        self._running = rpm != 0
        if duration is not None or rpm == 0:
            move.eta = move.started_at + ramp + (duration or 0.0)
            await self._arrive(move, lambda _: True)
            self._running = False
            return
        move.eta = move.started_at + ramp
        close = max(2.0, _SPEED_TOLERANCE * abs(rpm))
        while abs(await self._read_velocity() - rpm) > close:
            if self.bus.now() > move.started_at + 2 * ramp + 1:
                raise self._too_late(move)
            await anyio.sleep(_POLL)

    async def _prepare(self, *, standing: bool = True) -> Look:
        """Know where the axis is and that it may be moved."""
        self._check_rearm()
        await self._set_up()
        if self._lost and standing:
            raise ReferenceLost(f"{self.name}: {self._lost} home() it or set_zero() first.")
        if self._running and standing:
            await self._stand_still()
        seen = self._seen
        if seen is not None and seen.enabled and self.bus.now() - seen.at < FRESH:
            return seen
        look = await self._look()
        if look.moving and standing:
            await self._stand_still()
            look = await self._look()
        self._check_reference(look, seen)
        if not look.enabled:
            raise NotEnabled(f"{self.name} is not enabled: enable() it first.")
        self._enabled = True
        return look

    async def _begin(
        self,
        move: Move,
        before: Look,
        target: int | None,
        send: Callable[[], Awaitable[None]],
        *,
        once: bool = False,
    ) -> None:
        """Send the start of a move until it is known that the drive took it, once.

        `once`: a second one would move it further, so it is sent only where it is seen that the first one was lost.
        """
        for attempt in range(_ATTEMPTS):
            move.started_at = self.bus.now()
            try:
                await send()
                return
            except OutcomeUnknown as unknown:
                try:
                    if await self._took(move, before, target, once):
                        return
                except RequestFailed as error:
                    if isinstance(error, NoReply | DeviceOffline):
                        self._suspect("its drive did not say whether it took its last move, and may have restarted.")
                    self._between = (before.position, before.position if target is None else target)
                    await self._block(f"nobody knows whether {move.what} started ({unknown})")
                    raise unknown from None
                if attempt + 1 == _ATTEMPTS:
                    raise

    async def _surely_write_ahead(self, target: int, pace: MotionParameters) -> None:
        """Nothing moves by what is written ahead: where nobody knows whether the drive took it, it is said again.
        A start does not stand for it, lest an axis of a group starts alone, or not at all."""
        for attempt in range(_ATTEMPTS):
            try:
                await self._write_ahead(target, pace)
                return
            except OutcomeUnknown as unknown:
                if attempt + 1 == _ATTEMPTS:
                    raise MoveFailed(f"{self.name} could not be told its move: {unknown}") from unknown

    async def _took(self, move: Move, before: Look, target: int | None, once: bool) -> bool:
        """Whether a start was taken whose answer was lost: it moves, or is there already."""
        look = await self._look_after(move)
        if look.moving:
            return True
        if target is not None and self._near(look.position, target):
            if once and self._near(before.position, target):
                raise OutcomeUnknown(f"{self.name}: a move so short is not to be seen in its position.")
            self._check_arrival(move)
            return True
        self._check_reference(look, before)
        return False

    async def _look_after(self, move: Move) -> Look:
        """How it is once what was sent last can have set it in motion."""
        assert move.started_at is not None
        await self._grace()
        while True:
            try:
                return await self._look()
            except NoReply:
                # A drive that restarts is away for a moment; what it says then tells that it did.
                if self.bus.now() > move.started_at + _PATIENCE:
                    raise

    async def _is_seen_standing(self) -> bool:
        await self._grace()
        look = await self._look(quick=True)
        if not look.moving and look.at > self.attached.may_start_until(self.motion):
            self.motion.stands(look.at)
            return True
        return False

    async def _grace(self) -> None:
        """Wait until what was sent last has set the motor in motion, if it does."""
        await anyio.sleep(max(0.0, self.attached.may_start_until(self.motion) - self.bus.now()))

    # Enabling

    async def _carry_out_enable(self) -> None:
        unit = self.bus.owner.units[self.attached.address]
        if unit.lapsed:
            raise RearmRequired(f"{self.name} was stopped because {unit.locked}: renew() the lease, then enable().")
        stood = None if self.motion.may_move else self._seen
        if unit.locked or self._blocked or unit.halt is not None or unit.rearm is not None:
            halted = await self._halted(self._halt(emergency=True, motion=self.attached.motion))
            if not halted.standing:
                raise self._unconfirmed()
            if unit.rearm is not None:
                await self._rearm(unit.rearm)  # where that fails it stays locked: its watchdog may be armed
            unit.locked = self._blocked = ""
        await self._set_up()
        if self._enabled is None and await self._turns():
            # Another program left it turning.
            await self._stand_still()
        await self._send_enable(True)
        look = await self._look()
        if not look.enabled:
            raise NotEnabled(f"{self.name} was told to enable its motor, and says that it is not enabled.")
        if self._enabled and stood is not None and not self._near(look.position, stood.position):
            self._lost = "it stands elsewhere than it stood, and nobody moved it."
        if self._between is not None and not self._is_plausible(look.position, *self._between):
            self._lost = (
                "it is not where a move could have taken it that was not answered: the drive may have restarted."
            )
        self._between = None
        self._enabled = True
        self._seen = look

    def _is_plausible(self, position: int, start: int, end: int) -> bool:
        """Whether a move from one place to another may have ended here; at zero, where a drive begins to count after a
        restart, only if the move began or ended there."""
        if self._near(position, 0):
            return self._near(start, 0) or self._near(end, 0)
        return min(start, end) - self.tolerance <= position <= max(start, end) + self.tolerance

    async def _carry_out_disable(self) -> None:
        if self._running:
            await self._stand_still()
        await self._send_enable(False)
        self._enabled = False
        self._forget()

    async def _carry_out_zero(self) -> None:
        await self._set_up()
        if self._running or await self._turns():
            await self._stand_still()
        await self._send_zero()
        self._zeroed(await self._look())

    def _zeroed(self, look: Look) -> None:
        """The drive counts from zero where it stands: positions can be trusted."""
        if not self._near(look.position, 0):
            raise MoveFailed(f"{self.name} was set to zero and reports {look.position} counts.")
        self._lost = ""
        self._enabled = look.enabled
        self._commanded, self._seen = 0, look

    async def _rearm(self, timeout: float) -> None:
        if not await admit_and_arm(self.bus, self.attached, timeout):
            raise RearmRequired(f"{self.name}: its watchdog could not be armed again.")
