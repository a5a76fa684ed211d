"""Somebody who streams to virtual drives whatever comes to mind, and an oracle that looks at the shafts alone.

python -m tests.devices.stream_adversary --family vehicle --seeds 0 1000

The oracle knows what was asked, what the application was told, and how the shafts really turn. It holds that against
what is promised of set-points:

- A shaft changes its speed by the ramp of the stream, but for a drive that stops by itself, and for what is harder on
  purpose.
- A shaft stands once its set-points are too old, its block was left, or a stop was confirmed.
- What is no set-point is refused where it is said, and changes nothing.
- Every call ends in time, by what is documented.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import math
import random
import sys
import threading
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack, suppress
from dataclasses import dataclass, field
from typing import Any

from rs485bus import AxisGroup, Bus, BusConfig, DifferentialDrive, MksServo, TlrStepper, Zlac8015d, open_bus
from rs485bus.devices.zlac.values import Fault, Side
from rs485bus.errors import BusError, LimitExceeded, WrongThread
from rs485bus.sim import Noise, SimMks, SimTlr, SimZlac, TlrMachine, VirtualClockLoop, VirtualLine

ACCELERATION = 500.0
TIMEOUT = 0.25
FASTEST = 240.0
RAMP = FASTEST / ACCELERATION
LONGEST = 30.0
"""Seconds in which every call must end."""
_EVERY = 0.01
_BAD: tuple[Any, ...] = (math.nan, math.inf, -math.inf, None, "90", True, 1j, [1.0], b"1")


@dataclass(frozen=True, slots=True)
class Family:
    """What is streamed to."""

    sims: Callable[[], list[Any]]
    facade: Callable[[Bus], Any]
    """What has a stream."""
    shafts: Callable[[list[Any], float], list[float]]
    """How fast they turn, in rpm."""
    say: Callable[[Any, Any, Any], None]
    """Tell a set-point two speeds of -1 to 1 of the highest, of which one may be left out."""
    watched: bool = True
    ramp: dict[str, float] = field(default_factory=lambda: {"acceleration": ACCELERATION})


def _scaled(value: Any, by: float = FASTEST) -> Any:
    return value * by if isinstance(value, float) and math.isfinite(value) else value


def _one(setpoint: Any, a: Any, b: Any) -> None:
    setpoint(_scaled(a))


def _pair(setpoint: Any, a: Any, b: Any) -> None:
    setpoint(_scaled(a), _scaled(b))


def _both(setpoint: Any, a: Any, b: Any) -> None:
    setpoint(x=_scaled(a), y=_scaled(b))


RADIUS, TRACK = 0.1, 0.4
_MPS = math.tau * RADIUS / 60


def _go(setpoint: Any, a: Any, b: Any) -> None:
    setpoint(_scaled(a, FASTEST / 2 * _MPS), _scaled(b, FASTEST * _MPS / TRACK))


def _group(bus: Bus) -> AxisGroup:
    return AxisGroup(x=MksServo(bus, 1), y=TlrStepper(bus, 2))


def _vehicle(bus: Bus) -> DifferentialDrive:
    base = Zlac8015d(bus, 1, reverse=(False, True))
    return DifferentialDrive(base, RADIUS, TRACK, acceleration=ACCELERATION * _MPS)


def _tlr_sim(address: int = 1, *, live: bool = False) -> SimTlr:
    return SimTlr(address, machine=TlrMachine(origin=None), live_jog=live)


def _of_wheels(sims: list[Any], now: float) -> list[float]:
    return list(sims[0].rpm(now))


FAMILIES = {
    "MKS": Family(lambda: [SimMks(1)], lambda bus: MksServo(bus, 1), lambda s, now: [_mks_rpm(s[0], now)], _one),
    "TL-R": Family(
        lambda: [_tlr_sim()], lambda bus: TlrStepper(bus, 1), lambda s, now: [s[0].rpm(now)], _one, watched=False
    ),
    "TL-R, live_jog": Family(
        lambda: [_tlr_sim(live=True)],
        lambda bus: TlrStepper(bus, 1, live_jog=True),
        lambda s, now: [s[0].rpm(now)],
        _one,
        watched=False,
    ),
    "ZLAC wheel": Family(
        lambda: [SimZlac(1)], lambda bus: Zlac8015d(bus, 1).left, lambda s, now: [s[0].rpm(now)[0]], _one
    ),
    "ZLAC base": Family(lambda: [SimZlac(1)], lambda bus: Zlac8015d(bus, 1), _of_wheels, _pair),
    "group": Family(
        lambda: [SimMks(1), _tlr_sim(2)],
        _group,
        lambda s, now: [_mks_rpm(s[0], now), s[1].rpm(now)],
        _both,
        watched=False,
    ),
    "vehicle": Family(lambda: [SimZlac(1)], _vehicle, _of_wheels, _go, ramp={}),
}


def _mks_rpm(sim: SimMks, now: float) -> float:
    sim.advance(now)
    return sim.motion.motor.rpm(now)


class Found(AssertionError):
    """Something is not as it was promised."""


class Attack:
    """One run.

    Args:
        family: what is streamed to.
        seed: makes it reproducible.
    """

    def __init__(self, family: Family, seed: int) -> None:
        self.family = family
        self.rng = random.Random(seed)
        self.seed = seed
        self.sims = family.sims()
        self.log: list[str] = []
        self.tasks: list[asyncio.Task[None]] = []
        self.rough_until = 0.0
        """Until when a shaft may change its speed by more than the ramp, or not be told to stand."""
        self.must_stand_from = math.inf
        """From when on all shafts must stand, by what was asked."""
        self.stream_open = False
        self.loss = 0.0
        self.away = False

    # Running it

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        failures: list[str] = []
        loop.set_exception_handler(lambda _, context: failures.append(repr(context)))
        handler = _Errors(failures)
        logging.getLogger().addHandler(handler)
        try:
            await self._run()
        finally:
            logging.getLogger().removeHandler(handler)
        if failures:
            raise Found("; ".join(failures))

    async def _run(self) -> None:
        rng = self.rng
        self.loss = rng.choice([0.0, 0.0, 0.02, 0.05, 0.1])
        self.note(f"loss {self.loss}")
        noise = Noise(
            lost_request=self.loss,
            lost_reply=self.loss,
            flipped=rng.choice([0.0, self.loss]),
            late=rng.choice([0.0, self.loss / 2]),
            late_by=0.1,
            duplicated=rng.choice([0.0, self.loss]),
        )
        line = VirtualLine(*self.sims, SimMks(9), baudrate=115200, noise=noise, seed=self.seed)
        self.line = line
        watching = asyncio.ensure_future(self._watch())
        try:
            async with open_bus(line, config=BusConfig(retries=5)) as bus:
                self.bus = bus
                self.facade = self.family.facade(bus)
                self.base = getattr(self.facade, "zlac", self.facade)
                if rng.random() < 0.3:
                    self._spawn_polls()
                await self._within(self._enable())
                for _ in range(rng.randint(1, 3)):
                    await self._session()
                self.quiet()
        except (BusError, ExceptionGroup) as error:
            self.note(f"the bus block raised {error!r}")
            self.quiet()
        finally:
            watching.cancel()
            with suppress(asyncio.CancelledError):
                await watching
            for task in self.tasks:
                task.cancel()
        if not self.away and any(abs(rpm) > 1e-6 for rpm in self.rpm()):
            raise Found(f"it turns at {self.rpm()} after the bus was closed")

    def _spawn_polls(self) -> None:
        other = MksServo(self.bus, 9)

        async def poll() -> None:
            while True:
                with suppress(BusError):
                    await other.position()
                await asyncio.sleep(0.01)

        self.tasks.append(asyncio.ensure_future(poll()))

    async def _enable(self) -> None:
        for _ in range(5):
            try:
                clear = getattr(self.base, "clear_faults", None)
                for sim in self.sims:
                    if getattr(sim, "left", None) is not None and (sim.left.faults or sim.right.faults) and clear:
                        await clear()
                    if isinstance(sim, SimTlr) and sim.motion.alarm:
                        axis = self.facade.axes["y"] if isinstance(self.facade, AxisGroup) else self.facade
                        await axis.clear_fault()
                await self.base.enable()
                return
            except BusError as error:
                self.note(f"enable: {error!r}")
                await asyncio.sleep(1.0)

    async def _session(self) -> None:
        """A stream, perhaps within a watchdog block."""
        rng = self.rng
        async with AsyncExitStack() as stack:
            if self.family.watched and rng.random() < 0.5:
                guarded = self.base if hasattr(self.base, "watchdog") else self.base.base
                try:
                    lease = rng.choice([None, None, 1.0])
                    self.guard = await self._within(
                        stack.enter_async_context(self.bus.watchdog(guarded, timeout=1.0, lease=lease))
                    )
                except BusError as error:
                    self.note(f"watchdog: {error!r}")
            try:
                await self._within(self._stream(), LONGEST + 20)
            except BusError as error:
                self.note(f"the stream ended by {error!r}")
            except _Oops:
                self.note("the source raised")
            except asyncio.CancelledError:
                self.note("the source was cancelled")
            self.stream_open = False
            self.stands_soon()
            await asyncio.sleep(RAMP + 1.0)
            if hasattr(self, "guard"):
                with suppress(BusError):
                    self.guard.renew()
            await self._recover()

    async def _recover(self) -> None:
        if self.away:
            self.line.plug()
            self.away = False
            self.rough(3.0)
            await asyncio.sleep(3.0)
        with suppress(BusError):
            self.bus.clear_emergency_stop()
        await self._within(self._enable(), LONGEST * 2)

    async def _stream(self) -> None:
        rng = self.rng
        async with self.facade.stream(timeout=TIMEOUT, **self.family.ramp) as setpoint:
            self.stream_open = True
            self.told_at = self.now
            for _ in range(rng.randint(5, 120)):
                action = self._draw()
                if action is not None:
                    self.note(action.__name__)
                    result = action(setpoint)
                    if result is not None:
                        await self._within(result)
                else:
                    self._say(setpoint, rng.uniform(-1, 1), rng.uniform(-1, 1))
                if rng.random() < 0.5 and hasattr(self, "guard"):
                    with suppress(BusError):
                        self.guard.renew()
                await asyncio.sleep(rng.choice([0.0, 0.01, 0.02, 0.02, 0.05, 0.05, 0.1, 0.3, 0.6]))
        self.note("left")
        self.stands_now("the block was left")

    def _say(self, setpoint: Any, a: float, b: float) -> None:
        self.family.say(setpoint, a, b)
        self.told_at = self.now
        self.must_stand_from = math.inf

    # What an application may do

    def _draw(self) -> Callable[[Any], Awaitable[None] | None] | None:
        rng = self.rng
        often = (self.bad, self.bad, self.zero, self.crossing, self.burst, self.held)
        seldom = (
            self.stop,
            self.stop_unawaited,
            self.emergency,
            self.bus_emergency,
            self.fault,
            self.restart,
            self.unplug,
            self.raises,
            self.cancelled,
            self.foreign_thread,
            self.queued_move,
            self.second_stream,
            self.replaced,
            self.deaf,
        )
        draw = rng.random()
        if draw < 0.7:
            return None
        return rng.choice(often) if draw < 0.97 else rng.choice(seldom)

    def bad(self, setpoint: Any) -> None:
        """What is no set-point."""
        before = setpoint.sent
        values: list[Any] = [self.rng.choice(_BAD), self.rng.choice([0.5, self.rng.choice(_BAD)])]
        one = self.family.say is _one
        if not one:
            self.rng.shuffle(values)
        try:
            self.family.say(setpoint, *values)
        except (TypeError, LimitExceeded):
            return
        except BusError:
            if setpoint.sent == before:
                raise
        raise Found(f"{values} was taken for a set-point")

    def zero(self, setpoint: Any) -> None:
        self._say(setpoint, 0.0, 0.0)

    def crossing(self, setpoint: Any) -> None:
        self._say(setpoint, 1.0, -1.0)
        self._say(setpoint, -1.0, 1.0)

    def burst(self, setpoint: Any) -> None:
        for _ in range(50):
            self._say(setpoint, self.rng.uniform(-1, 1), self.rng.uniform(-1, 1))

    async def held(self, setpoint: Any) -> None:
        """The same for a while."""
        for _ in range(20):
            self._say(setpoint, 0.5, 0.25)
            await asyncio.sleep(0.04)

    async def stop(self, setpoint: Any) -> None:
        self.rough(0.5 + RAMP)
        await self.base.stop()
        self.stands_now("a stop was confirmed")

    def stop_unawaited(self, setpoint: Any) -> None:
        self.rough(0.5 + RAMP)
        self.base.stop()
        self.stands_soon()

    async def emergency(self, setpoint: Any) -> None:
        self.rough(1.0)
        axis = self.base.axes["x"] if isinstance(self.base, AxisGroup) else self.base
        await axis.emergency_stop()
        if not isinstance(self.base, AxisGroup):
            self.stands_now("an emergency stop was confirmed")

    async def bus_emergency(self, setpoint: Any) -> None:
        self.rough(1.0)
        report = await self.bus.emergency_stop()
        if all(report.standing.values()) if hasattr(report, "standing") else True:
            self.stands_now("an emergency stop of the bus was confirmed")

    def fault(self, setpoint: Any) -> None:
        self.rough(2.0)
        sim = self.rng.choice(self.sims)
        if isinstance(sim, SimZlac):
            sim.fail(self.rng.choice(list(Side)), Fault.OVER_CURRENT, self.now)
        elif isinstance(sim, SimTlr):
            sim.fail(self.rng.randint(1, 5), self.now)

    def restart(self, setpoint: Any) -> None:
        self.rough(2.0)
        sim = self.rng.choice(self.sims)
        sim.restart(self.now) if isinstance(sim, SimMks) else sim.power_cycle(self.now)

    def unplug(self, setpoint: Any) -> None:
        self.rough(math.inf)
        self.away = True
        self.line.unplug()
        if self.rng.random() < 0.7:
            asyncio.get_running_loop().call_later(self.rng.choice([0.05, 0.5, 2.0]), self._plug)

    def _plug(self) -> None:
        self.line.plug()
        self.away = False
        self.rough_until = self.now + 8.0

    def raises(self, setpoint: Any) -> None:
        raise _Oops

    def cancelled(self, setpoint: Any) -> None:
        task = asyncio.current_task()
        assert task is not None
        task.cancel()

    def foreign_thread(self, setpoint: Any) -> None:
        raised: list[BaseException] = []

        def call() -> None:
            try:
                self.family.say(setpoint, 0.5, 0.5)
            except BaseException as error:
                raised.append(error)

        thread = threading.Thread(target=call)
        thread.start()
        thread.join()
        if not raised or not isinstance(raised[0], WrongThread | BusError):
            raise Found(f"a set-point from a foreign thread: {raised}")

    def queued_move(self, setpoint: Any) -> None:
        if isinstance(self.base, AxisGroup) or not hasattr(self.base, "move_by"):
            return
        move = self.base.move_by(0.1, 0.1) if isinstance(self.base, Zlac8015d) else self.base.move_by(0.1)
        self.tasks.append(asyncio.ensure_future(self._end_of(move)))
        self.rough(math.inf)  # it begins after the block, at a time that nobody knows here

    async def _end_of(self, move: Any) -> None:
        with suppress(BusError):
            await move
        self.rough_until = self.now + 2.0

    async def second_stream(self, setpoint: Any) -> None:
        """From the same task: it can never begin."""
        try:
            async with asyncio.timeout(5.0):
                async with self.facade.stream():
                    raise Found("two streams at once")
        except TimeoutError:
            raise Found("a second stream of the same task waits for ever") from None
        except BusError:
            pass

    def replaced(self, setpoint: Any) -> None:
        if self.family.say is _one and hasattr(self.base, "run"):
            run = self.base.run(30, replace=True)
            self.tasks.append(asyncio.ensure_future(self._end_of(run)))
            self.rough(math.inf)

    async def deaf(self, setpoint: Any) -> None:
        """Three frames in a row are lost."""
        receive, left = self.sims[0].receive, [3]

        def lossy(frame: bytes, at: float) -> bytes | None:
            left[0] -= 1
            return None if left[0] >= 0 else receive(frame, at)

        self.sims[0].receive = lossy

    # The oracle

    @property
    def now(self) -> float:
        return asyncio.get_running_loop().time()

    def rpm(self) -> list[float]:
        return self.family.shafts(self.sims, self.now)

    def note(self, what: str) -> None:
        self.log.append(f"{self.now:.3f} {what}")

    def quiet(self) -> None:
        """Nothing is promised from here on."""
        self.rough_until = math.inf

    def rough(self, seconds: float) -> None:
        self.rough_until = max(self.rough_until, self.now + seconds)

    def stands_soon(self) -> None:
        slack = 0.3 if not self.loss else 1.5
        self.must_stand_from = min(self.must_stand_from, self.now + RAMP + slack)

    def stands_now(self, why: str) -> None:
        self.must_stand_from = min(self.must_stand_from, self.now)
        if not self.away and self.now > self.rough_until - 8.0 and any(abs(rpm) > 1e-6 for rpm in self.rpm()):
            raise Found(f"{why}, and it turns at {self.rpm()} rpm")

    async def _watch(self) -> None:
        """Look at the shafts."""
        seen: list[tuple[float, list[float]]] = []
        over = 10
        self.wrong: str | None = None
        while True:
            now, rpm = self.now, self.rpm()
            seen.append((now, rpm))
            calm = now > self.rough_until and not self.away
            if calm and len(seen) > over and seen[-over][0] > self.rough_until:
                before, was = seen[-over]
                # A shaft may have to be told anew after frames that were lost, and goes there in one ramp.
                most = 1.1 * ACCELERATION * (now - before) + ACCELERATION * 0.04 + 2.0
                if any(abs(a - b) > most for a, b in zip(rpm, was, strict=True)):
                    self.wrong = f"{now:.3f}: from {was} to {rpm} rpm within {now - before:.2f} s"
            if self.stream_open:
                old = now - self.told_at - TIMEOUT - RAMP - (0.3 if not self.loss else 1.5)
                if calm and old > 0 and any(abs(each) > 1e-6 for each in rpm):
                    self.wrong = f"{now:.3f}: {rpm} rpm, {now - self.told_at:.2f} s after the last set-point"
            if calm and now > self.must_stand_from and any(abs(each) > 1e-6 for each in rpm):
                self.wrong = f"{now:.3f}: {rpm} rpm, and should stand since {self.must_stand_from:.3f}"
            if self.wrong is not None:
                raise Found(self.wrong)
            await asyncio.sleep(_EVERY)

    async def _within(self, awaitable: Awaitable[Any], seconds: float = LONGEST) -> Any:
        if getattr(self, "wrong", None) is not None:
            raise Found(self.wrong)
        try:
            async with asyncio.timeout(seconds):
                return await awaitable
        except TimeoutError:
            raise Found(f"a call did not end within {seconds:g} s") from None


class _Oops(Exception):
    """What the source of a stream raises."""


class _Errors(logging.Handler):
    """What must not be logged: that something of the library itself went wrong."""

    def __init__(self, failures: list[str]) -> None:
        super().__init__(logging.ERROR)
        self._failures = failures

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info:
            self._failures.append(record.getMessage() + " " + repr(record.exc_info[1]))


def attack(name: str, seed: int) -> list[str]:
    """Run one; what it did. Raises `Found`."""
    one = Attack(FAMILIES[name], seed)
    try:
        with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
            runner.run(one.run())
    except Exception as error:
        error.add_note(f"python -m tests.devices.stream_adversary --family {name!r} --seeds {seed} {seed + 1}")
        for line in one.log[-25:]:
            error.add_note(line)
        raise
    return one.log


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--family", choices=FAMILIES, nargs="+", default=list(FAMILIES))
    parser.add_argument("--seeds", type=int, nargs=2, default=(0, 100), metavar=("FROM", "TO"))
    parser.add_argument("--all", action="store_true", help="go on after the first finding")
    given = parser.parse_args()
    logging.getLogger("rs485bus").setLevel(logging.CRITICAL if len(range(*given.seeds)) > 1 else logging.WARNING)
    found = 0
    for name in given.family:
        for seed in range(*given.seeds):
            try:
                attack(name, seed)
            except Exception as error:
                found += 1
                print(f"{name} {seed}: {type(error).__name__}: {error}", flush=True)
                if not given.all:
                    raise
    print(f"{found} found")
    sys.exit(bool(found))
