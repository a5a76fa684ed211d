"""A plant that is never idle: drives of two families, guarded, asked without a pause, and moved; for an hour, say.

    python -m rs485bus.sim.endurance --hours 1 --loss 0.05 --sluggish 2

It runs through the facades on a virtual clock, and the drives' own watchdogs are the witnesses. Wrong is: a drive that
tripped, a move that ended elsewhere than where it was sent, a move that failed, memory that grows, watchdogs that cost
the wire more than a tenth of the feeds there would be without any other traffic, a wire that was idle.
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import random
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from rs485bus.bus.bus import Bus
from rs485bus.bus.config import BusConfig
from rs485bus.bus.opening import open_bus
from rs485bus.bus.record import Record
from rs485bus.bus.watchdog.guard import WatchdogGuard
from rs485bus.devices.mks import MksServo
from rs485bus.devices.zlac import Zlac8015d
from rs485bus.errors import BusError, NoReply, OutcomeUnknown
from rs485bus.sim.campaigns.sluggish import LONGEST, Question, Sluggish
from rs485bus.sim.clock import VirtualClockLoop
from rs485bus.sim.mks import SimMks
from rs485bus.sim.noise import Noise
from rs485bus.sim.virtual_line import VirtualLine
from rs485bus.sim.zlac import SimZlac

TIMEOUT = 1.0
"""Seconds of every watchdog."""
MIN_SAVED = 0.9
"""The share of feeds that other traffic must make unnecessary."""
MAX_GROWTH = 4_000
"""kB by which memory may grow after the first minute: what is kept of each unit's latencies fills up until then."""
_REPLY_TIMEOUT = 0.01
_TURNS = 20.0
"""How far from zero moves go."""
_MKS_RPM, _ZLAC_RPM = 600.0, 300.0
_PAUSES = (0.2, 3.0)
"""Seconds between two moves of a drive, at least and at most."""
_AFTER_AN_ERROR = 0.05
_LOSSES = ("raised NoReply", "raised OutcomeUnknown")
"""What may come of lost replies: something was lost three times, and it is said whether it may be repeated safely."""
_HELD_UP = "a question raised NotSent: Not sent, all its time a late reply"
"""And of a device that is silent: it was asked something else in vain. For seconds: it is hardly there then."""


@dataclass
class Verdict:
    """What was found. `faults` says what is wrong with it."""

    devices: int
    loss: float
    sluggish: int = 0
    """How many devices answer late now and then: that looks like a loss, and may spoil what others answer."""
    seconds: float = 0.0
    """Virtual time."""
    wall: float = 0.0
    """Real time, in seconds."""
    trips: int = 0
    feeds: int = 0
    saved: int = 0
    worst_saved: float = 1.0
    """The share saved of the device for which it is least."""
    longest_unheard: float = 0.0
    """Seconds."""
    margin: float = 1.0
    """The least part of its time that a device had left."""
    moves: int = 0
    misplaced: list[str] = field(default_factory=list)
    """Moves that ended elsewhere than where they were sent."""
    questions: int = 0
    wrong: list[str] = field(default_factory=list)
    """Answers to questions that were others' answers."""
    errors: Counter[str] = field(default_factory=Counter)
    """What moves and questions raised, and how often."""
    requests: int = 0
    retries: int = 0
    idle: float = 0.0
    """The longest time between the end of a transaction and the next frame, in seconds."""
    silence: float = 0.0
    """t3.5, which must be between them."""
    load: float = 0.0
    """The share of all time in which bytes were on the pair."""
    early_frames: int = 0
    memory: list[int] = field(default_factory=list)
    """kB after each minute of virtual time; empty where the system does not tell."""

    @property
    def saved_share(self) -> float:
        """The share of feeds that other traffic made unnecessary."""
        return self.saved / max(1, self.saved + self.feeds)

    @property
    def faults(self) -> list[str]:
        """What is wrong; empty if nothing is."""
        silence = (_HELD_UP, "a question raised DeviceOffline") if self.sluggish else (_HELD_UP,)
        expected = [what for what in self.errors if what.split(":")[0].endswith(_LOSSES) or what.startswith(silence)]
        unexpected = [what for what in self.errors if not (self.loss or self.sluggish) or what not in expected]
        growth = self.memory[-1] - self.memory[0] if self.memory else 0
        found = {
            f"{self.trips} drives tripped": self.trips,
            f"{len(self.misplaced)} moves ended elsewhere: {self.misplaced[:5]}": self.misplaced,
            f"{len(self.wrong)} wrong answers: {self.wrong[:5]}": self.wrong,
            f"unexpected: {unexpected}": unexpected,
            # Late replies take the wire from those who ask, and keep it quiet until they are over.
            f"only {self.saved_share:.1%} of the feeds were saved": not self.sluggish and self.saved_share <= MIN_SAVED,
            f"the wire was idle for {1000 * self.idle:.1f} ms": not self.sluggish and self.idle > self.silence + 0.0001,
            f"{self.early_frames} frames before t3.5": self.early_frames,
            f"memory grew by {growth} kB": growth > MAX_GROWTH,
            "nothing moved": not self.moves,
        }
        return [fault for fault, holds in found.items() if holds]

    def __str__(self) -> str:
        memory = f"{self.memory[0]} -> {self.memory[-1]} kB" if self.memory else "not told by this system"
        errors = ", ".join(f"{what}: {count}" for what, count in self.errors.most_common()) or "none"
        return "\n".join(
            (
                f"{self.devices} devices, {self.seconds:.0f} s of virtual time, {100 * self.loss:g} % of replies lost, "
                f"{self.wall:.0f} s of real time"
                + (f", {self.sluggish} more of them sluggish" if self.sluggish else ""),
                f"trips             {self.trips}",
                f"feeds saved       {self.saved_share:.2%} (least {self.worst_saved:.2%}), {self.feeds} sent",
                f"longest unheard   {self.longest_unheard:.3f} of {TIMEOUT:g} s, least margin {self.margin:.0%}",
                f"moves             {self.moves}, {len(self.misplaced)} ended elsewhere than they should",
                f"questions         {self.questions}, {len(self.wrong)} answered wrongly",
                f"errors            {errors}",
                f"requests          {self.requests}, {self.retries} retries, {self.early_frames} frames before t3.5",
                f"bus load          {self.load:.1%} airtime, idle for at most {1000 * self.idle:.2f} ms "
                f"(t3.5 is {1000 * self.silence:.2f} ms)",
                f"memory            {memory} (after the first minute, at the end)",
            )
        )


class Servo:
    """An MKS drive on the bus."""

    def __init__(self, bus: Bus, sim: SimMks) -> None:
        self.axis = MksServo(bus, sim.address, rpm=_MKS_RPM, acceleration=2000)
        self.questions: Sequence[Question] = (self.axis.position, self.axis.motor_status)
        self._sim = sim
        self._zero = 0.0

    async def begin_anew(self) -> None:
        """Take where it stands for zero."""
        await self.axis.set_zero()
        self._zero = self._sim.shaft(self.axis.bus.now())

    async def move(self, rng: random.Random) -> list[tuple[float, float]]:
        """Move it, by either verb; return where it should be and where it is, in turns."""
        target = rng.uniform(-_TURNS, _TURNS)
        if rng.random() < 0.5:
            await self.axis.move_to(target)
        else:
            move = self.axis.move_by(target / 4 if abs(self._at()) < _TURNS else -self._at() / 2)
            await move
            assert move.target is not None
            target = move.target
        return [(target, self._at())]

    @property
    def tolerance(self) -> float:
        """Turns."""
        return self.axis.tolerance / self.axis.counts_per_turn

    def _at(self) -> float:
        return self._sim.shaft(self.axis.bus.now()) - self._zero


class Base:
    """A ZLAC drive on the bus."""

    def __init__(self, bus: Bus, sim: SimZlac) -> None:
        self.axis = Zlac8015d(bus, sim.address, rpm=_ZLAC_RPM, acceleration=1000)
        self.questions: Sequence[Question] = (self.axis.left.position, self.axis.status)
        self._sim = sim

    async def move(self, rng: random.Random) -> list[tuple[float, float]]:
        """Move both wheels at once, or one of them; return where they should be and where they are, in turns."""
        left, right = rng.uniform(-_TURNS, _TURNS), rng.uniform(-_TURNS, _TURNS)
        if rng.random() < 0.5:
            await self.axis.move_to(left, right)
        else:
            right = self._at()[1]
            await self.axis.left.move_to(left)
        return list(zip((left, right), self._at(), strict=True))

    @property
    def tolerance(self) -> float:
        """Turns."""
        return self.axis.left.tolerance / self.axis.left.counts_per_turn

    def _at(self) -> tuple[float, float]:
        left, right = self._sim.shafts(self.axis.bus.now())
        return left, right


class Endurance:
    """One run.

    Args:
        seconds: virtual time.
        devices: how many drives; every other one is an MKS.
        loss: the share of replies that are lost, 0..1.
        sluggish: how many other devices are asked, whose replies take 1 ms mostly and 2 s now and then.
        seed: makes it reproducible.
        baudrate: bit/s.
        progress: told after each minute how many seconds have passed.
    """

    def __init__(
        self,
        seconds: float,
        *,
        devices: int = 31,
        loss: float = 0.0,
        sluggish: int = 0,
        seed: int = 1,
        baudrate: int = 115200,
        progress: Callable[[float], None] = lambda _: None,
    ) -> None:
        self._seconds = seconds
        self._seed = seed
        self._progress = progress
        self._servos = [SimMks(address) for address in range(1, devices + 1, 2)]
        self._bases = [SimZlac(address) for address in range(2, devices + 1, 2)]
        self._sluggish = Sluggish(range(devices + 1, devices + 1 + sluggish), seed)
        sims = (*self._servos, *self._bases, *self._sluggish.devices)
        self._line = VirtualLine(*sims, baudrate=baudrate, noise=Noise(lost_reply=loss), seed=seed)
        if sluggish:
            self._line.pair.script = self._sluggish.script
        self._verdict = Verdict(devices, loss, sluggish, silence=self._line.line.t35)
        self._ends_at = 0.0
        self._over = False
        self._ended_at: float | None = None

    def run(self) -> Verdict:
        """Run to the end, on a virtual clock; return what was found."""
        begun = time.perf_counter()
        with asyncio.Runner(loop_factory=VirtualClockLoop) as runner:
            runner.run(self._run())
        verdict = self._verdict
        verdict.trips = sum(len(sim.trips) for sim in self._servos) + sum(len(sim.trips) for sim in self._bases)
        verdict.early_frames = self._line.pair.early_frames
        verdict.wall = time.perf_counter() - begun
        return verdict

    async def _run(self) -> None:
        config = BusConfig(reply_timeout=_REPLY_TIMEOUT)
        if self._sluggish.devices:
            config = replace(config, late_reply_window=LONGEST)  # by default a reply is late by 0.5 s at most
        async with open_bus(self._line, config=config) as bus:
            drives: list[Servo | Base] = [Servo(bus, sim) for sim in self._servos]
            drives += [Base(bus, sim) for sim in self._bases]
            axes = [drive.axis for drive in drives]
            for axis in axes:
                await axis.enable()
            async with bus.watchdog(*axes, timeout=TIMEOUT) as watchdog:
                await self._saturate(bus, drives, watchdog)

    async def _saturate(self, bus: Bus, drives: list[Servo | Base], watchdog: WatchdogGuard) -> None:
        """Ask and move until the time is over and the last move has ended."""
        verdict = self._verdict
        before = {report.address: report for report in watchdog.report()}
        stats = bus.stats
        transactions, airtime, begun = stats.transactions, stats.airtime, bus.now()
        self._ends_at = begun + self._seconds
        askers = [asyncio.create_task(self._ask(drive.questions)) for drive in drives]
        askers += [asyncio.create_task(self._ask([question])) for question in self._sluggish.questions(bus)]
        keeper = asyncio.create_task(self._keep_the_time(bus))
        await asyncio.sleep(0.1)
        unsubscribe = bus.subscribe(self._note)
        await asyncio.gather(*(self._move(drive, random.Random(self._seed + at)) for at, drive in enumerate(drives)))
        unsubscribe()
        self._over = True
        await asyncio.gather(*askers)
        keeper.cancel()
        stats = bus.stats
        verdict.wrong = self._sluggish.wrong
        verdict.seconds = bus.now() - begun
        verdict.load = (stats.airtime - airtime) / verdict.seconds
        verdict.retries = sum(unit.retries for unit in stats.units.values())
        verdict.requests = stats.transactions - transactions
        for report in watchdog.report():
            feeds = report.feeds - before[report.address].feeds
            saved = report.saved - before[report.address].saved
            verdict.feeds += feeds
            verdict.saved += saved
            verdict.worst_saved = min(verdict.worst_saved, saved / max(1, saved + feeds))
            verdict.longest_unheard = max(verdict.longest_unheard, report.longest)
            verdict.margin = min(verdict.margin, report.margin)

    def _note(self, record: Record) -> None:
        if self._ended_at is not None:
            self._verdict.idle = max(self._verdict.idle, record.sent_at - self._ended_at)
        self._ended_at = record.ended_at

    async def _ask(self, questions: Sequence[Question]) -> None:
        while not self._over:
            for question in questions:
                try:
                    await question()
                except BusError as error:
                    self._failed("a question", error)
                    await asyncio.sleep(_AFTER_AN_ERROR)
                else:
                    self._verdict.questions += 1

    async def _move(self, drive: Servo | Base, rng: random.Random) -> None:
        loop = asyncio.get_running_loop()
        while loop.time() < self._ends_at:
            try:
                for target, position in await drive.move(rng):
                    if abs(position - target) > drive.tolerance:
                        self._verdict.misplaced.append(f"{drive.axis.name} at {position:.4f}, sent to {target:.4f}")
            except BusError as error:
                self._failed("a move", error)
                await self._recover(drive, error)
            else:
                self._verdict.moves += 1
            await asyncio.sleep(rng.uniform(*_PAUSES))

    async def _recover(self, drive: Servo | Base, error: BusError) -> None:
        """What an application does after a move failed."""
        try:
            await drive.axis.enable()
            if isinstance(error, OutcomeUnknown) and isinstance(drive, Servo):
                await drive.begin_anew()  # its drive might have restarted
        except BusError as error:
            self._failed("a recovery", error)

    def _failed(self, what: str, error: BusError) -> None:
        why = "" if isinstance(error, NoReply) else f": {str(error).partition(': function ')[0]}"
        self._verdict.errors[f"{what} raised {type(error).__name__}{why}"] += 1

    async def _keep_the_time(self, bus: Bus) -> None:
        begun = bus.now()
        while True:
            await asyncio.sleep(60.0)
            gc.collect()
            used = _memory()
            if used is not None:
                self._verdict.memory.append(used)
            self._progress(bus.now() - begun)


def _memory() -> int | None:
    """What the process has in memory, in kB; None where the system does not tell."""
    try:
        with open("/proc/self/status") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("VmRSS:"))
    except (OSError, StopIteration):
        return None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=1.0, help="virtual time")
    parser.add_argument("--loss", type=float, default=0.0, help="the share of replies that are lost: 0.05")
    parser.add_argument("--sluggish", type=int, default=0, help="so many more devices that answer late now and then")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--devices", type=int, default=31)
    parser.add_argument("--baudrate", type=int, default=115200)
    options = parser.parse_args()
    terminal, begun = sys.stdout.isatty(), time.perf_counter()

    def progress(seconds: float) -> None:
        if terminal:
            took = time.perf_counter() - begun
            left = max(0.0, took * (options.hours * 3600 / seconds - 1))
            print(f"\r{seconds / 60:.0f} of {options.hours * 60:g} minutes, {left:.0f} s to go   ", end="", flush=True)

    run = Endurance(
        options.hours * 3600,
        devices=options.devices,
        loss=options.loss,
        sluggish=options.sluggish,
        seed=options.seed,
        baudrate=options.baudrate,
        progress=progress,
    )
    verdict = run.run()
    print("\r\033[K" if terminal else "", verdict, sep="")
    for fault in verdict.faults or ["nothing"]:
        print("wrong:", fault)
    return 1 if verdict.faults else 0


if __name__ == "__main__":
    sys.exit(main())
