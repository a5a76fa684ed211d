"""Set-points of both wheels: each tells both by one frame, and one that is too old stops both by their ramp."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from types import TracebackType
from typing import Literal

from rs485bus.arguments import finite
from rs485bus.bus.async_block import AsyncBlock
from rs485bus.devices.zlac.drive import ZlacDrive
from rs485bus.devices.zlac.wheel import ZlacWheel
from rs485bus.errors import BusError, MotionError, MoveCancelled
from rs485bus.motion.move import Move
from rs485bus.motion.setpoints import begin_block
from rs485bus.motion.state import Fact
from rs485bus.motion.streaming import STEP, Streamer
from rs485bus.motion.terms import Speeds, Terms

Begin = Callable[[dict[int, float]], Awaitable[Streamer]]
"""Begins a stream of wheels that have these speeds, by axis."""


class PairSetpoint:
    """What a stream of both wheels is told: `setpoint(60.0, 40.0)`, in rpm, positive the way the wheels count."""

    def __init__(self, drive: ZlacDrive, moves: tuple[Move, Move], signs: tuple[int, int]) -> None:
        self.streamer: Streamer | None = None
        """What tells the speeds, once it does."""
        self._drive = drive
        self._moves = moves
        self._signs = signs

    def __call__(self, left: float, right: float) -> None:
        """Turn at these speeds from now on. It replaces the ones before, and never waits.

        They are approached by the ramp of the stream, both in proportion. What is faster than a wheel can turn is cut,
        of both by the same part.

        Raises:
            LimitExceeded, TypeError: one is no speed.
            MotionError, RequestFailed: what has ended the stream.
        """
        speeds = finite("left (rpm)", left), finite("right (rpm)", right)
        self.check()
        assert self.streamer is not None
        self.streamer.want(*(sign * speed for sign, speed in zip(self._signs, speeds, strict=True)))

    def check(self) -> None:
        """Raise what has ended the stream."""
        failed = [move for move in self._moves if move.error is not None]
        for move in self._moves:
            move.seen = move.seen or bool(failed)
        if failed:
            raise min((move.error for move in failed if move.error), key=lambda why: isinstance(why, MoveCancelled))
        if self.streamer is None or self.streamer.ended:
            raise MotionError(f"{self._drive.name}: its stream has ended: set-points go into its block.")

    async def reached(self) -> None:
        """Wait until the speeds that are wanted were told, to the end of their ramp. Raises what has ended it."""
        while self.streamer is None or self.streamer.is_on_its_way:
            self.check()
            await asyncio.sleep(STEP / 2)

    @property
    def sent(self) -> tuple[float, float]:
        """The speeds that were told last, in rpm: on a ramp, a step of them."""
        if self.streamer is None:
            return 0.0, 0.0
        left, right = (sign * rpm for sign, rpm in zip(self._signs, self.streamer.told.speeds, strict=True))
        return left, right

    @property
    def measured(self) -> tuple[float, float]:
        """The speeds that were last seen, in rpm."""
        left, right = (
            sign * float(axis.last(Fact.SPEED).value or 0.0)
            for sign, axis in zip(self._signs, self._drive.state.axes, strict=True)
        )
        return left, right

    @property
    def delay(self) -> float:
        """How old the newest set-point was when its frame was sent, in seconds."""
        return 0.0 if self.streamer is None else self.streamer.told.delay


class PairStream(AsyncBlock):
    """A stream of set-points of both wheels. Made by `Zlac8015d.stream`.

    Args:
        drive: the drive.
        wheels: the left and the right one.
        queue: queues it for both, given what begins it when both have come to it.
        stop: stops both.
        timeout: seconds after which a set-point is too old.
        acceleration: rpm/s of a wheel, up and down.
        needs: seconds that a change of both speeds, in rpm and in the drive's directions, takes at least; None for what
            the acceleration makes of it.
    """

    def __init__(
        self,
        drive: ZlacDrive,
        wheels: tuple[ZlacWheel, ZlacWheel],
        queue: Callable[[Begin], tuple[Move, Move]],
        stop: Callable[[], object],
        timeout: float,
        acceleration: float,
        needs: Callable[[Speeds], float] | None = None,
    ) -> None:
        self._drive = drive
        self._wheels = wheels
        self._queue = queue
        self._stop = stop
        self._timeout = timeout
        self._acceleration = acceleration
        self._needs = needs
        self._moves: tuple[Move, Move] | None = None
        self._setpoint: PairSetpoint | None = None
        self._started = asyncio.Event()
        self._is_ended = False

    async def __aenter__(self) -> PairSetpoint:
        self._started, self._is_ended = asyncio.Event(), False
        self._moves = self._queue(self._begin)
        signs = tuple(-1 if wheel.reverse else 1 for wheel in self._wheels)
        setpoint = self._setpoint = PairSetpoint(self._drive, self._moves, (signs[0], signs[1]))
        for move in self._moves:
            move.add_done_callback(lambda _: self._started.set())
        await begin_block(self._moves, self._started, self._end)
        if setpoint.streamer is None:
            await asyncio.gather(*(move.wait() for move in self._moves), return_exceptions=True)
            setpoint.check()
        return setpoint

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        moves, setpoint = self._moves, self._setpoint
        assert moves is not None
        assert setpoint is not None
        for move in moves:
            move._kept_open_by = None
        if error is not None:
            self._give_up()
            if isinstance(error, MoveCancelled):
                await self._stopped()  # it has ended for whoever hears of that: so they stand
            return False
        self._end()
        try:
            ended = await asyncio.gather(*(move.wait() for move in moves), return_exceptions=True)
        except BaseException:
            self._give_up()
            raise
        errors = [each for each in ended if isinstance(each, BusError) and not isinstance(each, MoveCancelled)]
        if errors:
            raise errors[0]
        await self._stopped()  # where somebody else has stopped them
        return False

    async def _stopped(self) -> None:
        for wheel in self._wheels:
            await wheel._stops.stopped()

    async def _begin(self, speeds: dict[int, float]) -> Streamer:
        """Both wheels are ready, and have these speeds."""
        assert self._setpoint is not None
        limits = [wheel._scale.count_limits for wheel in self._wheels]
        terms = Terms(
            acceleration=self._acceleration,
            timeout=self._timeout,
            highest=self._drive.abilities[0].speed_limit,
            limits=tuple(limits) if any(limits) else (),
            needs=self._needs,
        )
        left, told = self._wheels[0], (speeds[0], speeds[1])
        self._setpoint.streamer = Streamer(left.bus, self._drive, (0, 1), terms, told, left._streams.notice_stale)
        self._started.set()
        if self._is_ended:
            self._end()
        return self._setpoint.streamer

    def _end(self) -> None:
        self._is_ended = True
        if self._setpoint is not None and self._setpoint.streamer is not None:
            self._setpoint.streamer.end()

    def _give_up(self) -> None:
        for move in self._moves or ():
            move.seen = True
        if any(not move.done() for move in self._moves or ()):
            self._stop()
