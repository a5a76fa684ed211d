"""The owner among everything that can happen to it, and a judge that knows what the slaves really did.

The owner is driven by plain calls in virtual time. What is asked, what the line does and who fails is a list of steps,
so that each run can be had again. The judge knows the promises alone: every job ends once and in time, what is said is
so, nothing older follows a stop.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from typing import Any

from rs485bus.bus.config import BusConfig
from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.job import Job, Urgency
from rs485bus.bus.schedule.verification import holds
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.watchdog.guarding import emergency_stop
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.frames import write_block
from rs485bus.wire.frames import Request, read_holding, read_input, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from rs485bus.wire.timing import LineSettings
from tests.endings.cable import Cable, Sent
from tests.endings.records import MEMORY, NEVER, REPLY_TIMEOUT, RETRIES, Asked, Boom, Setting, Step, Stop
from tests.endings.slaves import Done, Memory, Mks, Reaction, Slave
from tests.endings.truth import is_stop, untrue


class World:
    """An owner, its line, its slaves, and the judge."""

    def __init__(self, setting: Setting) -> None:
        self.setting = setting
        line = LineSettings(baudrate=setting.baudrate)
        self.config = BusConfig(
            reply_timeout=REPLY_TIMEOUT, retries=RETRIES, echo=setting.echo_config, turnaround=0.02, max_queued=1000
        )
        self.now = 1000.0
        self.owner = Owner(line, self.config, self.now - 1, gateway=setting.gateway)
        self.silence = self.config.silence_on(line, setting.gateway)
        self.drives = {address: Mks(address, by_silence=setting.by_silence) for address in range(1, setting.drives + 1)}
        for drive in self.drives.values():
            drive.lies = setting.lying
        plain = range(10, 10 + setting.slaves)
        self.slaves: dict[int, Slave] = {
            address: Slave(address, setting.by_silence, answers_broadcasts=setting.answers_broadcasts)
            for address in plain
        }
        self.slaves[MEMORY] = Memory(MEMORY, by_silence=setting.by_silence)
        self.slaves.update(self.drives)
        self.cable = Cable(
            line.character,
            line.t35,
            list(self.slaves.values()),
            echo=setting.echo,
            latency=setting.latency,
            gateway=setting.gateway,
            latest=4.8 if setting.gateway else 0.5,
        )
        self.attached: dict[int, MksDrive] = {}
        for address in self.drives:
            attached = MksDrive(address)
            self.owner.units[address].attach(attached)
            self.attached[address] = attached
        self.asked: list[Asked] = []
        self.stops: list[Stop] = []
        self.emergencies: list[list[float]] = []
        self.wrong: list[str] = []
        self.closed_at = NEVER
        self.away_since = NEVER
        self.away: list[tuple[float, float]] = []
        self.babble_until = 0.0
        self.babbles = 0.0
        self.babble_gap = (0.001, 0.001)
        self.heard_at = self.now - 1.0
        self.deaf = 0.0
        """Seconds since then in which the owner sent, and could not hear whether the line was quiet."""
        self.noisy_since = NEVER
        self.last_end = self.now - 1.0
        self.counts: Counter[str] = Counter()
        self.rng = random.Random(0)
        self.token = 1000
        self._open: dict[int, Asked] = {}
        self._latched = False
        self._spins = 0

    # Time

    def run(self, until: float) -> None:
        """Let time pass."""
        self._tick()
        while True:
            following = min(self.owner.wake, self.cable.next_at)
            if following > until:
                break
            if following <= self.now:
                self._spins += 1
                if self._spins > 3000:
                    self._fault(f"it spins at {self.now:.4f}")
                    raise AssertionError(self.wrong)
            else:
                self._spins = 0
                self.now = following
            for piece in self.cable.advance(self.now):
                if self.closed_at < NEVER or not self.cable.connected:
                    continue
                if self.now - self.heard_at - self.deaf > 0.02:
                    self.noisy_since = self.now
                self.heard_at, self.deaf = self.now, max(0.0, self.last_end - self.now)
                self._call(self.owner.feed, piece, self.now)
            self._tick()
        self.now = max(self.now, until)

    def _tick(self) -> None:
        if self.closed_at < NEVER:
            frame = self._call(self.owner.tick, self.now)
            if frame is not None and frame[:2] not in (b"",) and not is_stop(frame):
                self._fault(f"sent after closing: {frame.hex(' ')}")
            return
        frame = self._call(self.owner.tick, self.now)
        self._attribute(frame)

    def _attribute(self, frame: bytes | None) -> None:
        mine = None
        for asked in (*self._open.values(), *self._just_ended()):
            if asked.job.attempts != asked.attempts:
                asked.attempts = asked.job.attempts
                if frame is not None and asked.job.request.adu == frame:
                    mine = asked
        if frame is None:
            return
        if not self.cable.connected:
            self._fault(f"sent while the port is away: {frame.hex(' ')}")
        start = self.owner.send_at if self.owner.send_at > self.now else self.now
        self._check_silence(frame, start)
        if mine is None or mine.job.urgency is not Urgency.STOP:
            self._check_turnaround(frame, start)
        sent = self.cable.transmit(frame, start)
        self.last_end = sent.end
        self.deaf += sent.end - sent.start
        if mine is not None:
            assert mine.sent is not None
            mine.sent.append(sent)
            self._check_may_go(mine, sent)
        self.counts["frames"] += 1

    def _just_ended(self) -> list[Asked]:
        ended, self._ended = self.__dict__.get("_ended", []), []
        return ended

    def _call(self, function: Callable[..., Any], *args: Any) -> Any:
        try:
            return function(*args)
        except Boom:
            self.counts["boom"] += 1
            return None

    def _check_turnaround(self, frame: bytes, start: float) -> None:
        before = self.cable.sent[-1] if self.cable.sent else None
        if before is not None and before.frame[0] == 0 and not is_stop(frame):
            turned = start - before.end
            if turned < self.config.turnaround - 1e-6 and not any(end >= before.start for _, end in self.away):
                self._fault(f"a frame {turned * 1000:.3f} ms after a broadcast: {frame.hex(' ')}")

    def _check_silence(self, frame: bytes, start: float) -> None:
        quiet = start - max(self.heard_at, self.last_end)
        if quiet < self.silence - 1e-6:
            # A stop goes out over what never gets quiet, and at last the looks that confirm it.
            urgent = any(asked.job.urgency is Urgency.STOP for asked in self.asked if asked.job.request.adu == frame)
            looks = frame[0] in self.drives and frame[1] == 4
            waits = 0.019 if urgent or is_stop(frame) else 0.24 if looks else float("inf")
            if start - self.noisy_since >= waits and start >= self.last_end:
                return
            self._fault(f"a frame after {quiet * 1000:.3f} ms of silence: {frame.hex(' ')}")

    def _check_may_go(self, asked: Asked, sent: Sent) -> None:
        job = asked.job
        if asked.cancelled_at < self.now and job.urgency is not Urgency.STOP:
            self._fault(f"{asked.number} was sent after it was cancelled")
        if job.moves and job.motion is not None:
            for stop in self.stops:
                if stop.address == job.address and asked.at < stop.at < self.now:
                    self._fault(f"{asked.number} moves, is older than a stop, and was sent after it")
        if job.moves and not job.internal:
            for times in self.emergencies:
                if asked.at < times[0] < self.now:
                    self._fault(f"{asked.number} moves, is older than an emergency stop, and was sent after it")
            for begun, _ in self.away:
                if asked.at < begun < self.now:
                    self._fault(f"{asked.number} moves, is older than an unplugging, and was sent after it")
        if job.repeat is Repeat.NEVER and len(asked.sent or ()) > 1:
            self._fault(f"{asked.number} must not be repeated and was")

    # Steps

    def step(self, step: Step) -> None:
        """Let time pass, then do what a step says."""
        self.run(self.now + step.after)
        getattr(self, f"do_{step.name}")(*step.args)

    def submit(self, request: Request, *, raises: bool = False, **options: Any) -> Asked:
        number = len(self.asked)

        def ended(job: Job) -> None:
            asked.ends += 1
            asked.outcome = job.outcome
            if asked.ends > 1:
                self._fault(f"{number} ended twice")
            asked.ended_at = self.now
            self._open.pop(number, None)
            self.__dict__.setdefault("_ended", []).append(asked)
            self.counts[job.outcome.value if job.outcome is not None else "none"] += 1
            if raises and self.setting.raising:
                raise Boom

        job = Job(request, on_end=ended, **options)
        asked = Asked(job, number, self.now, sent=[], raises=raises, waited_for=len(self._open))
        for other in self._open.values():
            other.waited_for += 1
        self.asked.append(asked)
        self._open[number] = asked
        self._call(self.owner.submit, job, self.now)
        if job.outcome is not None and not asked.ends:
            self._fault(f"{number} has an outcome, and nobody was told")
        self._tick()
        return asked

    def do_read(self, address: int, register: int, count: int, holding: bool, urgency: int, timeout: float) -> None:
        request = (read_holding if holding else read_input)(address, register, count)
        self.submit(request, urgency=Urgency(urgency), expires_at=self.now + timeout if timeout else None)

    def do_write(
        self, address: int, register: int, value: int, many: bool, safe: bool, timeout: float, raises: bool
    ) -> None:
        one, both = write_single(address, register, value), write_multiple(address, register, [value, value])
        request = both if many else one
        attached = self.attached.get(address)
        self.submit(
            request,
            repeat=Repeat.SAFE if safe else Repeat.NEVER,
            moves=True,
            motion=None if attached is None else attached.motion,
            expires_at=self.now + timeout if timeout else None,
            raises=raises,
        )

    def do_verify(self, register: int, value: int, timeout: float) -> None:
        """A write to the slave with a memory, with a read-back."""
        self.token += 1
        values = [self.token, value]
        self.submit(
            write_multiple(MEMORY, register, values),
            repeat=Repeat.VERIFY,
            verify=holds(MEMORY, register, values),
            moves=True,
            expires_at=self.now + timeout if timeout else None,
        )

    def do_setting(self, address: int, register: int, value: int) -> None:
        """A write to a drive, refused inside its reply where it does not like it."""
        self.submit(write_single(address, register, value, hidden_refusal=True), repeat=Repeat.SAFE)

    def do_move(self, address: int, rpm: int, timeout: float) -> None:
        self.token += 1
        request = write_block(address, r.MOVE_TO_COUNTS, 250, rpm, 10_000_000 + self.token)
        self.submit(
            request,
            repeat=Repeat.NEVER,
            moves=True,
            motion=self.attached[address].motion,
            expires_at=self.now + timeout if timeout else None,
        )

    def do_broadcast(self, register: int, value: int) -> None:
        self.submit(write_single(0, register, value), repeat=Repeat.NEVER, moves=True)

    def do_cancel(self, which: int) -> None:
        if self.asked:
            asked = self.asked[which % len(self.asked)]
            if not asked.ends:
                asked.cancelled_at = self.now
                self._call(self.owner.cancel, asked.job, self.now)
                self._tick()

    def do_stop(self, address: int, emergency: bool, raises: bool) -> None:
        attached = self.attached[address]
        stop = Stop(address, self.now, [])
        for other in self.stops:
            if other.address == address:
                other.was_latest = False
        self.stops.append(stop)

        def told(halted: Halted) -> None:
            stop.told.append((self.now, halted.standing))
            if halted.standing:
                self._check_stands(stop)
            if raises and self.setting.raising:
                raise Boom

        self.owner.now = self.now
        halt = self._call(
            lambda: self.owner.stops.halt(self.owner.units[address], attached.motion, emergency=emergency)
        )
        if halt is not None:
            self._call(halt.listen, told)
        else:
            self.stops.remove(stop)
        self._tick()

    def _check_stands(self, stop: Stop) -> None:
        drive = self.drives[stop.address]
        if any(
            asked.job.moves and asked.job.address in (0, stop.address) and asked.at >= stop.at for asked in self.asked
        ):
            return
        if drive.moves(self.now):
            self._fault(f"drive {stop.address} is said to stand, and turns")

    def do_emergency(self) -> None:
        times = [self.now]
        self.emergencies.append(times)
        self.owner.now = self.now
        self._latched = True
        self._call(self.owner.start, emergency_stop(self.owner), lambda report: times.append(self.now))
        self._tick()

    def do_clear(self) -> None:
        if self.emergencies and all(len(times) > 1 for times in self.emergencies):
            self.owner.gate.latched = False
            for address in self.drives:
                self.owner.units[address].locked = ""  # as enabling it does

    def do_unplug(self) -> None:
        if self.cable.connected and self.closed_at == NEVER:
            self.cable.unplug()
            self.away.append((self.now, NEVER))
            self._call(self.owner.unplugged, self.now)
            self._tick()

    def do_plug(self) -> None:
        if not self.cable.connected and self.closed_at == NEVER:
            self.run(max(self.now, self.away[-1][0] + 0.01))  # no port comes back sooner
            self.cable.plug()
            self.away[-1] = (self.away[-1][0], self.now)
            self._call(self.owner.plugged, self.now)
            self._tick()

    def do_close(self) -> None:
        if self.closed_at == NEVER:
            self._call(self.owner.close, self.now)
            self.closed_at = self.now
            self._tick()
            for asked in self.asked:
                if not asked.ends:
                    self._fault(f"{asked.number} has not ended, and the bus is closed: {asked.job.request}")
            for stop in self.stops:
                if not stop.told:
                    self._fault(f"whoever waits for the stop of {stop.address} is not told that the bus is closed")
            for times in self.emergencies:
                if len(times) < 2:
                    self._fault("whoever waits for an emergency stop is not told that the bus is closed")

    def do_react(self, address: int, reaction: Reaction) -> None:
        self.slaves[address].reactions.append(reaction)

    def do_die(self, address: int, seconds: float) -> None:
        self.slaves[address].dead_until = self.now + seconds

    def do_noise(self, data: bytes) -> None:
        if self.cable.connected:
            self.cable.noise(data, self.now)

    def do_babble(self, seconds: float, low: float, high: float) -> None:
        fresh = self.babble_until <= self.now
        self.babble_until = max(self.babble_until, self.now + seconds)
        self.babbles += seconds
        self.babble_gap = (low, high)
        if fresh:
            self.cable.at(self.now, self._babble)

    def _babble(self, now: float) -> None:
        if now < self.babble_until and self.closed_at == NEVER:
            self.cable.noise(bytes([self.rng.randrange(256)]), now)
            low, high = self.babble_gap
            self.cable.at(now + self.rng.uniform(low, high), self._babble)

    def do_observe(self, raises: bool) -> None:
        def observer(record: object) -> None:
            if raises:
                raise Boom

        self.owner.journal.subscribe(observer)

    # The end

    def finish(self) -> list[str]:
        """Wait for what still must end, judge it all, close; return what is wrong."""
        while self._open or any(not stop.told for stop in self.stops):
            if self.closed_at < NEVER:
                break
            due = max(
                [self.due(asked) for asked in self._open.values()]
                + [self._stop_due(stop) for stop in self.stops if not stop.told]
            )
            if due <= self.now:
                break
            self.run(min(due, self.now + 1.0))
        for asked in self.asked:
            if not asked.ends:
                self._fault(
                    f"{asked.number} never ended: {asked.job.request}, asked at {asked.at:.3f}, now {self.now:.3f}"
                )
            elif asked.ended_at > self.due(asked) + 1e-6:
                late = asked.ended_at - self.due(asked)
                self._fault(f"{asked.number} ended {late:.3f} s after it was due ({asked.outcome})")
        for stop in self.stops:
            if not stop.told and self.closed_at == NEVER:
                self._fault(f"the stop of {stop.address} asked for at {stop.at:.3f} was neither confirmed nor reported")
            elif len(stop.told) > 1:
                self._fault(f"the stop of {stop.address} was told {len(stop.told)} times")
        self.do_close()
        self.run(self.now + 6.0)
        self._judge()
        return self.wrong

    def due(self, asked: Asked) -> float:
        """When a job must have ended at the latest."""
        job = asked.job
        air = (len(job.request.adu) + max(8, job.request.length)) * self.cable.character
        attempt = air + REPLY_TIMEOUT + self.setting.latency + 0.005
        if job.expires_at is not None:
            return job.expires_at + attempt
        window = 5.0 if self.setting.gateway else 0.75
        reads = 4 if job.repeat is Repeat.VERIFY else 1
        each = reads * (1 + RETRIES) * (REPLY_TIMEOUT + 0.03 + self.setting.latency + self.silence) + window
        away = 30.0 if any(end > asked.at for _, end in self.away) else 0.0
        stops = sum(5.0 for stop in self.stops if stop.at < asked.ended_at)
        return (
            asked.at + 1.1 + away + self.babbles + each * (asked.waited_for + 1) + stops + 2.0 * len(self.emergencies)
        )

    def _stop_due(self, stop: Stop) -> float:
        away = 60.0 if any(end > stop.at for _, end in self.away) else 0.0
        return stop.at + 10.0 + away + 2 * len(self.stops) + self.babbles

    def _judge(self) -> None:
        done: dict[Sent, list[Done]] = {}
        for slave in self.slaves.values():
            for one in slave.done:
                done.setdefault(one.sent, []).append(one)
        for asked in self.asked:
            fault = untrue(asked, done, self.slaves)
            if fault:
                self._fault(f"{asked.number}: {fault}: {asked.job.request}, {asked.outcome}, {asked.job.attempts} sent")

    def _fault(self, what: str) -> None:
        self.wrong.append(what)


def play(setting: Setting, steps: list[Step]) -> World:
    """Run a list of steps to the end."""
    world = World(setting)
    world.rng = random.Random(len(steps))
    for step in steps:
        world.step(step)
    world.finish()
    return world
