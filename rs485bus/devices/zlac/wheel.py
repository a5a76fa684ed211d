"""One wheel of a ZLAC8015D as an axis. Source: ZLAC8015D RS485 V1.06, 3."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.devices.zlac import plans
from rs485bus.devices.zlac import registers as r
from rs485bus.devices.zlac.drive import ZlacDrive
from rs485bus.devices.zlac.status import WheelStatus, ZlacStatus
from rs485bus.devices.zlac.together import Both
from rs485bus.devices.zlac.values import ControlMode, Side
from rs485bus.errors import MoveCancelled, StopUnconfirmed
from rs485bus.motion.axis import Axis
from rs485bus.motion.group.member import GroupMember, GroupMemberMove
from rs485bus.motion.joint import Joint
from rs485bus.motion.knowledge import AxisKnowledge
from rs485bus.motion.move import Move, MoveTarget
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.plan import Plan
from rs485bus.motion.setpoints import StreamCourse
from rs485bus.motion.streaming import Streamer
from rs485bus.motion.supervisor import Supervisor

T = TypeVar("T")

_FOR_THE_DRIVE = frozenset(
    {
        *("ask_drive", "carries_out", "carry", "drop", "joint", "order_once", "other", "overtake", "recount"),
        *("stop_with", "stopped_as_pair", "unconfirmed", "was_interrupted"),
    }
)
"""What the drive's facade, its other wheel and what layers call, and users do not."""


class Turns:
    """Which wheel's command needs the drive in which mode."""

    def __init__(self) -> None:
        self.enabling = asyncio.Lock()
        """Held while one is enabled, and the other one with it."""
        self._modes: dict[int, ControlMode] = {}
        self._freed = asyncio.Event()

    @asynccontextmanager
    async def of(self, axis: int, mode: ControlMode, *, alone: bool) -> AsyncIterator[None]:
        """A wheel's command needs a mode. Where it is not for both, it waits while that of the other needs another."""
        while alone and any(other is not mode for by, other in self._modes.items() if by != axis):
            self._freed.clear()
            await self._freed.wait()
        self._modes[axis] = mode
        try:
            yield
        finally:
            del self._modes[axis]
            self._freed.set()


class ZlacWheel(Axis):
    """One wheel. Made by `Zlac8015d`, as its `left` and its `right`.

    A `move_by` beyond what an absolute target may be (0x3FFFFFFF counts either way) is sent as a distance, which may be
    0x7FFFFFFF counts long.

    What it cannot do alone, because the drive cannot: `enable()`, `disable()` and every stop out of position or torque
    mode concern the other wheel, too; and while the other one keeps a speed or a torque, this one can do only the same.
    The drive does not time a `run`: the end of its duration is told when it has come, so that the wheel goes on turning
    if this program ends before, unless a watchdog guards it.

    A wheel has no origin to find, and so no `home()`: drive it to where its zero is to be, then `set_zero()`.
    """

    other: ZlacWheel

    def __init__(
        self,
        bus: Bus,
        drive: ZlacDrive,
        side: Side,
        supervisor: Supervisor,
        turns: Turns,
        *,
        units_per_turn: float,
        reverse: bool,
        limits: tuple[float, float] | None,
        rpm: float,
        acceleration: float,
        tolerance: int,
    ) -> None:
        self.side = side
        self._zlac = drive
        self._turns = turns
        super().__init__(
            bus,
            drive,
            side.index,
            f"{drive.name} {side.name.lower()}",
            supervisor,
            units_per_turn=units_per_turn,
            reverse=reverse,
            limits=limits,
            rpm=rpm,
            acceleration=acceleration,
            tolerance=tolerance,
        )
        self.member.accompany = self._accompany

    def __dir__(self) -> Iterable[str]:
        """Verbs and questions; not what is told inside."""
        return [name for name in super().__dir__() if name not in _FOR_THE_DRIVE]

    # Verbs

    def enable(self) -> Handle[None]:
        """Hold both wheels, so that they take commands. Nothing that they were told before goes on.

        After an emergency stop, a trip, or a stop that was not confirmed, its first frame is a stop.
        """
        self.forgive()
        return self._order("enable", self._enable)

    def torque(self, milliamperes: int, *, slope: int | None = None) -> Move:
        """Push with a torque, given as a current, until told otherwise. Done once the drive was told.

        Only the load limits the speed then, and 0 lets the wheel roll. `stop()` stops it.

        Args:
            milliamperes: -30000..30000.
            slope: 0..65535 mA/s with which it is reached; None for what the drive is set to.

        Raises:
            LimitExceeded: one of them is out of its range; nothing is queued.
        """
        wanted = self._sign * r.TARGET_TORQUE.of(self.side).raw(milliamperes)
        if slope is not None:
            r.TORQUE_SLOPE.of(self.side).raw(slope)
        push = self._commands.queue(
            f"torque of {milliamperes} mA", None, None, lambda move: self._push(move, wanted, slope)
        )
        return self._after_streams(push)

    def clear_fault(self) -> Both[None]:
        """Clear the errors of the drive: the drive can clear those of both wheels only. Both are released then:
        `enable()`.

        Raises, when awaited:
            DriveFault: what caused them is still there.
        """
        return self._clear_faults()

    async def status(self) -> WheelStatus:
        """What the drive reports of this wheel; `Zlac8015d.status` tells what it reports of itself, too."""
        status = await self._ask_status()
        return status.left if self.side is Side.LEFT else status.right

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            why = f"{type(self).__name__!r} object has no attribute {name!r}"
            if name == "home":
                why = f"{self.name} has no origin to find. Drive it to where its zero is to be, then set_zero() it."
            raise AttributeError(why, name=name, obj=self)

    async def drain(self) -> None:
        """Wait until nothing is queued or on its way to a target, of either wheel: what guards one guards both."""
        for wheel in (self, self.other):
            await wheel._stops.queue.drain()

    # For groups and for the pair

    def _accompany(self, moves: Mapping[GroupMember, GroupMemberMove]) -> None:
        """One frame starts both wheels, where both go."""
        self._after_streams(moves[self.member])
        right = self.other
        if self.side is Side.LEFT and right.member in moves:
            pair((self, right), (moves[self.member], moves[right.member]))

    def _after_streams(self, move: Move) -> Move:
        """It waits for a stream of the other wheel: the drive has one mode."""
        move._waits_for.append(self.other._stops.queue.kept_open)
        return move

    def drop(self, handle: Handle[Any]) -> None:
        """The other wheel's part of a command failed: end this one's."""
        ended = MoveCancelled(f"Cancelled: {self.other.name} did not carry out its part of it.")
        if self._stops.queue.current is not handle:
            self._stops.queue.remove(handle, ended)
            return
        self._stops.queue.interrupt(ended)
        # Where both are being stopped already, let that go first.
        asyncio.get_running_loop().call_soon(self._stops.stop_if_moving)

    def stop_with(self, other: ZlacWheel) -> None:
        """The other wheel, which stops of this one may stop, too."""
        self.other = other
        self._stops.others = (other._stops,)

    def ask_drive(self, status: Callable[[], Awaitable[ZlacStatus]], clear_faults: Callable[[], Both[None]]) -> None:
        """By what its drive says how it is, and clears its errors."""
        self._ask_status, self._clear_faults = status, clear_faults

    def stopped_as_pair(self, stop: Handle[None]) -> None:
        """Both wheels are being stopped."""
        self._stops.check_open()
        self._stops.was_cut_off = False
        self._stops.queue.interrupt(MoveCancelled(f"{self.name} was stopped."))
        self._supervisor.leave(self._at)
        self._executor.was_stopped()
        self._stops.queue.hold(stop)

    def unconfirmed(self) -> StopUnconfirmed:
        """It was not seen standing after a stop of both wheels."""
        return self._stops.unconfirmed()

    def carries_out(self, handle: Handle[Any]) -> bool:
        """Whether it has begun with a command."""
        return self._stops.queue.current is handle

    def overtake(self, run: Handle[Any]) -> None:
        """Do not wait for the speed of a run: another one follows."""
        if self._stops.queue.current is run:
            self._runs.overtake()

    def order_once(self, what: str, plan: Callable[[], Plan[None]]) -> Handle[None]:
        """Queue something that is done once for both wheels."""

        async def carry_out() -> None:
            assert self.joint is not None
            await self.joint.once(self._at, lambda: self.carry(plan))

        return self._order(what, carry_out)

    async def carry(self, plan: Callable[[], Plan[T]]) -> T:
        """Carry out a plan that concerns both wheels, and sets nothing in motion."""
        return await self._executor.carry(plan)

    def was_interrupted(self, unheard: float, reason: str) -> None:
        """The bus stopped the drive for safety, or lost it."""
        self._was_interrupted(unheard, reason)

    def recount(self) -> None:
        """It is known how the drive counts."""
        self._recount()

    @property
    def _knowledge(self) -> AxisKnowledge:
        """What is known of it."""
        return self._executor.knowledge

    @property
    def joint(self) -> Joint | None:
        """With whom it carries out the present command."""
        joint = self._stops.queue.joint
        return joint if isinstance(joint, Joint) else None

    # Carrying out

    def _pace(self, rpm: float | None, acceleration: float | None) -> MotionParameters:
        # The drive may be set to less (0x2008) than the facade was made for.
        return super()._pace(min(self.rpm, self._ability.fastest[0]) if rpm is None else rpm, acceleration)

    @asynccontextmanager
    async def _in_turn(self, mode: ControlMode) -> AsyncIterator[None]:
        """Wait for the other wheel: until it has come to the present command, where that is for both; else until its
        own needs no other mode."""
        axes = (self._at,) if self.joint is None else (0, 1)
        if self.joint is not None:
            await self.joint.gather(self._at)
        async with self._turns.of(self._at, mode, alone=self.joint is None):
            await self.other._stops.queue.held()  # what it is being stopped in, it keeps no longer
            await self._executor.carry(self._zlac.set_up)
            plans.check_alone(self._zlac, mode, axes)
            yield

    def _go(self, parameters: MotionParameters, goal: MoveTarget) -> Move:
        # A position is gone to at whole rpm, and not as fast as the wheel can run.
        move = super()._go(self._scale.position_parameters(parameters.rpm, parameters.acceleration), goal)
        return self._after_streams(move)

    async def _move(self, move: Move, goal: MoveTarget, parameters: MotionParameters) -> float:
        async with self._in_turn(ControlMode.POSITION_ABSOLUTE):
            # Once more, with what the drive says of itself.
            return await super()._move(
                move, goal, self._scale.position_parameters(parameters.rpm, parameters.acceleration)
            )

    async def _run(
        self, move: Move, rpm: float, parameters: MotionParameters, duration: float | None, ticks: int | None
    ) -> float:
        async with self._in_turn(ControlMode.VELOCITY):
            self._scale.check_speed(parameters.rpm)
            return await super()._run(move, rpm, parameters, duration, ticks)

    async def _stream(
        self,
        move: Move,
        streamer: list[Streamer],
        timeout: float,
        acceleration: float,
        started: Callable[[], None],
    ) -> float:
        async with self._in_turn(ControlMode.VELOCITY):
            await self._executor.ready(standing=False)
            await self._executor.carry(lambda: plans.stream(self._zlac, (self._at,)))
            return await super()._stream(move, streamer, timeout, acceleration, started)

    def _new_stream(self, begin: Callable[[dict[int, float]], Awaitable[Streamer]]) -> Move:
        """Queue its part of a stream of both wheels."""
        return self._commands.queue("stream", None, None, lambda move: self._stream_part(move, begin))

    async def _stream_part(
        self,
        move: Move,
        begin: Callable[[dict[int, float]], Awaitable[Streamer]],
    ) -> float:
        """Follow, with the other wheel, speeds that one streamer tells both."""
        async with self._in_turn(ControlMode.VELOCITY):
            assert self.joint is not None
            joint, executor = self.joint, self._executor
            await executor.ready(standing=False)
            await joint.once(self._at, lambda: executor.carry(lambda: plans.stream(self._zlac, (0, 1))))
            streamers: list[Streamer] = []

            async def follow(rpm: float) -> StreamCourse:
                streamer = await joint.meet(self._at, rpm, begin)
                streamers.append(streamer)
                now, grace, interval = self.bus.now(), self._zlac.start_grace, self._supervisor.interval
                return StreamCourse(self._state, now, grace, streamer, self._at, self._ability, interval)

            try:
                return self._to_units(await self._runs.follow(move, follow))
            finally:
                for each in streamers:
                    each.close()

    async def _push(self, move: Move, milliamperes: int, slope: int | None) -> float:
        wanted = (milliamperes, slope)
        async with self._in_turn(ControlMode.TORQUE):
            return self._to_units(
                await self._runs.push(
                    move, wanted, lambda: plans.push(self._zlac, {self._at: wanted}), self._zlac.push_all, "torque"
                )
            )

    async def _enable(self) -> None:
        # Both are: one after the other.
        async with self._turns.enabling:
            stops, others = self._stops, self.other._stops
            stops.blocked = stops.blocked or others.blocked
            await self._executor.enable()
            others.blocked = ""


def pair(wheels: tuple[ZlacWheel, ZlacWheel], parts: tuple[Handle[Any], Handle[Any]]) -> Joint:
    """Have both wheels carry out their parts of a command together."""
    joint = Joint((0, 1), lambda axis: wheels[axis].drop(parts[axis]))
    for axis, (wheel, part) in enumerate(zip(wheels, parts, strict=True)):
        wheel._stops.queue.pair(part, joint)
        part._waits_for.append(lambda: parts)
        joint.join(axis, part)
    return joint
