"""One wheel of a ZLAC8015D as an axis. Source: ZLAC8015D RS485 V1.06, 3."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any, TypeVar

import anyio

from rs485bus.bus.handle import Handle
from rs485bus.bus.schedule.burst import BurstSlot
from rs485bus.devices.travel import Look
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.frames import write_together
from rs485bus.devices.zlac.hub import HubMotor
from rs485bus.devices.zlac.modes import Target
from rs485bus.devices.zlac.together import Together
from rs485bus.devices.zlac.values import ControlMode, Side, Synchrony, ZeroReset
from rs485bus.errors import DeviceOffline, LimitExceeded, MoveFailed, NoReply, RequestFailed
from rs485bus.motion.group.member import GroupAxis, GroupMemberMove
from rs485bus.motion.move import Move, MoveState, MoveTarget
from rs485bus.motion.parameters import MotionParameters
from rs485bus.wire.frames import Request

P = TypeVar("P")


class ZlacWheel(HubMotor):
    """One wheel. Made by `Zlac8015d`, as its `left` and its `right`.

    A `move_by` beyond what an absolute target may be (0x3FFFFFFF counts either way) is sent as a distance, which may be
    0x7FFFFFFF counts long.

    What it cannot do alone, because the drive cannot: `enable()`, `disable()` and every stop out of position or torque
    mode concern the other wheel, too; and while the other one keeps a speed or a torque, this one can do only the same.
    The drive does not time a `run`: the end of its duration is told when it has come, so that the wheel goes on turning
    if this program ends before, unless a watchdog guards it.
    """

    # Verbs

    def goal_by(self, distance: float) -> MoveTarget:
        distance = self._number("distance", distance)
        if abs(self._to_counts(distance)) > r.MAX_COUNTS:
            raise LimitExceeded(
                f"{self.name}: a way of {distance:g} is longer than {r.MAX_COUNTS} counts, which is what the drive can "
                "be told. Go it in several moves, each from a new zero: set_zero()."
            )
        return super().goal_by(distance)

    def torque(self, milliamperes: int, *, slope: int | None = None) -> Move:
        """Push with a torque, given as a current, until told otherwise. Done once the drive was told.

        Only the load limits the speed then, and 0 lets the wheel roll. `stop()` stops it.

        Args:
            milliamperes: -30000..30000.
            slope: 0..65535 mA/s with which it is reached; None for what the drive is set to.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is queued.
        """
        r.TARGET_TORQUE.of(self.side).raw(milliamperes)
        if slope is not None:
            r.TORQUE_SLOPE.of(self.side).raw(slope)
        move = self._new_move(f"torque of {milliamperes} mA", None)
        self._planned = None
        self._orders.add(move, lambda: self._push(move, self._sign * milliamperes, slope))
        return move

    # For the pair

    def accompany(self, moves: Mapping[GroupAxis, GroupMemberMove]) -> None:
        """One frame starts both wheels, where both go."""
        right = self.other
        if self.side is Side.LEFT and right in moves and isinstance(right, ZlacWheel):
            wheels = (self, right)
            together = Together(lambda side: wheels[side.index].drop(moves[wheels[side.index]]))
            for wheel in wheels:
                wheel.pair(moves[wheel], together)

    def pair(self, handle: Handle[Any], together: Together) -> None:
        """Carry this out together with the other wheel."""
        self._pairs[handle] = together
        handle.add_done_callback(lambda ended: self._pairs.pop(ended, None))
        together.join(self.side, handle)

    def order_together(
        self, what: str, together: Together, act: Callable[[], Awaitable[None]], standing: bool
    ) -> Handle[None]:
        """Queue something that is done once when both wheels have come to it, and stand if they must."""

        async def carry_out() -> None:
            self._together = together
            try:
                await together.meet(self.side, None, _nothing)
                if self._running and standing:
                    await self._stand_still()
                await together.meet(self.side, None, lambda _: act())
            finally:
                self._together = None

        handle = self._order(what, carry_out)
        together.join(self.side, handle)
        return handle

    def carries_out(self, handle: Handle[Any]) -> bool:
        """Whether it has begun with a command."""
        return self._orders.current is handle

    # Carrying out

    @asynccontextmanager
    async def _in_turn(self, handle: Handle[Any] | None, mode: ControlMode) -> AsyncIterator[None]:
        """Be the one whose command needs the drive, or have that together with the other wheel."""
        together = None if handle is None else self._pairs.pop(handle, None)
        self._now, self._together, self._mode = handle, together, mode
        try:
            if together is not None:
                self._skips = await together.meet(self.side, handle, self.modes.overtaken)
            await self._set_up()
            async with self.modes.reserve(self.side, mode, alone=together is None):
                yield
        finally:
            self._now, self._together, self._skips = None, None, False

    async def _act(self, part: P, act: Callable[[dict[Side, P]], Awaitable[None]]) -> None:
        """Have a part acted on: alone, or as soon as the other wheel has come with its own."""
        if self._together is None:
            await act({self.side: part})
        else:
            await self._together.meet(self.side, part, act)

    async def _start(self, part: P, act: Callable[[dict[Side, P]], Awaitable[None]]) -> None:
        """The same for what sets it in motion. That may take some frames; the last one is the start."""
        try:
            await self._act(part, act)
        finally:
            if isinstance(self._now, Move):
                self._now.started_at = self.modes.told_at[self.side]

    async def _prepare(self, *, standing: bool = True) -> Look:
        self._check_rearm()
        await self._resume()
        changes = self.attached_mode is not self._mode
        if not standing and changes and (self._running or (await self._look()).moving):
            await self._stand_still()
        return await super()._prepare(standing=standing)

    async def _stand_still(self) -> None:
        await super()._stand_still()
        await self._resume()

    async def _resume(self) -> None:
        if await self.modes.resume():
            self._enabled = self.other._enabled = True

    async def _carry_out(
        self,
        move: Move,
        target_from: Callable[[Look], int],
        pace: MotionParameters,
        send: Callable[[], Awaitable[None]] | None = None,
        *,
        once: bool = False,
    ) -> Look:
        def target(look: Look) -> int:
            self._from = look.position
            return target_from(look)

        async with self._in_turn(move, ControlMode.POSITION_ABSOLUTE):
            # Once more, with what the drive says of itself.
            pace = self.position_pace(pace.rpm, pace.acceleration)
            look = await super()._carry_out(move, target, pace, send, once=once)
            if not look.enabled:
                # One that restarted on its way to zero counts from zero, too.
                self._forget()
                raise self._let_go(await self.driver.sample(), f"{self.name} has ended {move.what} and let go")
            return look

    async def _carry_out_run(
        self, move: Move, rpm: float, pace: MotionParameters, duration: float | None, ticks: int | None
    ) -> None:
        async with self._in_turn(move, ControlMode.VELOCITY):
            pace = self._pace(pace.rpm, pace.acceleration)
            if self._skips:
                return
            rpm = math.copysign(pace.rpm, rpm) if rpm else 0.0
            # How long it may take depends on the speed that it comes from, too.
            pace = replace(pace, rpm=max(pace.rpm, self.modes.speed(self.side)))
            try:
                await super()._carry_out_run(move, rpm, pace, duration, ticks)
            except (NoReply, DeviceOffline) as error:
                if self._running:
                    await self._block("its drive stopped answering while it ran")
                raise MoveFailed(f"{self.name} stopped answering during {move.what}.") from error

    async def _arrive(self, move: Move, arrived: Callable[[Look], bool]) -> Look:
        ticks, self._ends_after = self._ends_after, None
        if ticks is not None:
            assert move.started_at is not None
            assert move.acceleration is not None
            await anyio.sleep(max(0.0, move.started_at + ticks / 1000 - self.bus.now()))
            try:
                self._told = (r.TARGET_VELOCITY, 0)
                await self._act((0.0, move.acceleration), self.modes.run)
            except RequestFailed:
                await self._block(f"nobody knows whether it was told to end {move.what}")
                raise
        return await super()._arrive(move, arrived)

    async def _took(self, move: Move, before: Look, target: int | None, once: bool) -> bool:
        together = self._together
        if target is None:
            twin, value = self._told

            async def told(values: dict[Side, int]) -> bool:
                return await self.modes.told(twin, values)

            return await (told({self.side: value}) if together is None else together.meet(self.side, value, told))
        if together is None:
            return await super()._took(move, before, target, once)
        await self._grace()
        return await together.meet(self.side, (before, target), self._both_took)

    async def _both_took(self, sent: dict[Side, tuple[Look, int]]) -> bool:
        """The same for both wheels: one start word is for both."""
        wheels = {wheel.side: wheel for wheel in (self, self.other)}
        looks = {side: await wheels[side]._look() for side in sent}
        if any(look.moving for look in looks.values()):
            return True
        if all(wheels[side]._near(looks[side].position, target) for side, (_, target) in sent.items()):
            return True
        for side, (before, _) in sent.items():
            wheels[side]._check_reference(looks[side], before)
        return False

    # Commands

    async def _write_ahead(self, target: int, pace: MotionParameters) -> None:
        await self._act(Target(target, self._from, round(pace.rpm), pace.ramp_code), self.modes.aim)

    async def _send_start(self, target: int, pace: MotionParameters, slot: BurstSlot | None) -> None:
        await self._start(None, lambda wheels: self.modes.launch(wheels, slot))

    def start_frame(self, target: int, pace: MotionParameters) -> Request:
        return self.modes.start_frame([self.side])

    async def _send_run(self, rpm: float, pace: MotionParameters, ticks: int | None) -> None:
        self._told = (r.TARGET_VELOCITY, round(rpm * self.driver.speed_resolution))
        self._ends_after = ticks
        await self._start((rpm, pace.acceleration), self.modes.run)

    async def _send_enable(self, on: bool) -> None:
        await (self.modes.enable() if on else self.modes.release())

    async def _send_zero(self) -> None:
        driver = self.driver
        if (await driver.sample()).status.enabled:
            # With a position loop closed, a counter that jumps could make the wheel jump. The manual speaks of 0x2005
            # in position mode; a drive that needs that gets a mode in which the target is a way of nothing.
            relative = driver.options.zero_in_position_mode
            mode = ControlMode.POSITION_RELATIVE if relative else ControlMode.VELOCITY
            await self.modes.enter(mode, Synchrony.ASYNCHRONOUS, self.side)
        self.zeroings += 1
        # First the counter, then where absolute targets count from: right whether or not one brings the other along.
        # Setting a standing wheel to zero twice is setting it once.
        await driver.write(r.CLEAR_POSITION, ZeroReset(self.side))
        self.zeroings += 1
        await driver.write(r.RESET_ZERO, ZeroReset(self.side))
        nothing = write_together(
            self.attached.address, (r.CLEAR_POSITION, ZeroReset.NONE), (r.RESET_ZERO, ZeroReset.NONE)
        )
        await driver.ask(nothing, motion=self.attached.motion)

    # Enabling

    async def _carry_out_enable(self) -> None:
        async with self.modes.enabling:
            self._blocked = self._blocked or self.other._blocked
            if not self.modes.ready and not self.modes.busy:
                self.driver.known = False  # it may have been switched off and on
            unit = self.bus.owner.units[self.attached.address]
            if not (self._blocked or unit.locked or unit.halt):
                await self._stop_what_others_began()
            await super()._carry_out_enable()
            self.other._blocked = ""
            self.other._enabled = True

    async def _stop_what_others_began(self) -> None:
        """A drive that another program left enabled may be moving."""
        await self._set_up()
        seen, moving = await self._glance(quick=True)
        if not seen.status.enabled:
            self.driver.known = False
        elif moving and not self.modes.ready and not self.modes.busy:
            await self._halted(self._halt(emergency=False, motion=self.attached.motion))

    async def _carry_out_disable(self) -> None:
        async with self._in_turn(None, ControlMode.UNDEFINED):
            await super()._carry_out_disable()
        self.other.released()

    async def _carry_out_zero(self) -> None:
        async with self._in_turn(None, ControlMode.VELOCITY):
            await super()._carry_out_zero()

    async def _push(self, move: Move, milliamperes: int, slope: int | None) -> float:
        async with self._in_turn(move, ControlMode.TORQUE):
            before = await self._prepare(standing=False)
            self._forget()
            move.state = MoveState.STARTING
            await self._begin(move, before, None, lambda: self._send_torque(milliamperes, slope))
            move.state = MoveState.MOVING
            self._running = True  # with 0 mA it rolls
            return await self.position()

    async def _send_torque(self, milliamperes: int, slope: int | None) -> None:
        self._told = (r.TARGET_TORQUE, milliamperes)
        await self._start((milliamperes, slope), self.modes.push)


async def _nothing(_: object) -> None:
    """They only meet."""
