"""One run: a scenario on virtual drives in virtual time, with what goes wrong, and all that is seen of it."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from typing import Any

from rs485bus import AxisGroup, Bus, BusConfig, open_bus
from rs485bus.errors import BusError, ReferenceLost
from rs485bus.sim.campaigns.faults.evidence import NEVER, Evidence, Frame
from rs485bus.sim.campaigns.faults.fault import FAULTS
from rs485bus.sim.campaigns.faults.plant import KINDS, Drive, Option
from rs485bus.sim.campaigns.faults.recorder import Notes, Recorded
from rs485bus.sim.campaigns.faults.scenario import Scenario
from rs485bus.sim.clock import VirtualClockLoop
from rs485bus.sim.noise import Noise, babble
from rs485bus.sim.treatment import PLAIN, Treatment
from rs485bus.sim.virtual_line import VirtualLine

WATCHED_AFTER = 2.0
"""Seconds for which the shafts are watched when the application has ended."""
_OFTEN, _SELDOM = 0.01, 0.05
_LONGEST = 60.0
"""Virtual seconds that a run may take beyond the one in which nothing goes wrong."""
_GIVES_IN = 30.0
_WALL = 30
"""Seconds of the processor that a run may take."""
_POLL = 0.05
_QUIET = Noise()


class Spinning(BaseException):
    """A run takes too much of the computer's time."""


class World:
    """One run.

    Args:
        scenario: what the application does.
        options: what the virtual drives are like, by family.
        goes_on: after an error the application enables the axis again and goes on; otherwise it gives up.
        faults: what goes wrong, and at which frame, counted from 0.
        usual: seconds that it takes where nothing goes wrong.
        noise: what else goes wrong on the pairs, at random.
        seed: makes the noise reproducible.
    """

    def __init__(
        self,
        scenario: Scenario,
        options: dict[str, Option],
        *,
        goes_on: bool = False,
        faults: Sequence[tuple[str, int]] = (),
        usual: float = 30.0,
        noise: Noise = _QUIET,
        seed: int = 1,
    ) -> None:
        self.scenario = scenario
        self.evidence = Evidence()
        self._faults = {frame: name for name, frame in faults}
        self._limit = usual + _LONGEST
        self._goes_on = goes_on
        self.buses = [[KINDS[kind](address, options[kind]) for kind, address in drives] for drives in scenario.buses]
        self.drives = [drive for drives in self.buses for drive in drives]
        self.lines = [VirtualLine(*(drive.sim for drive in drives), noise=noise, seed=seed) for drives in self.buses]
        self._open: list[Bus] = []
        self._recorded: list[Recorded] = []
        self._axes: list[Recorded] = []
        self._deaf: dict[Drive, float] = {}
        self._frames = 0
        self._told_at = 0.0
        self._task: asyncio.Task[None] | None = None
        self._aside: set[asyncio.Task[None]] = set()
        self._timer: asyncio.TimerHandle | None = None
        self._seen_away: list[float | None] = []

    def run(self) -> Evidence:
        """Run it to its end; return what was seen."""
        evidence = self.evidence
        with _logged(evidence, self.now), _alarm():
            runner = asyncio.Runner(loop_factory=VirtualClockLoop)
            try:
                self._loop = runner.get_loop()
                self._loop.set_exception_handler(self._unhandled)
                runner.run(self._main())
            except Spinning:
                evidence.spun = True
            finally:
                with contextlib.suppress(Spinning, BaseExceptionGroup, Exception):
                    runner.close()
        evidence.early_frames = sum(line.pair.early_frames for line in self.lines)
        return evidence

    def now(self) -> float:
        return self._loop.time()

    async def _main(self) -> None:
        evidence = self.evidence
        evidence.begun = now = self.now()
        self._calls = Notes(evidence.calls, self.now, self._recover if self._goes_on else None)
        self._others = Notes(evidence.calls, self.now, aside=True)
        for drives, line in zip(self.buses, self.lines, strict=True):
            line.pair.script = lambda frame, now, drives=drives: self._script(frame, now, drives)
        for drive in self.drives:
            drive.look(now, now)
            evidence.shafts.update({shaft.name: shaft for shaft in drive.shafts})
            evidence.armed[drive.address] = (drive.watchdog_ms, 0)
        self._timer = self._loop.call_later(_OFTEN, self._look)
        self._task = self._loop.create_task(self.scenario.play(self))
        await asyncio.wait([self._task], timeout=self._limit)
        if not self._task.done():
            self._task.cancel()
            await asyncio.wait([self._task], timeout=_GIVES_IN)
        if self._task.done() and not self._task.cancelled() and (error := self._task.exception()) is not None:
            self._ended_by(error)
        for task in self._aside:
            task.cancel()
        if evidence.closed_at == NEVER:
            evidence.closed_at = self.now()
        await asyncio.sleep(WATCHED_AFTER)
        self._timer.cancel()
        evidence.gave_up = self._calls.gave_up
        evidence.ended = now = self.now()
        for drive in self.drives:
            drive.look(now, self._told_at)
            for shaft in drive.shafts:
                shaft.trips = list(drive.trips)
            evidence.armed[drive.address] = (evidence.armed[drive.address][0], drive.watchdog_ms)

    def _ended_by(self, error: BaseException) -> None:
        """The application was left by an error that it does not know: it is one of ours, or a mistake."""
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        if not isinstance(error, (BusError, ValueError, TypeError, asyncio.CancelledError)):
            self.evidence.unhandled.append(f"the application was left by {error!r}")

    # What scenarios use

    @asynccontextmanager
    async def bus(self, number: int = 0, **config: Any) -> AsyncIterator[Recorded]:
        """Open one of the buses, and close it in the end: both are calls."""
        drives = self.buses[number]
        shafts = tuple(shaft.name for drive in drives for shaft in drive.shafts)
        self.evidence.left_running = bool(config.get("leave_running"))
        config = {name: value for drive in drives for name, value in drive.option.bus.items()} | config
        opening = open_bus(self.lines[number], config=BusConfig(**config))
        recorded = None
        call = self._calls.begin(f"bus {number}", "open", (), config)
        try:
            async with opening as bus:
                self._calls.end(call)
                recorded = Recorded(self._calls, bus, f"bus {number}", shafts)
                self._open.append(bus)
                self._seen_away.append(None)
                self._recorded.append(recorded)
                try:
                    yield recorded
                finally:
                    self.evidence.leaving_at = self.now()
                    call = self._calls.begin(recorded, "close", (), {})
                    call.shafts = ()
        except BaseException as error:
            self._calls.end(call, None, error)
            raise
        else:
            self._calls.end(call)
        finally:
            self.evidence.closed_at = self.now()

    def axis(self, address: int, bus: int = 0, **options: Any) -> Recorded:
        """The facade of a drive."""
        drive = next(drive for drive in self.buses[bus] if drive.address == address)
        facade = drive.facade(self._bus(bus), **options)
        names = tuple(shaft.name for shaft in drive.shafts)
        members = {}
        if len(names) == 2:
            for side, name in zip(("left", "right"), names, strict=True):
                members[side] = Recorded(self._calls, getattr(facade, side), name, (name,))
        axis = Recorded(
            self._calls, facade, names[0] if len(names) == 1 else f"{drive.family} {address}", names, **members
        )
        reverse = options.get("reverse", False)
        reverses = reverse if isinstance(reverse, tuple) else (reverse,) * len(names)
        for shaft, is_reverse in zip(drive.shafts, reverses, strict=True):
            shaft.sign = -1 if is_reverse else 1
        if "limits" in options:
            for shaft in drive.shafts:
                shaft.limits = tuple(shaft.samples[0].position + end for end in options["limits"])
        self._axes.append(axis)
        return axis

    def group(self, **axes: Recorded) -> Recorded:
        """Axes that move together."""
        names = tuple(name for axis in axes.values() for name in axis.shafts)
        for name in names:
            self.evidence.shafts[name].together = tuple(other for other in names if other != name)
        return Recorded(self._calls, AxisGroup(**{name: axis.real for name, axis in axes.items()}), "group", names)

    def with_others(self, who: Recorded, real: Any, name: str) -> Recorded:
        """Something else that moves the shafts of an axis: a vehicle."""
        return Recorded(self._calls, real, name, who.shafts)

    async def sleep(self, seconds: float) -> None:
        """Let time pass."""
        await asyncio.sleep(seconds)

    async def until(self, holds: Callable[[], bool]) -> None:
        """Let time pass until something holds, for 3 s at most."""
        for _ in range(300):
            if holds():
                return
            await asyncio.sleep(0.01)

    async def both(self, *coroutines: Coroutine[Any, Any, None]) -> None:
        """Do several things at once; the first that fails ends the others."""
        async with asyncio.TaskGroup() as tasks:
            for coroutine in coroutines:
                tasks.create_task(coroutine)

    def line(self, number: int = 0) -> VirtualLine:
        """A line, for what opens it itself."""
        return self.lines[number]

    def record(self, who: str, verb: str, coroutine: Coroutine[Any, Any, Any]) -> Any:
        """Anything else that is awaited, as a call."""
        from rs485bus.sim.campaigns.faults.recorder import RecordedAnswer

        recorded = Recorded(self._calls, None, who)
        return RecordedAnswer(recorded, self._calls.begin(recorded, verb, (), {}), coroutine)

    def _bus(self, number: int) -> Bus:
        name = f"bus {number}"
        return next(bus for bus, recorded in zip(self._open, self._recorded, strict=True) if recorded.name == name)

    async def _recover(self, who: Recorded, error: Exception) -> None:
        """What the application does after an error before it goes on."""
        if not hasattr(who.real, "enable"):
            return
        for verb in ("enable", "set_zero") if isinstance(error, ReferenceLost) else ("enable",):
            notes = Notes(self.evidence.calls, self.now, aside=True)
            with contextlib.suppress(BusError):
                if hasattr(who.real, verb):
                    await getattr(who.by(notes), verb)()

    # What goes wrong

    def deafen(self, drive: Drive | None, now: float, seconds: float = NEVER) -> None:
        """A drive hears nothing from now on."""
        if drive is not None:
            self._deaf[drive] = now + seconds
            for shaft in drive.shafts:
                shaft.deaf.append((now, now + seconds))

    def unplug(self, seconds: float) -> None:
        """All ports are lost, and there again after a while."""
        for line in self.lines:
            line.unplug()
            self._loop.call_later(seconds, line.plug)

    def babble(self, seconds: float, gaps_every: float) -> None:
        """All pairs are noisy for a while."""
        now = self.now()
        for line in self.lines:
            line.babble(babble(seconds, gaps_every))
        for shaft in self.evidence.shafts.values():
            shaft.deaf.append((now, now + seconds))

    def pause(self, seconds: float) -> None:
        """The program does not run."""
        now = self.now()
        self.evidence.pauses.append((now, now + seconds))
        assert isinstance(self._loop, VirtualClockLoop)
        self._loop.block(seconds)

    def cancel_caller(self) -> None:
        """The application is cancelled."""
        assert self._task is not None
        self._loop.call_soon(self._task.cancel)

    def second_caller(self, verb: str, drive: Drive | None) -> None:
        """Somebody else stops an axis, or everything."""
        names = set() if drive is None else {shaft.name for shaft in drive.shafts}
        axes = [axis for axis in self._axes if drive is None or names & set(axis.shafts)]
        whom = self._recorded if verb == "emergency_stop" else axes
        for one in whom:
            self._spawn(self._call_and_see(one.by(self._others), verb))

    def poll(self) -> None:
        """The application asks everything 20 times a second."""
        for axis in self._axes:
            self._spawn(self._poll(axis))

    async def _poll(self, axis: Recorded) -> None:
        askers = axis.members.values() or [axis]
        while True:
            for asker in askers:
                for question in ("position", "velocity", "status"):
                    if hasattr(asker.real, question):
                        await self._call_and_see(asker.by(self._others), question)
            await asyncio.sleep(_POLL)

    async def _call_and_see(self, who: Recorded, verb: str) -> None:
        with contextlib.suppress(BusError):
            await getattr(who, verb)()

    def _spawn(self, coroutine: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(coroutine)
        self._aside.add(task)
        task.add_done_callback(self._aside.discard)

    # What is seen

    def _script(self, frame: bytes, now: float, drives: list[Drive]) -> Treatment:
        """A frame is whole: what becomes of it."""
        drive = next((drive for drive in drives if drive.sim.address == frame[0]), None)
        for each in drives if frame[0] == 0 else [drive]:
            if each is not None:
                each.look(now, self._told_at)
        treatment = PLAIN if drive is None else drive.treat(frame, now)
        name = self._faults.get(self._frames, "")
        if name:
            fault = FAULTS[name]
            self.evidence.fault, self.evidence.fault_at = name, now
            treatment = (fault.act(self, drive, now) if fault.act is not None else None) or fault.treatment
        self.evidence.frames.append(Frame(now, frame, name))
        self._frames += 1
        self._told_at = now
        if drive is not None and self._deaf.get(drive, 0.0) > now:
            return Treatment(heard=False)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = self._loop.call_at(now + _OFTEN, self._look)
        return treatment

    def _look(self) -> None:
        now = self.now()
        turning = [drive.look(now, self._told_at) for drive in self.drives]
        for at, bus in enumerate(self._open):
            since = self._seen_away[at]
            if since is None and not bus.connected and not bus.closed:
                self._seen_away[at] = now - _SELDOM
            elif since is not None and (bus.connected or bus.closed):
                self._seen_away[at] = None
                self.evidence.away.append((since, now))
        self._timer = self._loop.call_later(_OFTEN if any(turning) else _SELDOM, self._look)

    def _unhandled(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        self.evidence.unhandled.append(f"{context.get('message')}: {error!r}")


class _Listener(logging.Handler):
    def __init__(self, evidence: Evidence, now: Any) -> None:
        super().__init__()
        self._evidence = evidence
        self._now = now

    def emit(self, record: logging.LogRecord) -> None:
        self._evidence.logged.append((self._now(), record.levelname, record.getMessage()))
        if record.exc_info and record.exc_info[1] is not None:
            self._evidence.unhandled.append(f"{record.getMessage()}: {record.exc_info[1]!r}")


@contextmanager
def _logged(evidence: Evidence, now: Any) -> Iterator[None]:
    """Write down what the package logs, instead of showing it."""
    logger, listener = logging.getLogger("rs485bus"), _Listener(evidence, now)
    propagate, logger.propagate = logger.propagate, False
    logger.addHandler(listener)
    try:
        yield
    finally:
        logger.removeHandler(listener)
        logger.propagate = propagate


@contextmanager
def _alarm() -> Iterator[None]:
    """End a run that takes the computer too long, where the system can."""
    if not hasattr(signal, "SIGVTALRM"):
        yield
        return

    def spins(*_: object) -> None:
        raise Spinning

    former = signal.signal(signal.SIGVTALRM, spins)
    signal.setitimer(signal.ITIMER_VIRTUAL, _WALL)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, former)
