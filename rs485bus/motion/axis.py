"""An axis as its users hold it: units, limits, and the verbs.

A verb acts when it is called: it checks its arguments, joins the axis' queue and returns a handle. A stop overtakes
the queue and is carried out by the owner of the wire, whatever becomes of who asked for it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from typing import Any

import anyio

from rs485bus.arguments import flag, positive, real, whole
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.bus.watchdog.guard import WatchdogGuard
from rs485bus.errors import LimitExceeded, NoReply, NotSent
from rs485bus.motion.commands import AxisCommands
from rs485bus.motion.drive import Ability, Drive
from rs485bus.motion.events import Event, Events
from rs485bus.motion.executor import MoveExecutor
from rs485bus.motion.group.axis_member import AxisMember
from rs485bus.motion.move import Move, MoveTarget
from rs485bus.motion.pace import Pace
from rs485bus.motion.parameters import MotionParameters
from rs485bus.motion.runs import RunExecutor
from rs485bus.motion.sample import AxisSample
from rs485bus.motion.scale import AxisScale
from rs485bus.motion.setpoints import SetpointStream
from rs485bus.motion.state import Fact
from rs485bus.motion.stop_control import StopControl
from rs485bus.motion.stream_executor import StreamExecutor
from rs485bus.motion.streaming import Streamer
from rs485bus.motion.supervisor import Supervisor

_DEGREE = 360
"""An axis arrives within this part of a turn, where nothing else was said."""
_FOR_LAYERS = frozenset({"abandon", "attached", "check_ready", "forgive", "left_alone", "member", "motion"})
"""What other layers call, and users do not."""


class Axis:
    """One motor.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        number: which one of the drive's axes it is.
        name: names it in messages.
        supervisor: what looks at the drive.
        units_per_turn: positions are in units of this many to a turn of the motor; 1 for turns.
        reverse: whether positive is the other way round.
        limits: lowest and highest position that may be gone to, in units; None for no limit.
        rpm: the speed of moves that name none.
        acceleration: the acceleration of moves that name none, in rpm/s.
        tolerance: counts of the drive by which an axis that has arrived may differ from its target; None for 1°.

    Raises:
        LimitExceeded, ValueError: an argument is out of its range.
        TypeError: one is of a wrong type.
    """

    counts_per_turn: int
    """Counts of the drive to a turn of the motor, as far as is known."""

    def __init__(
        self,
        bus: Bus,
        drive: Drive,
        number: int,
        name: str,
        supervisor: Supervisor,
        *,
        units_per_turn: float,
        reverse: bool,
        limits: tuple[float, float] | None,
        rpm: float,
        acceleration: float,
        tolerance: int | None,
    ) -> None:
        self.bus = bus
        self.name = name
        self._scale = scale = AxisScale(
            drive, number, name, units_per_turn=units_per_turn, reverse=reverse, limits=limits
        )
        self._number, self._time = scale.number, scale.time
        self._to_counts, self._to_units = scale.to_counts, scale.to_units
        self.rpm = real("rpm", rpm)
        self.acceleration = real("acceleration", acceleration)
        self.attached: DeviceAdapter = drive
        self._drive = drive
        self._at = number
        self._supervisor = supervisor
        self._state = drive.state.axes[number]
        self.motion = self._state.motion
        self._events = Events(name, bus.now, bus.spawn)
        told = self._forget_plans, self._was_stopped, self._make_safe, self._events.tell
        self._stops = StopControl(bus, drive, number, name, supervisor, *told)
        self._was_interrupted, self.abandon = self._stops.interrupted, self._stops.abandon
        self.left_alone = functools.partial(supervisor.absent, number)  # to see what its watchdog does then
        self._executor = MoveExecutor(bus, drive, number, name, self._stops, supervisor)
        self._runs = RunExecutor(bus, drive, number, name, self._executor, self._stops, supervisor)
        parts = scale, self._stops, self._executor, self._runs
        self._commands = AxisCommands(bus, drive, name, *parts, position=self.position, check_ready=self.check_ready)
        self._streams = StreamExecutor(bus, drive, number, name, scale, self._runs, supervisor, self._events.tell)
        self.member = AxisMember(bus, drive, number, name, self, scale, self._stops, self._commands, self._move)
        self._order, self._order_plan, self._seek = self._commands.order, self._commands.order_plan, self._commands.seek
        self._given_tolerance = None if tolerance is None else whole("tolerance", tolerance, 0)
        self._recount()
        drive.on_recounted = self._recount
        self._pace(self.rpm, self.acceleration)

    def __repr__(self) -> str:
        return f"<{self.name}>"

    def __dir__(self) -> Iterable[str]:
        """Verbs, questions and settings; not what layers tell each other."""
        return [name for name in super().__dir__() if name not in _FOR_LAYERS]

    # Verbs

    def enable(self) -> Handle[None]:
        """Energise the motor, so that it holds its position and takes moves.

        After an emergency stop, a trip, or a stop that was not confirmed, its first frame is a stop.
        """
        self.forgive()
        return self._order("enable", self._executor.enable)

    def disable(self) -> Handle[None]:
        """Let go of the shaft, once what is queued before it is done and the motor stands. It can then be turned."""
        handle = self._order("disable", self._executor.disable)
        self._commands.planned = None
        return handle

    def move_to(self, position: float, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go to a position.

        Args:
            position: in the axis' units.
            rpm: the speed, above 0.
            acceleration: in rpm/s; infinity for a jump.

        Raises:
            LimitExceeded: one of them is out of its range, or the drive cannot be told it within 5 %; nothing is
                queued.
            TypeError: one of them is no number; nothing is queued.
        """
        return self._go(self._pace(rpm, acceleration), self._commands.goal_to(position))

    def move_by(self, distance: float, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go a distance: from the target of the last move if that was reached, else from where the axis stands.

        It is sent as an absolute target, so that it happens once, however often it must be said. Arguments and errors
        as for `move_to`.
        """
        return self._go(self._pace(rpm, acceleration), self._commands.goal_by(distance))

    def run(
        self,
        rpm: float,
        *,
        acceleration: float | None = None,
        duration: float | None = None,
        replace: bool = False,
    ) -> Move:
        """Turn at a speed. Done once that is reached; with a `duration`, once the motor stands again after it.

        Args:
            rpm: the speed; its sign is the direction, and 0 slows down to a stand.
            acceleration: in rpm/s; infinity for a jump.
            duration: seconds; None to go on until told otherwise.
            replace: do not wait until the speeds are reached that were told before. Such a run ends as done; one that
                has not begun is cancelled. For more than a few there is `stream`.

        Raises:
            LimitExceeded, TypeError: as `move_to`.
        """
        rpm = self._number("rpm", rpm)
        parameters = self._pace(abs(rpm) or None, acceleration)
        duration = None if duration is None else self._number("duration", duration)
        ticks = None if duration is None else self._ability.ticks(duration)
        return self._run_at(rpm, parameters, duration, ticks, replace=replace)

    def stream(self, *, timeout: float = 0.25, acceleration: float | None = None) -> SetpointStream:
        """Turn at speeds that are told as they come: `async with axis.stream() as setpoint: setpoint(90.0)`.

        The newest set-point counts and goes out as soon as the wire allows; nothing queues. One that is too old stops
        the motor by its ramp; that is no error, and the next one goes on. Leaving the block stops, too. It joins the
        queue: what was asked for before is done first. `limits` hold.

        Args:
            timeout: seconds after which a set-point is too old.
            acceleration: the ramp up and down, in rpm/s; None for the axis' own, infinity for a jump.

        Raises:
            LimitExceeded, TypeError: one of them is out of its range, or no number.
        """
        seconds = self._time("timeout", timeout)
        rate = self._number("acceleration", self.acceleration if acceleration is None else acceleration)
        if rate <= 0:
            raise LimitExceeded(f"{self.name}: acceleration {rate:g} rpm/s is not above 0")
        self._commands.warn_unwatched()
        return self._streams.open(seconds, rate, self._commands.queue, self._stream, self.stop, self._stops.stopped)

    def set_zero(self) -> Handle[None]:
        """Make the position at which the axis then stands its zero."""
        handle = self._order("set_zero", self._executor.zero)
        self._commands.planned = 0.0
        return handle

    def stop(self) -> Handle[None]:
        """Stop with the ramp of the running move, see that it stands, and drop what is queued.

        It happens at once, whether the handle is awaited or not, and is repeated until it is confirmed by reading. A
        repetition is the same stop. An emergency stop follows where the drive acknowledged it and does not stand after
        one and a half times its stopping time, or where it acknowledged neither of two.

        Raises:
            StopUnconfirmed: when it is awaited: the axis could not be seen standing after three stops, or while the
                port was away. It is stopped further on.
        """
        return self._stops.stop_now(emergency=False)

    def emergency_stop(self) -> Handle[None]:
        """Stop as fast as the drive can, see that it stands, and drop what is queued."""
        return self._stops.stop_now(emergency=True)

    def watchdog(self, timeout: float, *, lease: float | None = None) -> WatchdogGuard:
        """Guard the axis by its drive's own watchdog while a block runs. As `Bus.watchdog`."""
        return self.bus.watchdog(self, timeout=timeout, lease=lease)

    # Questions

    async def position(self) -> float:
        """Where the axis is, in its units."""
        if not self._drive.knows_counts:
            await self._executor.carry(self._drive.set_up)
        return self._to_units(await self._executor.knowledge.ask(Fact.POSITION))

    async def velocity(self) -> float:
        """How fast the motor turns, in rpm."""
        return self._sign * float(await self._executor.knowledge.ask(Fact.SPEED))

    async def idle(self) -> bool:
        """Whether nothing is queued and the motor stands."""
        return self._stops.queue.idle and await self._executor.knowledge.stands()

    async def drain(self) -> None:
        """Wait until nothing is queued or on its way to a target."""
        await self._stops.queue.drain()

    @property
    def sample(self) -> AxisSample:
        """What is known of the axis now, without a frame."""
        return AxisSample.of(self._state, self.bus.now(), self._scale, knows_counts=self._drive.knows_counts)

    async def samples(self, every: float = 0.05) -> AsyncIterator[AxisSample]:
        """A sample every so many seconds. Only what nobody has asked since the one before is asked for.

        Where the drive does not answer, samples grow old (`age`).
        """
        every = positive(f"{self.name}: every (s)", every)
        know, now = self._executor.knowledge.know, self.bus.now
        pace, since = Pace(every, now()), now() - every
        while True:
            try:
                await know((Fact.POSITION,), since=since)
                if self._state.stands is not False:  # where its positions show that it moves, its status says no more
                    await know((Fact.RUNNING,), since=since)
            except (NoReply, NotSent):
                self._stops.check_open()
            since = now()
            yield self.sample
            await anyio.sleep(pace.left(now()))

    async def events(self) -> AsyncIterator[Event]:
        """What happens to the axis from now on: faults, limits, stalls, restarts, trips, stops, lost and back.

        It ends when the bus is closed.

        Raises:
            BusClosed: the bus is closed already.
        """
        self._stops.check_open()
        async for event in self._events.listen():
            yield event

    # For families

    @property
    def units_per_turn(self) -> float:
        """Positions are in units of this many to a turn of the motor."""
        return self._scale.units_per_turn

    @units_per_turn.setter
    def units_per_turn(self, units: float) -> None:
        self._scale.units_per_turn = units

    @property
    def reverse(self) -> bool:
        """Whether positive is the other way round."""
        return self._scale.reverse

    @reverse.setter
    def reverse(self, reverse: bool) -> None:
        self._scale.reverse = reverse

    @property
    def limits(self) -> tuple[float, float] | None:
        """Lowest and highest position that may be gone to, in units; None for no limit."""
        return self._scale.limits

    @limits.setter
    def limits(self, limits: tuple[float, float] | None) -> None:
        self._scale.limits = limits

    @property
    def _sign(self) -> int:
        return self._scale.sign

    @property
    def _ability(self) -> Ability:
        return self._scale.ability

    def _run_at(
        self, rpm: float, parameters: MotionParameters, duration: float | None, ticks: int | None, *, replace: bool
    ) -> Move:
        """Queue a run that was checked."""
        signed = self._sign * math.copysign(parameters.rpm, rpm) if rpm else 0.0

        def carry_out(move: Move) -> Awaitable[float]:
            return self._run(move, signed, parameters, duration, ticks)

        return self._commands.run(rpm, carry_out, timed=duration is not None, replace=flag("replace", replace))

    def _recount(self) -> None:
        """The drive counts otherwise than was known."""
        self._executor.commanded = None
        self.counts_per_turn, given = self._ability.counts_per_turn, self._given_tolerance
        self.tolerance = max(1, self.counts_per_turn // _DEGREE) if given is None else given

    @property
    def tolerance(self) -> int:
        """Counts of the drive by which it may differ from its target when it has arrived."""
        return self._executor.tolerance

    @tolerance.setter
    def tolerance(self, counts: int) -> None:
        self._executor.tolerance = whole("tolerance", counts, 0)

    # For groups, for the bus, and for tools

    def forgive(self) -> None:
        """Take commands again after a failure that nobody has seen."""
        self.bus.check_thread()
        self._stops.forgive()

    def check_ready(self) -> None:
        """Raise what keeps the axis from taking another command."""
        self._stops.check_ready()

    # Carrying out

    def _pace(self, rpm: float | None, acceleration: float | None) -> MotionParameters:
        """What the drive can be told of a speed and an acceleration; None for the axis' own. Raises as verbs do."""
        return self._scale.parameters(
            self.rpm if rpm is None else rpm, self.acceleration if acceleration is None else acceleration
        )

    def _go(self, parameters: MotionParameters, goal: MoveTarget) -> Move:
        return self._commands.queue(
            goal.what, goal.target, goal.planned, lambda move: self._move(move, goal, parameters)
        )

    async def _move(self, move: Move, goal: MoveTarget, parameters: MotionParameters) -> float:
        return await self._commands.move(move, goal, parameters)

    async def _run(
        self, move: Move, rpm: float, parameters: MotionParameters, duration: float | None, ticks: int | None
    ) -> float:
        return self._to_units(await self._runs.run(move, rpm, parameters, duration, ticks, self._scale.count_limits))

    async def _stream(
        self, move: Move, streamer: list[Streamer], timeout: float, acceleration: float, started: Callable[[], None]
    ) -> float:
        return self._to_units(await self._streams.stream(move, streamer, timeout, acceleration, started))

    def _forget_plans(self) -> None:
        self._commands.planned = None

    def _was_stopped(self) -> None:
        self._executor.was_stopped()

    async def _make_safe(self, failed: Handle[Any]) -> bool:
        return await self._executor.make_safe(failed)
