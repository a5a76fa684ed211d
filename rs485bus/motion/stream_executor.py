"""Carries out the streams of one axis."""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable

from rs485bus.arguments import finite
from rs485bus.bus.bus import Bus
from rs485bus.motion.drive import Drive
from rs485bus.motion.events import EventKind
from rs485bus.motion.move import Move
from rs485bus.motion.runs import RunExecutor
from rs485bus.motion.scale import AxisScale
from rs485bus.motion.setpoints import Setpoint, SetpointStream, StreamCourse
from rs485bus.motion.streaming import Streamer
from rs485bus.motion.supervisor import Supervisor
from rs485bus.motion.terms import Terms

_NEAR_LIMITS = 0.1
"""Seconds between two looks at an axis whose stream may take it out of its limits."""
_log = logging.getLogger("rs485bus")


CarryOut = Callable[[Move, list[Streamer], float, float, Callable[[], None]], Awaitable[float]]
"""Carries out a stream: the command, what tells the speeds, timeout, acceleration, what is called when it begins."""


class StreamExecutor:
    """Makes streams, and carries out streams.

    Args:
        bus: the bus its drive is on.
        drive: its drive.
        axis: which one of the drive it is.
        name: names it in messages.
        scale: its units.
        runs: carries out what streams have in common with runs.
        supervisor: looks at it.
        tell: called with what happens to it.
    """

    def __init__(
        self,
        bus: Bus,
        drive: Drive,
        axis: int,
        name: str,
        scale: AxisScale,
        runs: RunExecutor,
        supervisor: Supervisor,
        tell: Callable[[EventKind, str], None],
    ) -> None:
        self._bus = bus
        self._drive = drive
        self._axis = axis
        self._name = name
        self._scale = scale
        self._runs = runs
        self._supervisor = supervisor
        self._tell = tell

    def open(
        self,
        timeout: float,
        acceleration: float,
        queue: Callable[[str, None, None, Callable[[Move], Awaitable[float]]], Move],
        carry_out: CarryOut,
        stop: Callable[[], object],
        stopped: Callable[[], Awaitable[None]],
    ) -> SetpointStream:
        """A stream, which joins the queue when its block is entered.

        Args:
            timeout: seconds after which a set-point is too old.
            acceleration: the ramp, in rpm/s.
            queue: queues it.
            carry_out: carries it out when its turn has come.
            stop: stops the axis.
            stopped: waits for the end of a stop that is under way.
        """
        running: list[Streamer] = []

        def begin(started: Callable[[], None], turn: Callable[[], Awaitable[object]]) -> tuple[Move, Setpoint]:
            async def in_turn(move: Move) -> float:
                await turn()
                return await carry_out(move, running, timeout, acceleration, started)

            move = queue("stream", None, None, in_turn)
            state = self._drive.state.axes[self._axis]
            return move, Setpoint(move, self._scale.sign, state, running, self._speed)

        return SetpointStream(begin, running, stop, stopped)

    def _speed(self, rpm: float) -> float:
        return finite(f"{self._name}: a set-point (rpm)", rpm)

    async def stream(
        self,
        move: Move,
        streamer: list[Streamer],
        timeout: float,
        acceleration: float,
        started: Callable[[], None],
    ) -> int:
        """Have it follow set-points until they end; where that was, in counts.

        Args:
            move: the stream, as a command of the axis.
            streamer: what tells the speeds is put there, once it does.
            timeout: seconds after which a set-point is too old.
            acceleration: the ramp, in rpm/s.
            started: called when it takes set-points.
        """
        limits, ability = self._scale.count_limits, self._scale.ability
        terms = Terms(
            acceleration=acceleration,
            timeout=timeout,
            highest=ability.fastest[0],
            limits=() if limits is None else (limits,),
        )

        async def begin(rpm: float) -> StreamCourse:
            streamer.append(Streamer(self._bus, self._drive, (self._axis,), terms, (rpm,), self.notice_stale))
            started()
            interval = self._supervisor.interval
            interval = interval if limits is None else min(interval, _NEAR_LIMITS)
            state, now, grace = self._drive.state.axes[self._axis], self._bus.now(), self._drive.start_grace
            return StreamCourse(state, now, grace, streamer[0], 0, ability, interval)

        try:
            return await self._runs.stream(move, begin, by_reference=limits is not None)
        finally:
            for each in streamer:
                each.close()

    def notice_stale(self, what: str) -> None:
        """A set-point was too old."""
        _log.info("%s: %s", self._name, what)
        self._tell(EventKind.STALE, what)
