"""Set-points of one axis: the newest one counts, and one that is too old stops the motor."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Iterable, Sequence
from types import TracebackType
from typing import Literal

from rs485bus.bus.async_block import AsyncBlock
from rs485bus.errors import BusError, MotionError, MoveCancelled
from rs485bus.motion.courses import MUCH_LESS, Course, Verdict
from rs485bus.motion.drive import Ability
from rs485bus.motion.move import Move
from rs485bus.motion.standstill import NEVER
from rs485bus.motion.state import AxisState, Fact
from rs485bus.motion.streaming import STEP, Streamer

_SHOWS = 10
"""An axis that should have gone so many times as far as a standing one may seem to go, and did not, is held up."""
_HELD_UP = 0.5
"""Seconds for which it must be held up."""
_LOOK_AGAIN = 0.05
_FINDING_OUT = 0.3
"""Seconds for which nothing is told while it is found out what is wrong."""
_CLOSE = 1e-6
_FOREVER = float("inf")


class StreamCourse(Course):
    """Speeds that follow each other.

    Args:
        state: what is known of the axis.
        started_at: when it began.
        grace: seconds within which the axis may stand though it was told to start.
        streamer: tells the speeds.
        at: which one of those that it tells this axis is.
        ability: what the axis can be told.
        interval: seconds between two looks.
    """

    keeps = True

    def __init__(
        self,
        state: AxisState,
        started_at: float,
        grace: float,
        streamer: Streamer,
        at: int,
        ability: Ability,
        interval: float,
    ) -> None:
        super().__init__("stream", state, started_at, grace)
        self.interval = interval
        self._streamer = streamer
        self._at = at
        self._grace = grace
        self._ability = ability
        self._place: int | None = None
        """Where it was last seen to have come to."""
        self._stays_since = self._looked_at = NEVER
        """Since when it stays there though it was told to move; when that was looked at last."""
        self._way, self._slowest = 0.0, _FOREVER
        """How far it should have gone since, in counts; the slowest that it was told since it was looked at, in rpm."""

        self._least, self._seen_at = _FOREVER, NEVER
        """The slowest that it was told since its position was last asked for, in rpm; when that was."""
        self._is_behind = False
        """It goes slower than it was told, or stays: it may have been let go."""

    def place(self) -> str:
        refused = self._streamer.refused
        return f"was told a speed in its stream ({refused})" if refused else "has stopped during its stream"

    def failed(self) -> None:
        self._streamer.close()

    def judge(self) -> Verdict:
        verdict = super().judge()
        if verdict is Verdict.DOUBTFUL:
            self._streamer.hold(_FINDING_OUT)
        return verdict

    def _judge(self) -> Verdict:
        streamer, running = self._streamer, self.state.known(Fact.RUNNING)
        if streamer.failure is not None:
            raise streamer.failure
        if streamer.refused:
            return Verdict.DOUBTFUL
        if streamer.is_quiet and streamer.told.sure and not self._rpm and self.state.stands:
            return Verdict.DONE
        late = running.at > streamer.stands_at + self._grace
        if running.value and late and self.state.standstill.has_moved:
            streamer.insist()  # it was told to stand; a status alone may be stuck
        if streamer.ends_in_vain or (streamer.ended and self._is_overdue(streamer.stands_at + 1)):
            return Verdict.OVERDUE
        return Verdict.DOUBTFUL if self._stays() else Verdict.GOES_ON

    def due(self, fact: Fact) -> float:
        if not self._rpm and self._streamer.told.sure and not self.state.stands:
            soon = self._due_at_end(fact, self._streamer.stands_at, _LOOK_AGAIN)
            late = self._is_overdue(self._streamer.stands_at + _LOOK_AGAIN)
            return max(soon, self.state.last(fact).at + _LOOK_AGAIN) if late else soon
        if fact is Fact.ENABLED and self._is_behind and self.state.known(fact).at < self.state.last(Fact.POSITION).at:
            return NEVER
        if fact is Fact.SPEED:
            return self.state.last(fact).at + min(self.interval, _LOOK_AGAIN * 5)
        return _FOREVER

    @property
    def _rpm(self) -> float:
        """The speed that it was told last."""
        return self._streamer.told.speeds[self._at]

    def _stays(self) -> bool:
        """Whether it does not move though it was told to for long enough to show, at the slowest that it was told."""
        position, told, rule = self.state.last(Fact.POSITION), self._streamer.told, self.state.rule
        if position.value is None:
            return False
        step = self._ability.stream_step
        speed = math.floor(abs(self._rpm) / step + _CLOSE) * step  # it is told less, and stands where that is nothing
        since = told.same_way_since[self._at] + self._grace
        if self._place is None or not speed or abs(rule.moved(self._place, position.value)) > rule.same:
            self._place, self._stays_since, self._looked_at, self._way = position.value, position.at, position.at, 0.0
        elif since > self._stays_since:
            self._stays_since, self._looked_at, self._way = since, max(since, position.at), 0.0
        self._slowest = min(self._slowest, speed)
        if position.at > self._looked_at:
            self._way += self._slowest / 60 * self._ability.counts_per_turn * (position.at - self._looked_at)
            self._looked_at, self._slowest = position.at, speed
        stays = position.at - self._stays_since if self._way > _SHOWS * rule.same else 0.0
        self._is_behind = stays > _LOOK_AGAIN or self._goes_slower(since, speed)
        return stays > _HELD_UP

    def _goes_slower(self, since: float, speed: float) -> bool:
        """Whether it went much less between the last two looks than the slowest speed makes that it was told."""
        begin, end, way = self.state.last_way
        if end <= self._seen_at:
            self._least = min(self._least, speed)
            return self._is_behind
        told, self._least, self._seen_at = min(self._least, speed), speed, end
        wanted = told / 60 * self._ability.counts_per_turn * (end - begin)
        return begin > since and abs(way) < MUCH_LESS * wanted - _SHOWS * self.state.rule.same


class Setpoint:
    """What a stream is told: `setpoint(90.0)`. Speeds are rpm, positive the way the axis counts.

    Args:
        move: the stream, as a command of its axis.
        sign: -1 where the axis counts the other way than its drive.
        state: what is known of it.
        running: what tells the speeds, once it does.
        check: raises what is no speed.
    """

    def __init__(
        self,
        move: Move,
        sign: int,
        state: AxisState,
        running: Sequence[Streamer],
        check: Callable[[float], float],
    ) -> None:
        self._move = move
        self._sign = sign
        self._state = state
        self._running = running
        self.check = check
        """Raises what is no speed."""

    def __call__(self, rpm: float) -> None:
        """Turn at a speed from now on; 0 to stand. It replaces the one before, and never waits.

        A speed is approached by the ramp of the stream. What is faster than the motor can turn is cut.

        Raises:
            LimitExceeded, TypeError: it is no speed.
            MotionError, RequestFailed: what has ended the stream.
        """
        rpm = self.check(rpm)
        if self._move.error is not None:
            self._move.seen = True
            raise self._move.error
        if not self._running or self._running[0].ended:
            raise MotionError(f"{self._move.what} has ended: set-points go into its block.")
        self._running[0].want(self._sign * rpm)

    async def reached(self) -> None:
        """Wait until the speed that is wanted was told, to the end of its ramp. Raises what has ended the stream."""
        while not self._running or self._running[0].is_on_its_way:
            if self._move.error is not None:
                self._move.seen = True
                raise self._move.error
            if self._move.done():
                return
            await asyncio.sleep(STEP / 2)

    @property
    def sent(self) -> float:
        """The speed that was told last, in rpm: on a ramp, a step of it."""
        return self._sign * self._running[0].told.speeds[0] if self._running else 0.0

    @property
    def measured(self) -> float | None:
        """The speed that was last seen, in rpm."""
        speed = self._state.last(Fact.SPEED).value
        return None if speed is None else self._sign * float(speed)

    @property
    def delay(self) -> float:
        """How old the newest set-point was when its frame was sent, in seconds."""
        return self._running[0].told.delay if self._running else 0.0

    @property
    def count(self) -> int:
        """How many set-points were told; newer ones have taken the place of the others."""
        return self._running[0].told.count if self._running else 0


async def begin_block(moves: Iterable[Move], started: asyncio.Event, end: Callable[[], object]) -> None:
    """Wait until a stream has begun that goes on as long as a block of the present task.

    Args:
        moves: the stream, as commands.
        started: set when it has begun, or failed.
        end: ends it.

    Raises:
        MotionError: the present task would wait for itself. The commands are cancelled then, as at any failure.
    """
    try:
        for move in moves:
            move._check_wait()
            move._end_block = end
        await started.wait()
    except BaseException:
        for move in moves:
            move.seen = True
            move.cancel()
        raise
    for move in moves:
        move._keep_open()


async def _at_once() -> None:
    """Wait for nobody."""


class SetpointStream(AsyncBlock):
    """A stream of set-points: `async with axis.stream() as setpoint: setpoint(90.0)`.

    Args:
        begin: queues it, with what is called when it begins and what is waited for before; it gives the stream as a
            command, and the set-point.
        running: what tells the speeds, once it does.
        stop: stops the axis.
        stopped: waits for the end of a stop that is under way.
    """

    def __init__(
        self,
        begin: Callable[[Callable[[], None], Callable[[], Awaitable[object]]], tuple[Move, Setpoint]],
        running: Sequence[Streamer],
        stop: Callable[[], object],
        stopped: Callable[[], Awaitable[None]],
    ) -> None:
        self._begin = begin
        self._running = running
        self._stop = stop
        self._stopped = stopped
        self._move: Move | None = None
        self._is_ended = False
        self._joined: tuple[Setpoint, asyncio.Event] | None = None

    @property
    def over(self) -> bool:
        """Whether it has ended, or was not entered."""
        return self._move is None or self._move.done()

    def end(self) -> None:
        """Slow down to a stand, as at the end of the block; at once, where it has not begun."""
        self._is_ended = True
        for each in self._running:
            each.end()

    def on_end(self, callback: Callable[[Exception | None], object]) -> None:
        """Have `callback` called when it ends, with its failure if it has failed."""
        assert self._move is not None
        self._move.add_done_callback(lambda move: callback(move.error))

    def _join(self, turn: Callable[[], Awaitable[object]] = _at_once) -> None:
        """Join the queue of the axis. Who enters the block then waits for its turn there, and for others after that."""
        started, self._is_ended = asyncio.Event(), False

        def begun() -> None:
            started.set()
            if self._is_ended:
                self.end()

        self._move, setpoint = self._begin(begun, turn)
        self._move.add_done_callback(lambda _: started.set())
        self._move._end_block = self.end  # also where somebody drains the axis before the block is entered
        self._joined = setpoint, started

    def _check_wait(self) -> None:
        """Raise `MotionError` where the present task would wait for itself."""
        assert self._move is not None
        self._move._check_wait()

    def _withdraw(self) -> None:
        """Leave the queue again."""
        if self._move is not None:
            self._move.seen = True
            self._move.cancel()
        self._joined = None

    async def __aenter__(self) -> Setpoint:
        if self._joined is None:
            self._join()
        assert self._joined is not None
        assert self._move is not None
        (setpoint, started), self._joined = self._joined, None
        await begin_block((self._move,), started, self.end)
        if self._move.done():
            await self._move.wait()
        return setpoint

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        move = self._move
        assert move is not None
        move._kept_open_by = None
        try:
            if error is None:
                self.end()
                await move.wait()
        except MoveCancelled:
            await self._stopped()  # by somebody else
        except BaseException as why:
            if not isinstance(why, BusError):
                self._stop()
            raise
        finally:
            if error is not None and not move.done():
                self._stop()
            move.seen = True
        if isinstance(error, MoveCancelled):
            await self._stopped()  # it has ended for whoever hears of that: so it stands
        return False
