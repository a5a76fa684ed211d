"""The tightest watchdogs that are admitted, and all that they must stand at once.

    python -m rs485bus.sim.stress tight --hours 1

The drives are watched, and nothing but feeds feeds them. Beside that go the longest transactions that are allowed,
broadcasts and bursts; and an adversary loses two replies in a row, again and again, each time at the moment that hurts
most. Wrong is: a device that the bus takes for tripped, one that was unheard for its time, a set that is admitted
though it is one step tighter, and a bus on which nothing else is ever done.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field

from rs485bus.bus.schedule.burst import Burst, BurstSlot
from rs485bus.bus.schedule.job import Job, Urgency
from rs485bus.devices.mks import registers as mks
from rs485bus.devices.mks.frames import write
from rs485bus.sim.campaigns.guarded import Drive, Plant, arm
from rs485bus.sim.device import SimDevice, SimUnit
from rs485bus.sim.mks import SimMks
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding, write_single

_SLOW_UNIT = 200
_PATIENCE = 10
"""Times between two attacks in which the adversary waits for a moment as bad as the worst it has seen."""
_ANYWHERE = 0.001
"""How likely it attacks at any other moment."""
_EVERYBODY = 0x4000
"""A register that no drive has: a broadcast to it does nothing."""


class Adversary:
    """Loses two replies in a row, again and again.

    Args:
        rig: the bus.
        pause: seconds between two attacks at the least.
        rng: chooses.
    """

    def __init__(self, rig: Rig, pause: float, rng: random.Random) -> None:
        self.attacks = 0
        self._rig = rig
        self._pause = pause
        self._rng = rng
        self._next_at = rig.now + pause
        self._left = 0
        self._worst = 0.0
        for device in rig.pair.devices:
            self._stand_between(device)

    def _stand_between(self, device: SimDevice) -> None:
        receive = device.receive

        def lossy(frame: bytes, now: float) -> bytes | None:
            if frame[0] == device.address and self._loses(frame, now):
                # Either the drive never heard it, or its reply is lost: the bus cannot tell.
                if self._rng.random() < 0.5:
                    receive(frame, now)
                return None
            return receive(frame, now)

        device.receive = lossy  # type: ignore[method-assign] # the adversary stands between

    def _loses(self, frame: bytes, now: float) -> bool:
        if self._left:
            self._left -= 1
            if not self._left:
                self._next_at = now + self._pause
            return True
        if now < self._next_at:
            return False
        # The moment that hurts most: a drive is asked that was to be asked long ago.
        watch = self._rig.owner.feeding.get(frame[0])
        late = -1.0 if watch is None else (now - watch.due) / watch.timeout
        impatience = (now - self._next_at) / (_PATIENCE * self._pause)
        if late >= self._worst * (0.98 - impatience) or self._rng.random() < _ANYWHERE:
            self._worst = max(self._worst, late)
            self._left = 1
            self.attacks += 1
            return True
        return False


@dataclass
class Verdict:
    """What was found. `faults` must be empty."""

    plant: Plant
    timeout: float
    seconds: float = 0.0
    attacks: int = 0
    transactions: int = 0
    done: int = 0
    """Requests of applications that were answered."""
    longest: float = 0.0
    """The longest time that a drive was unheard, or that the bus took it for unheard, as a share of its time."""
    faults: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        turnarounds = "/".join(f"{1000 * each:g}" for each in self.plant.turnarounds)
        return (
            f"{self.plant.count:2d} drives, {self.plant.baudrate:6d} baud, answers after {turnarounds:>8} ms, "
            f"{1000 * self.timeout:5.0f} ms: {self.seconds:.0f} s, {self.transactions} transactions, {self.done} of "
            f"applications, {self.attacks} attacks, unheard for {self.longest:.0%}, {len(self.faults)} faults"
        )


def stress(plant: Plant, seconds: float, seed: int = 1, timeout: float | None = None) -> Verdict:
    """Guard the tightest set that is admitted, and let everything happen at once."""
    timeout = plant.tightest() if timeout is None else timeout
    rng = random.Random(seed)
    verdict = Verdict(plant, timeout)
    rig, drives = plant.build()
    ended = arm(rig, drives, timeout)
    if ended.failed or ended.infeasible:
        verdict.faults.append(f"could not be armed: {ended.failed or ended.infeasible}")
        return verdict
    tighter, others = plant.build()
    if timeout > 0.001 and arm(tighter, others, timeout - 0.001).infeasible is None:
        verdict.faults.append("one step tighter is admitted, too")
    adversary = Adversary(rig, timeout, rng)
    Traffic(rig, drives, rng, verdict)
    begun = rig.now
    rig.run(seconds)
    verdict.seconds = rig.now - begun
    verdict.attacks = adversary.attacks
    verdict.transactions = rig.owner.journal.stats.transactions
    for drive in drives:
        verdict.faults += [f"unit {drive.sim.address}: {reason}" for _, reason in drive.told]
        longest = drive.unheard_until(rig.now)
        watch = rig.owner.feeding.get(drive.sim.address)
        believed = 0.0 if watch is None else watch.longest
        verdict.longest = max(verdict.longest, longest / timeout, believed / timeout)
        if longest > timeout:
            verdict.faults.append(f"unit {drive.sim.address} was unheard for {longest:.3f} s")
    if rig.owner.feeding.strain.holds:
        verdict.faults.append(f"feeds need more than was admitted: {rig.owner.feeding.reckoning}")
    if not verdict.done:
        verdict.faults.append("nothing else was ever done")
    return verdict


class Traffic:
    """The longest transactions that are allowed, without a pause; broadcasts; and bursts."""

    def __init__(self, rig: Rig, drives: list[Drive], rng: random.Random, verdict: Verdict) -> None:
        self._rig = rig
        slow = SimUnit(_SLOW_UNIT, dict.fromkeys(range(125), 0))
        slow.turnaround = rig.owner.config.reply_timeout - 0.0005
        rig.pair.devices.append(slow)
        self._drives = [drive for drive in drives if isinstance(drive.sim, SimMks)]
        self._rng = rng
        self._verdict = verdict
        line, config = rig.owner.pair.line, rig.owner.config
        silence = rig.owner.pair.silence
        allowed = rig.owner.feeding.slack - config.reply_timeout - silence
        registers = max(1, min(125, int((allowed / line.character - 13) / 2)))
        self._longest = read_holding(_SLOW_UNIT, 0, registers)
        for urgency in (Urgency.COMMAND, Urgency.POLL):
            self._ask(urgency)
        self._broadcast()
        self._burst()

    def _ask(self, urgency: Urgency) -> None:
        def ended(job: Job) -> None:
            self._verdict.done += bool(job.reply)
            self._rig.at(self._rig.now + self._rng.choice((0.0, 0.0, 0.01)), lambda: self._ask(urgency))

        self._rig.owner.submit(Job(self._longest, urgency=urgency, on_end=ended), self._rig.now)

    def _broadcast(self) -> None:
        self._rig.owner.submit(Job(write_single(0, _EVERYBODY, 1)), self._rig.now)
        self._rig.at(self._rig.now + self._rng.uniform(0.2, 1.5), self._broadcast)

    def _burst(self) -> None:
        both = self._drives[:2]
        burst = Burst(len(both))
        for place, drive in enumerate(both):
            request = write(drive.sim.address, mks.SCREEN_OFF, value=False)
            self._rig.owner.submit(Job(request, slot=BurstSlot(burst, place)), self._rig.now)
        self._rig.at(self._rig.now + self._rng.uniform(0.5, 2.0), self._burst)
