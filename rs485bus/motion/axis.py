"""An axis as its users hold it: units, limits, and the verbs.

A verb acts when it is called: it checks its arguments, joins the axis' queue and returns a handle. A stop overtakes
the queue and is carried out by the owner of the wire, whatever becomes of who asked for it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Mapping
from contextlib import AbstractContextManager
from typing import Any, TypeVar

import anyio

from rs485bus.arguments import flag, pair, positive, real, whole
from rs485bus.bus.bus import Bus
from rs485bus.bus.handle import Handle
from rs485bus.bus.units.adapter import DeviceAdapter
from rs485bus.bus.watchdog.guard import WatchdogGuard
from rs485bus.errors import BusClosed, EmergencyStopped, LimitExceeded, MotionError, MoveCancelled, NoReply, NotSent
from rs485bus.motion.drive import Ability, Drive
from rs485bus.motion.events import Event, EventKind, Events
from rs485bus.motion.executor import Change, MoveExecutor
from rs485bus.motion.group.member import GroupAxis, GroupCoordinator, GroupMemberMove
from rs485bus.motion.move import Move, MoveState, MoveTarget
from rs485bus.motion.parameters import MotionParameters, quickest
from rs485bus.motion.plan import Plan
from rs485bus.motion.sample import AxisSample
from rs485bus.motion.setpoints import Setpoint, SetpointStream, StreamCourse
from rs485bus.motion.state import Fact
from rs485bus.motion.stop_control import StopControl
from rs485bus.motion.streaming import Streamer, Terms
from rs485bus.motion.supervisor import Supervisor
from rs485bus.wire.frames import Request

T = TypeVar("T")

_log = logging.getLogger("rs485bus")

_AS_ASKED = 0.05
"""By which part the drive may be faster or slower than asked before that is refused."""
_DEGREE = 360
"""An axis arrives within this part of a turn, where nothing else was said."""
_FOR_LAYERS = frozenset(
    {
        *("abandon", "accompany", "attached", "check_ready", "forgive", "give_up", "goal_by", "goal_to"),
        *("highest_rpm", "join", "left_alone", "lowest_acceleration", "motion", "planned", "position_pace", "rpm_step"),
        *("start_frame", "stop_if_moving", "way"),
    }
)
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
        self.units_per_turn = positive("units_per_turn", units_per_turn, "; use reverse=True to turn the other way")
        self.reverse = flag("reverse", reverse)
        self.limits = None if limits is None else _limits(limits)
        self.rpm = real("rpm", rpm)
        self.acceleration = real("acceleration", acceleration)
        self.attached: DeviceAdapter = drive
        self._drive = drive
        self._at = number
        self._supervisor = supervisor
        self._state = drive.state.axes[number]
        self.motion = self._state.motion
        self._events = Events(name, bus.now)
        self._stops = StopControl(
            bus,
            drive,
            number,
            name,
            supervisor,
            self._forget_plans,
            self._was_stopped,
            self._make_safe,
            self._events.tell,
        )
        self._queue = self._stops.queue
        self._executor = MoveExecutor(bus, drive, number, name, self._stops, supervisor)
        self._given_tolerance = None if tolerance is None else whole("tolerance", tolerance, 0)
        self._runs: list[Move] = []
        """Those that another one may replace."""
        self._is_warned = False
        """It was said that nothing watches its drive."""
        self._planned: float | None = None
        """Where the queue will have taken it, in units, if that is known."""
        self._exact: float | None = None
        """Where the last move went, in units, before that was rounded to counts."""
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
        self._planned = None
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
        return self._go(self._pace(rpm, acceleration), self.goal_to(position))

    def move_by(self, distance: float, *, rpm: float | None = None, acceleration: float | None = None) -> Move:
        """Go a distance: from the target of the last move if that was reached, else from where the axis stands.

        It is sent as an absolute target, so that it happens once, however often it must be said. Arguments and errors
        as for `move_to`.
        """
        return self._go(self._pace(rpm, acceleration), self.goal_by(distance))

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
        running: list[Streamer] = []
        self._warn_unwatched()

        def begin(started: Callable[[], None]) -> tuple[Move, Setpoint]:
            move = self._new_move("stream", None)
            self._planned = None
            self._queue.add(move, lambda: self._stream(move, running, seconds, rate, started))
            return move, Setpoint(move, self._sign, self._state, running, lambda rpm: self._number("set-point", rpm))

        return SetpointStream(begin, running, self.stop)

    def set_zero(self) -> Handle[None]:
        """Make the position at which the axis then stands its zero."""
        handle = self._order("set_zero", self._executor.zero)
        self._planned = 0.0
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
        return self._to_units(await self._ask(Fact.POSITION))

    async def velocity(self) -> float:
        """How fast the motor turns, in rpm."""
        return self._sign * float(await self._ask(Fact.SPEED))

    async def idle(self) -> bool:
        """Whether nothing is queued and the motor stands."""
        return self._queue.idle and await self._executor.knowledge.stands()

    async def drain(self) -> None:
        """Wait until nothing is queued or on its way to a target."""
        await self._queue.drain()

    @property
    def sample(self) -> AxisSample:
        """What is known of the axis now, without a frame."""
        state = self._state
        position, speed = state.last(Fact.POSITION), state.last(Fact.SPEED).value
        stands, known = state.stands, position.value is not None and self._drive.knows_counts
        return AxisSample(
            at=position.at,
            age=self.bus.now() - position.at,
            position=self._to_units(position.value) if known else None,
            rpm=None if speed is None else self._sign * speed,
            moving=None if stands is None else not stands,
            enabled=state.value(Fact.ENABLED),
            fault=state.value(Fact.FAULT) or "",
            stalled=bool(state.value(Fact.STALLED)),
            limit=state.value(Fact.LIMIT) or "",
            lost=state.lost,
        )

    async def samples(self, every: float = 0.05) -> AsyncIterator[AxisSample]:
        """A sample about every so many seconds. Only what is older than that is asked for.

        Where the drive does not answer, samples grow old (`age`).
        """
        every = positive(f"{self.name}: every (s)", every)
        know = self._executor.knowledge.know
        while True:
            since = self.bus.now() - every
            try:
                await know((Fact.POSITION,), since=since)
                if self._state.stands is not False:  # where its positions show that it moves, its status says no more
                    await know((Fact.RUNNING,), since=since)
            except (NoReply, NotSent):
                self._stops.check_open()
            yield self.sample
            await anyio.sleep(every)

    async def events(self) -> AsyncIterator[Event]:
        """What happens to the axis from now on: faults, limits, stalls, restarts, trips, stops, lost and back."""
        async for event in self._events.listen():
            yield event

    # For families

    @property
    def _ability(self) -> Ability:
        return self._drive.ability(self._at)

    def _order(self, what: str, carry_out: Callable[[], Awaitable[T]]) -> Handle[T]:
        """Queue a command that is no move."""
        self.check_ready()
        handle: Handle[T] = Handle(f"{what} of {self.name}", self._unseen)
        self._queue.add(handle, carry_out)
        return handle

    def _order_plan(self, what: str, plan: Callable[[], Plan[T]]) -> Handle[T]:
        """Queue a plan that sets nothing in motion."""
        return self._order(what, lambda: self._executor.carry(plan))

    def _run_at(
        self,
        rpm: float,
        parameters: MotionParameters,
        duration: float | None,
        ticks: int | None,
        *,
        replace: bool,
    ) -> Move:
        """Queue a run that was checked."""
        signed = self._sign * math.copysign(parameters.rpm, rpm) if rpm else 0.0
        move = self._new_move(f"run at {rpm:g} rpm", None)
        self._planned = None
        self._warn_unwatched()
        if replace:
            self._replace_runs()
        self._runs = [run for run in self._runs if not run.done()]
        if duration is None:
            self._runs.append(move)
        self._queue.add(move, lambda: self._run(move, signed, parameters, duration, ticks))
        return move

    def _seek(
        self, what: str, plan: Callable[[], Plan[None]], *, by_reference: bool = False, at_zero: bool = True
    ) -> Move:
        """Queue a routine of the drive's own that ends at zero, or where the drive then says."""
        planned = 0.0 if at_zero else None
        move = self._new_move(what, planned)
        self._planned = planned

        async def carry_out() -> float:
            counts = await self._executor.seek(move, plan, by_reference=by_reference, at_zero=at_zero)
            move.target = 0.0 if at_zero else self._to_units(counts)
            return move.target

        self._queue.add(move, carry_out)
        return move

    def _go_by_plan(
        self,
        what: str,
        parameters: MotionParameters,
        target_from: Callable[[int], int],
        plan: Callable[[int, MotionParameters], Plan[None]],
    ) -> Move:
        """Queue a move to counts, which is told the drive by a plan of its own."""
        move = self._new_move(what, None)
        self._planned = None

        def target(start: int) -> int:
            counts = target_from(start)
            move.target = self._to_units(counts)
            self._check_limits(move.target)
            return counts

        async def carry_out() -> float:
            return self._to_units(await self._executor.move(move, target, parameters, plan))

        self._queue.add(move, carry_out)
        return move

    def _replace_runs(self) -> None:
        """Wait no longer for the runs that were asked for before."""
        for run in self._runs:
            if self._queue.current is run:
                self._executor.overtake()
            else:
                self._queue.remove(run, MoveCancelled(f"{run.what} was replaced before it began."))

    def _warn_unwatched(self) -> None:
        """Warn once where nothing stops the motor if this program dies."""
        if self._drive.watchdog is None and not self._is_warned:
            self._is_warned = True
            _log.warning(
                "%s has no watchdog: nothing stops it if this program dies while it runs. Have a safety relay cut its "
                "power that something else watches",
                self.name,
            )

    def _was_interrupted(self, unheard: float, reason: str) -> None:
        """The bus stopped the drive for safety, or lost it."""
        self._stops.interrupted(unheard, reason)

    def _retarget(self, position: float, rpm: float | None, acceleration: float | None) -> Handle[None]:
        """Send the move under way elsewhere."""
        parameters = self._pace(rpm, acceleration)
        position = self._number("position", position)
        target = self._target(position)
        under_way = self._executor.changeable
        if under_way is None or under_way.state is not MoveState.MOVING:
            raise MotionError(f"{self.name}: no move_to() or move_by() is under way that could be changed.")
        handle: Handle[None] = Handle(f"change of the target of {self.name}", self._unseen)
        self._executor.change(Change(handle, position, target, parameters))
        self._planned = None
        return handle

    async def _ask(self, fact: Fact) -> Any:
        """Ask the drive for a fact now."""
        await self._executor.knowledge.afresh(fact)
        return self._state.last(fact).value

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
        self._executor.tolerance = counts

    # For groups

    def goal_to(self, position: float) -> MoveTarget:
        """A position, in units, as somewhere to go. Raises `LimitExceeded`."""
        position = self._number("position", position)
        self._target(position)
        return MoveTarget(f"move to {position:g}", position, position, lambda _: position, self._ability.target_range)

    def goal_by(self, distance: float) -> MoveTarget:
        """A distance, in units, as somewhere to go. Raises `LimitExceeded`."""
        distance = self._number("distance", distance)
        self._to_counts(distance)
        planned = None if self._planned is None else self._planned + distance
        if planned is not None:
            self._target(planned, self._ability.reach)
        return MoveTarget(
            f"move by {distance:g}", None, planned, lambda at: self._starts_from(at) + distance, self._ability.reach
        )

    @property
    def planned(self) -> float | None:
        """Where the queue will have taken it, in units, if that is known."""
        return self._planned

    def way(self, start: float, end: float) -> float:
        """How many turns it is from one position, in units, to another; 0 where these are the same to the drive."""
        counts = abs(self._to_counts(end) - self._to_counts(start))
        return counts / self._ability.counts_per_turn if counts > self.tolerance else 0.0

    def forgive(self) -> None:
        """Take commands again after a failure that nobody has seen."""
        self.bus.check_thread()
        self._queue.forgive()

    def join(self, goal: MoveTarget, who: str, coordinator: GroupCoordinator) -> GroupMemberMove:
        """Queue a move that is made together with others, and of which they say how fast it is."""
        what = f"{goal.what} of {self.name}"
        move = GroupMemberMove(what, goal.target, self.position, self._cancel_move, who, coordinator)
        self._planned = goal.planned

        async def carry_out() -> float:
            await move.gathered()
            return await self._move(move, goal, quickest(self, min(self.rpm, self.highest_rpm)))

        self._queue.add(move, carry_out)
        return move

    def accompany(self, moves: Mapping[GroupAxis, GroupMemberMove]) -> None:
        """Know who starts with it, before it does."""

    def start_frame(self, target: int, pace: MotionParameters) -> Request:
        """The frame that starts its part."""
        return self._drive.start_frame(self._at, target, pace)

    def give_up(self, handle: Handle[Any], error: Exception) -> None:
        """End its part, and what is queued behind it."""
        self._stops.give_up(handle, error)

    def stop_if_moving(self) -> None:
        """Stop it, where it may move and is not being stopped already."""
        self._stops.stop_if_moving()

    @property
    def highest_rpm(self) -> float:
        """The highest speed of moves to a position."""
        return self._ability.highest_rpm

    @property
    def rpm_step(self) -> float:
        """The step in which speeds of moves to a position can be told, in rpm."""
        return self._ability.rpm_step

    def lowest_acceleration(self, rpm: float) -> float:
        """The slowest ramp to a speed, in rpm/s."""
        return self._ability.lowest_acceleration(rpm)

    def position_pace(self, rpm: float, acceleration: float) -> MotionParameters:
        """The nearest that the drive can be told on its way to a position. Raises `LimitExceeded`."""
        self._check_speed(rpm)
        return self._ability.position_parameters(rpm, acceleration)

    # For the bus, and for tools

    def left_alone(self) -> AbstractContextManager[None]:
        """Nobody looks at the axis while this holds, though it moves: only to see what its watchdog does then."""
        return self._supervisor.absent(self._at)

    def abandon(self, why: str) -> None:
        """End everything that is queued."""
        self._stops.abandon(why)

    def check_ready(self) -> None:
        """Raise what keeps the axis from taking another command."""
        self._stops.check_open()
        if self.bus.closing:
            raise BusClosed(f"{self.name}: the bus is being closed. Nothing is set in motion any more.")
        if not self.bus.connected:
            raise NotSent(
                f"{self.name}: the port is lost. What is asked for now would happen whenever it is there again: wait "
                "for bus.connected, then ask again."
            )
        if self.bus.latched:
            raise EmergencyStopped(
                f"{self.name}: the bus is latched by an emergency stop. clear_emergency_stop(), then enable() the axis."
            )
        self._queue.check()

    # Units

    @property
    def _sign(self) -> int:
        return -1 if self.reverse else 1

    def _number(self, what: str, value: float) -> float:
        """A number given to a verb. Raises `TypeError`; `LimitExceeded` for nan."""
        return real(f"{self.name}: {what}", value)

    def _time(self, what: str, seconds: float) -> float:
        """A time that one can wait. Raises `LimitExceeded` for others, `TypeError` for what is no number."""
        return positive(f"{self.name}: {what} (s)", seconds)

    def _pace(self, rpm: float | None, acceleration: float | None) -> MotionParameters:
        """What the drive can be told of a speed and an acceleration; None for the axis' own. Raises as verbs do."""
        speed = self._number("rpm", self.rpm if rpm is None else rpm)
        ramp = self._number("acceleration", self.acceleration if acceleration is None else acceleration)
        self._check_speed(speed)
        parameters = self._ability.parameters(speed, ramp)
        self._check_as_asked("rpm", speed, parameters.rpm, "rpm")
        if abs(parameters.rpm / parameters.acceleration - parameters.rpm / ramp) > self._ability.ramp_step:
            self._check_as_asked("acceleration", ramp, parameters.acceleration, "rpm/s")
        return parameters

    def _check_as_asked(self, what: str, asked: float, told: float, unit: str) -> None:
        if asked != told and abs(told - asked) > _AS_ASKED * asked:
            raise LimitExceeded(
                f"{self.name}: {what} {asked:g} is none that its drive can be told; {told:.5g} {unit} is the nearest."
            )

    def _check_speed(self, rpm: float) -> None:
        """Raise `LimitExceeded` for a speed that the motor cannot have."""
        highest, why = self._ability.fastest
        if not 0 < rpm <= highest:
            raise LimitExceeded(
                f"{self.name}: rpm {rpm:g} is outside its range, which is above 0, up to {highest:g} ({why})"
            )

    def _to_counts(self, units: float) -> int:
        """Counts of the drive. Raises `LimitExceeded` for what is no number, or has no end."""
        if not math.isfinite(units):
            raise LimitExceeded(f"{self.name}: {units:g} is no position and no distance; those are finite numbers.")
        return self._sign * round(units / self.units_per_turn * self._ability.counts_per_turn)

    def _to_units(self, counts: int) -> float:
        return self._sign * counts / self._ability.counts_per_turn * self.units_per_turn

    def _check_limits(self, position: float) -> None:
        """Raise `LimitExceeded` for a position that the axis' limits do not allow."""
        half = self.units_per_turn / self._ability.counts_per_turn / 2
        if self.limits is not None and not self.limits[0] - half <= position <= self.limits[1] + half:
            low, high = self.limits
            raise LimitExceeded(f"{self.name}: position {position:g} is outside its limits {low:g}..{high:g}.")

    @property
    def _count_limits(self) -> tuple[int, int] | None:
        """The axis' limits in counts, the lower one first; None for none."""
        if self.limits is None:
            return None
        low, high = sorted(map(self._to_counts, self.limits))
        return low, high

    def _target(self, position: float, reach: tuple[int, int] | None = None) -> int:
        """A position in counts. Raises `LimitExceeded` where the limits or the drive's register do not allow it."""
        self._check_limits(position)
        lowest, highest = self._ability.target_range if reach is None else reach
        if not math.isfinite(position) or not lowest <= (counts := self._to_counts(position)) <= highest:
            ends = sorted((self._to_units(lowest), self._to_units(highest)))
            raise LimitExceeded(
                f"{self.name}: position {position:.10g} is outside {ends[0]:.10g}..{ends[1]:.10g}, which is what the "
                "drive can be told. Go there in steps, each from a new zero: set_zero()."
            )
        return counts

    # Carrying out

    def _new_move(self, what: str, target: float | None) -> Move:
        self.check_ready()
        return Move(f"{what} of {self.name}", target, self.position, self._cancel_move, self._unseen)

    def _go(self, parameters: MotionParameters, goal: MoveTarget) -> Move:
        move = self._new_move(goal.what, goal.target)
        self._planned = goal.planned
        self._queue.add(move, lambda: self._move(move, goal, parameters))
        return move

    async def _move(self, move: Move, goal: MoveTarget, parameters: MotionParameters) -> float:
        def target(start: int) -> int:
            move.target = goal.position(start)
            return self._target(move.target, goal.reach)

        position = await self._executor.move(move, target, parameters)
        self._exact = move.target
        return self._to_units(position)

    async def _run(
        self, move: Move, rpm: float, parameters: MotionParameters, duration: float | None, ticks: int | None
    ) -> float:
        await self._executor.run(move, rpm, parameters, duration, ticks, self._count_limits)
        return await self.position()

    async def _stream(
        self,
        move: Move,
        streamer: list[Streamer],
        timeout: float,
        acceleration: float,
        started: Callable[[], None],
    ) -> float:
        limits = self._count_limits
        counts_per_turn = self._ability.counts_per_turn
        terms = Terms(
            acceleration=acceleration,
            timeout=timeout,
            highest=self._ability.fastest[0],
            limits=() if limits is None else (limits,),
        )

        def begin(rpm: float) -> StreamCourse:
            streamer.append(Streamer(self.bus, self._drive, (self._at,), terms, (rpm,), self._notice_stale))
            started()
            interval = min(self._supervisor.interval, 0.1) if limits else self._supervisor.interval
            now, grace = self.bus.now(), self._drive.start_grace
            return StreamCourse(self._state, now, grace, streamer[0], 0, counts_per_turn, interval)

        try:
            return self._to_units(await self._executor.stream(move, begin, by_reference=limits is not None))
        finally:
            for each in streamer:
                each.close()

    def _notice_stale(self, what: str) -> None:
        _log.warning("%s: %s", self.name, what)
        self._events.tell(EventKind.STALE, what)

    def _starts_from(self, counts: int) -> float:
        """Where a relative move starts: at the last target if that was reached, else where the axis stands."""
        commanded, exact = self._executor.commanded, self._exact
        if commanded is None:
            return self._to_units(counts)
        return exact if exact is not None and self._to_counts(exact) == commanded else self._to_units(commanded)

    def _cancel_move(self, move: Move) -> None:
        self.bus.check_thread()
        cancelled = MoveCancelled(f"{move.what} was cancelled.")
        self._forget_plans()
        if not self._queue.remove(move, cancelled) and self._queue.current is move:
            move.fail(cancelled)
            self.stop()

    def _unseen(self, handle: Handle[Any]) -> None:
        if not isinstance(handle.error, MoveCancelled):
            self.bus.unseen(handle)

    def _forget_plans(self) -> None:
        self._planned = None

    async def _make_safe(self, handle: Handle[Any]) -> None:
        """A command has failed. If it was to move the axis, see that it stands, or stop it: a drive that refuses a
        command may have begun it, and what it did before it goes on doing."""
        if isinstance(handle, Move):
            await self._executor.make_safe()

    def _was_stopped(self) -> None:
        """It is being stopped: it need not be where it was sent."""
        self._executor.commanded = None
        self._executor.stumble()


def _limits(limits: tuple[float, float]) -> tuple[float, float]:
    low, high = (real("each of limits", end) for end in pair("limits", limits, "a pair of numbers: (lowest, highest)"))
    if low > high:
        raise ValueError(f"limits {limits} are the wrong way round: (lowest, highest)")
    return low, high
