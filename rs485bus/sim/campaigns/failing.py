"""Guarded drives that die or become slow, all at once: who is told, who is stopped, and that nobody else trips.

python -m rs485bus.sim.stress deaths
python -m rs485bus.sim.stress slow
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field

from rs485bus.bus.schedule.job import Job
from rs485bus.sim.campaigns.guarded import Drive, Plant, arm
from rs485bus.sim.device import SimUnit
from rs485bus.wire.frames import read_holding

_QUICK_UNIT = 201


@dataclass
class Deaths:
    """What was found when some drives died. `faults` must be empty."""

    plant: Plant
    dead: int
    timeout: float
    told: list[float] = field(default_factory=list)
    """When each dead drive was told to be lost, in seconds after it was heard last."""
    done: int = 0
    """Requests to the drives that live that were answered meanwhile."""
    faults: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        told = f"{min(self.told):.3f} to {max(self.told):.3f} s" if self.told else "never"
        return (
            f"{self.dead:2d} of {self.plant.count:2d} dead, {self.plant.baudrate} baud, {1000 * self.timeout:.0f} ms: "
            f"told after {told}, {self.done} requests to the others, {len(self.faults)} faults"
        )


def die(plant: Plant, dead: int, timeout: float, *, pressed: float | None = None, seed: int = 1) -> Deaths:
    """Some drives die, all at once, while they move; applications go on asking the others.

    Args:
        plant: what is guarded.
        dead: how many die.
        timeout: the time of the watchdogs, in seconds.
        pressed: seconds after which somebody stops the dead ones again and again; None where nobody does.
        seed: chooses which, and when.
    """
    rng = random.Random(seed)
    verdict = Deaths(plant, dead, timeout)
    rig, drives = plant.build()
    ended = arm(rig, drives, timeout)
    if ended.failed or ended.infeasible:
        verdict.faults.append(f"could not be armed: {ended.failed or ended.infeasible}")
        return verdict
    rig.run(timeout * rng.uniform(1.0, 2.0))
    lost = rng.sample(drives, dead)
    live = [drive for drive in drives if drive not in lost]
    for drive in lost:
        drive.adapter.motion.commanded(rig.now)
        drive.dead = True

    def ask(drive: Drive) -> None:
        def answered(job: Job) -> None:
            verdict.done += bool(job.reply)
            rig.at(rig.now + 0.05, lambda: ask(drive))

        # Another register than feeds read, longer than they are: it does not stand in for one.
        request = drive.adapter.reads()[-1]
        rig.owner.submit(Job(request, on_end=answered), rig.now)

    def press(drive: Drive) -> None:
        rig.owner.now = rig.now
        rig.owner.stops.halt(rig.owner.units[drive.sim.address], drive.adapter.motion, emergency=True)
        assert pressed is not None
        rig.at(rig.now + pressed, lambda: press(drive))

    for drive in live[:2]:
        ask(drive)
    for drive in lost:
        if pressed is not None:
            press(drive)
    rig.run(4 * timeout + 1.0)
    for drive in lost:
        assert drive.heard_at is not None
        if drive.told:
            verdict.told.append(drive.told[0][0] - drive.heard_at)
        if not drive.told or verdict.told[-1] > timeout + 0.001:
            verdict.faults.append(f"unit {drive.sim.address} is dead, and nobody was told in its time")
    for drive in live:
        verdict.faults += [f"unit {drive.sim.address} lives: {reason}" for _, reason in drive.told]
        if drive.unheard_until(rig.now) > timeout:
            verdict.faults.append(f"unit {drive.sim.address} lives, and was unheard for {drive.longest:.3f} s")
    if live and not verdict.done:
        verdict.faults.append("the others were never answered")
    return verdict


@dataclass
class Slowness:
    """What was found when some drives became slow. `faults` must be empty."""

    plant: Plant
    slow: int
    timeout: float
    warned: int = 0
    """How often it was told that feeding takes more than was admitted."""
    stopped: list[int] = field(default_factory=list)
    """The drives that were given up."""
    done: int = 0
    """Requests to another device that were answered."""
    waited: float = 0.0
    """The longest time that one of them took, in seconds."""
    faults: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        return (
            f"{self.slow:2d} of {self.plant.count:2d} became slow, {self.plant.baudrate} baud, "
            f"{1000 * self.timeout:.0f} ms: warned {self.warned} times, {len(self.stopped)} stopped, {self.done} "
            f"requests to others done within {1000 * self.waited:.0f} ms, {len(self.faults)} faults"
        )


def slow_down(plant: Plant, slow: int, timeout: float, *, times: float = 10.0, seed: int = 1) -> Slowness:
    """Some drives become slow, all at once; applications go on asking another device.

    Args:
        plant: what is guarded.
        slow: how many become slow.
        timeout: the time of the watchdogs, in seconds.
        times: how many times as long they take to answer.
        seed: chooses which, and when.
    """
    rng = random.Random(seed)
    verdict = Slowness(plant, slow, timeout)
    rig, drives = plant.build()
    quick = SimUnit(_QUICK_UNIT, {0: 0})
    rig.pair.devices.append(quick)
    ended = arm(rig, drives, timeout)
    if ended.failed or ended.infeasible:
        verdict.faults.append(f"could not be armed: {ended.failed or ended.infeasible}")
        return verdict

    def warned(reckoning: object, slowest: object) -> None:
        verdict.warned += 1

    rig.owner.feeding.on_strain = warned
    rig.run(timeout * rng.uniform(1.0, 2.0))
    for drive in rng.sample(drives, slow):
        drive.turnaround *= times

    def ask() -> None:
        asked = rig.now

        def ended(job: Job) -> None:
            verdict.done += bool(job.reply)
            verdict.waited = max(verdict.waited, rig.now - asked)
            rig.at(rig.now + 0.02, ask)

        rig.owner.submit(Job(read_holding(_QUICK_UNIT, 0, 1), on_end=ended), rig.now)

    ask()
    rig.run(10 * timeout + 5.0)
    for drive in drives:
        for _, reason in drive.told:
            if "cannot be fed" in reason:
                verdict.stopped.append(drive.sim.address)
            else:
                verdict.faults.append(f"unit {drive.sim.address}: {reason}")
        if not drive.told and drive.unheard_until(rig.now) > timeout:
            verdict.faults.append(
                f"unit {drive.sim.address} was unheard for {drive.longest:.3f} s, and nobody was told"
            )
    if verdict.waited > timeout + 1.0:
        verdict.faults.append(f"a request to another device took {verdict.waited:.3f} s")
    return verdict
