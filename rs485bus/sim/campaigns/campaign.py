"""A hostile line, a hundred thousand requests, and witnesses that know what really happened.

    python -m rs485bus.sim.campaign --requests 100000 --seed 1
    python -m rs485bus.sim.campaign --requests 50000 --seeds 20      # in parallel, on lines of all kinds

No event loop: owner, pair and devices are plain objects on one clock. Every unit is a witness: it numbers what it is
asked and tells what it does, so that each outcome can be held against the truth. Meanwhile drives are moved and
stopped, the port is lost, callers are cancelled. Wrong is: an answer that was given to another request, a write
reported done that was not, one reported not done that was, one that must not be repeated and was sent twice, what is
sent after a stop and is older, a drive said to stand that turns, a late stop, motion while an emergency stop holds, a
frame in a broadcast's turnaround or without a port, and who is told of an end twice, too late or never.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Reason, Urgency
from rs485bus.bus.schedule.verification import holds
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.watchdog.guarding import EmergencyReport, emergency_stop
from rs485bus.devices.mks import registers as mks
from rs485bus.devices.mks.drive import MksDrive
from rs485bus.devices.mks.frames import write_block
from rs485bus.sim.campaigns.verdict import Fate, Verdict
from rs485bus.sim.campaigns.wire_judge import WireJudge
from rs485bus.sim.campaigns.witness import FORBIDDEN, HIDDEN, MEMORY, Witness, overhear
from rs485bus.sim.mks import SimMks
from rs485bus.sim.noise import Noise
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import BROADCAST, Request, read_holding, read_input, write_multiple, write_single
from rs485bus.wire.registers import Repeat

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

HOSTILE = Noise(
    lost_request=0.03,
    lost_reply=0.03,
    flipped=0.02,
    flipped_request=0.02,
    torn=0.02,
    late=0.03,
    duplicated=0.02,
    stray=0.03,
    foreign=0.02,
    hang=0.0005,
)
ECHOING = Noise(**{**{field.name: getattr(HOSTILE, field.name) for field in fields(Noise)}, "echo": True})
_NEVER = float("-inf")


class Campaign:
    """Random requests to witnesses over a noisy pair.

    Args:
        requests: how many.
        units: to how many units.
        seed: makes it reproducible.
        noise: what goes wrong.
        waiting: how many requests wait at once.
        gateway: the pair is behind a TCP gateway.
        events: drives are moved and stopped, the port is lost.
    """

    def __init__(
        self,
        requests: int,
        units: int = 16,
        seed: int = 1,
        noise: Noise = HOSTILE,
        waiting: int = 24,
        *,
        gateway: bool = False,
        events: bool = True,
    ) -> None:
        self._rng = random.Random(seed)
        self._witnesses = {address: Witness(address, self._did) for address in range(1, units + 1)}
        self._drives = {units + at: SimMks(units + at) for at in (1, 2)} if events else {}
        config = BusConfig(echo="auto" if noise.echo else False, reply_timeout=0.03, turnaround=0.02, max_queued=1000)
        self._rig = rig = Rig(
            *self._witnesses.values(),
            *self._drives.values(),
            noise=noise,
            seed=seed,
            config=config,
            gateway=gateway,
            keep_frames=False,
            on_send=self._sent,
        )
        self._attached = {address: MksDrive(address) for address in self._drives}
        for address, attached in self._attached.items():
            rig.owner.units[address].attach(attached)
            overhear(self._drives[address], self._did)
        self._judge = WireJudge(config.turnaround, rig.pair.line.character, self._drives)
        self._stopped_at = dict.fromkeys((*self._drives, BROADCAST), _NEVER)
        self._unplugged_at = _NEVER
        self._closed = False
        self._left = requests
        self._waiting = waiting
        self._open: dict[Job, Fate] = {}
        self._by_frame: dict[bytes, list[Fate]] = {}
        self._on_wire: Fate | None = None
        self._halts = 0
        self._token = 0
        self._verdict = Verdict(requests)

    def run(self) -> Verdict:
        """Run to the end; return what was found."""
        verdict, rig = self._verdict, self._rig
        begun, tenth = rig.now, max(1, self._left // 10)
        for _ in range(self._waiting):
            self._ask()
        if self._drives:
            self._happen()
        while self._left or self._open:
            before, goal = rig.now, max(0, self._left - tenth)
            rig.run(120.0 + tenth, until=lambda goal=goal: self._left <= goal and (goal > 0 or not self._open))  # type: ignore[misc]
            if rig.now >= before + 120.0 + tenth:
                break
            if resource is not None:
                verdict.memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
        verdict.stuck = len(self._open)
        self._close()
        verdict.early_frames = rig.pair.early_frames
        verdict.late_replies = sum(unit.late_replies for unit in rig.owner.journal.stats.units.values())
        verdict.seconds = rig.now - begun
        return verdict

    def _close(self) -> None:
        """With requests waiting: they end at once, and nothing follows."""
        rig, verdict = self._rig, self._verdict
        late = [Job(request, repeat=repeat) for request, repeat in (self._request(1) for _ in range(10))]
        for job in late:
            rig.owner.submit(job, rig.now)
        for address in self._drives:
            self._stop(address, emergency=False)
        rig.owner.close(rig.now)
        verdict.wrong += [f"not ended by closing: {job.request}" for job in late if job.outcome is None]
        if self._halts:
            verdict.wrong.append(f"{self._halts} who wait for a stop are not told that the bus is closed")
        self._closed = True
        rig.run(5.0)

    # Requests

    def _ask(self) -> None:
        if self._left == 0:
            return
        self._left -= 1
        rng, now = self._rng, self._rig.now
        address = rng.randrange(1, len(self._witnesses) + 1)
        if self._drives and rng.random() < 0.02:
            job = self._moving(rng.choice(list(self._drives)))
        elif self._drives and rng.random() < 0.005:
            request = write_single(BROADCAST, rng.randrange(4), 1)
            job = Job(request, repeat=Repeat.NEVER, moves=rng.random() < 0.5, on_end=self._ended)
        elif rng.random() < 0.05:
            job = self._verified(address)
        else:
            request, repeat = self._request(address)
            job = Job(
                request,
                urgency=rng.choice((Urgency.COMMAND, Urgency.POLL)),
                repeat=repeat,
                expires_at=now + rng.uniform(0.01, 3) if rng.random() < 0.1 else None,
                on_end=self._ended,
            )
        fate = self._open[job] = Fate(job, now)
        self._by_frame.setdefault(job.request.adu, []).append(fate)
        self._rig.owner.submit(job, now)
        if rng.random() < 0.05:
            self._rig.at(now + rng.expovariate(20), lambda: self._cancel(job))

    def _moving(self, address: int) -> Job:
        self._token += 1
        return Job(
            write_block(address, mks.MOVE_TO_COUNTS, 250, 300, 10_000_000 + self._token),
            repeat=Repeat.NEVER,
            moves=True,
            motion=self._attached[address].motion,
            on_end=self._ended,
        )

    def _verified(self, address: int) -> Job:
        self._token += 1
        register, values = MEMORY + self._rng.randrange(3), [self._token % 0x1_0000, self._rng.randrange(2)]
        return Job(
            write_multiple(address, register, values),
            repeat=Repeat.VERIFY,
            verify=holds(address, register, values),
            on_end=self._ended,
        )

    def _request(self, address: int) -> tuple[Request, Repeat]:
        rng = self._rng
        register = rng.randrange(FORBIDDEN - 0x10, FORBIDDEN + 0x10) if rng.random() < 0.1 else rng.randrange(4)
        kind = rng.random()
        if kind < 0.6:
            read = rng.choice((read_holding, read_input))
            return read(
                address, register % HIDDEN if register < FORBIDDEN else register, rng.randrange(2, 5)
            ), Repeat.SAFE
        # Some values are all different, some the same again and again; there are few registers.
        self._token += rng.random() < 0.7
        repeat = rng.choice((Repeat.SAFE, Repeat.NEVER))
        high, low = divmod(self._token, 0xFFFF)
        hides = rng.random() < 0.5
        if kind < 0.8:
            return write_multiple(address, register, (high, low), hidden_refusal=hides or register >= HIDDEN), repeat
        return write_single(address, register, low, hidden_refusal=hides or register >= HIDDEN), repeat

    def _cancel(self, job: Job) -> None:
        if job in self._open:
            self._open[job].cancelled_at = self._rig.now
            self._rig.owner.cancel(job, self._rig.now)

    # What is seen of the wire and of the units

    def _sent(self, frame: bytes, now: float) -> None:
        """A frame goes out: whose is it, and may it?"""
        self._on_wire = None
        if self._closed and frame[1] in (6, 16):
            self._verdict.wrong.append(f"sent after closing: {frame.hex(' ')}")
        for fate in self._by_frame.get(frame, ()):
            if fate.job.attempts > fate.sent:
                self._on_wire = fate
                fate.sent = fate.job.attempts
                stopped = max(self._stopped_at.get(fate.job.address, _NEVER), self._unplugged_at)
                self._note(fate, fate.may_still_go(now, stopped))
        mine = self._on_wire
        if fault := self._judge.sent(frame, now, moves=mine is not None and mine.job.moves, bidden=mine is not None):
            self._verdict.wrong.append(f"{fault}: {frame.hex(' ')}")
        if mine is None and frame[0] in self._witnesses and frame[1] in (6, 16):
            self._verdict.wrong.append(f"a write that nobody waits for was sent: {frame.hex(' ')}")

    def _did(self, pdu: bytes, carried_out: bool, now: float) -> None:
        """A unit tells what it does with the frame that it heard last."""
        fate = self._on_wire
        if fate is None or fate.job.request.adu[1:-2] != pdu:
            return
        if carried_out:
            fate.done += 1
        else:
            fate.refused += 1

    def _ended(self, job: Job) -> None:
        assert job.outcome is not None
        fate = self._open.pop(job, None)
        if fate is None:
            self._verdict.wrong.append(f"ended twice: {job.request}")
            return
        fate.ends, fate.ended_at = 1, self._rig.now
        self._verdict.outcomes[job.outcome.value] += 1
        self._note(fate, fate.fault(self._reads))
        # What is done after its end must be noticed: it is watched for a while.
        self._rig.at(self._rig.now + 2, lambda: self._forget(fate))
        # Whoever is told that a unit is offline comes back later.
        pause = self._rng.uniform(0.05, 0.5) if job.reason in (Reason.OFFLINE, Reason.UNPLUGGED) else 0.0
        self._rig.at(self._rig.now + pause, self._ask)

    def _forget(self, fate: Fate) -> None:
        self._note(fate, fate.fault(self._reads))
        same = self._by_frame[fate.job.request.adu]
        same.remove(fate)
        if not same:
            del self._by_frame[fate.job.request.adu]

    def _reads(self, address: int, number: int) -> tuple[float, bytes]:
        return self._witnesses[address].reads.get(number, (0.0, b""))

    def _note(self, fate: Fate, fault: str) -> None:
        if fault:
            outcome = "open" if fate.job.outcome is None else fate.job.outcome.value
            self._verdict.wrong.append(f"{fault}: {fate.job.request}, {outcome} after {fate.job.attempts} attempts")

    # What happens besides

    def _happen(self) -> None:
        rng, rig = self._rng, self._rig
        kind = rng.random()
        if kind < 0.9 or self._halts:
            self._stop(rng.choice(list(self._drives)), emergency=rng.random() < 0.5)
        elif kind < 0.97:
            self._unplug()
        else:
            self._stop_all()
        if self._left:
            rig.at(rig.now + rng.expovariate(1), self._happen)

    def _stop(self, address: int, *, emergency: bool) -> None:
        rig = self._rig
        self._verdict.events["stops"] += 1
        self._stopped_at[address] = asked_at = rig.now
        self._judge.stop(address, rig.now)
        self._halts += 1
        rig.owner.now = rig.now
        halt = rig.owner.stops.halt(rig.owner.units[address], self._attached[address].motion, emergency=emergency)

        def told(halted: Halted) -> None:
            self._halts -= 1
            newer = any(fate.job.address == address and fate.asked_at >= asked_at for fate in self._moves())
            if halted.standing and not newer and self._drives[address].moving(rig.now):
                self._verdict.wrong.append(f"drive {address} is said to stand, and turns")
            if rig.now > asked_at + 10:
                self._verdict.wrong.append(f"whoever stopped drive {address} waited for {rig.now - asked_at:.1f} s")

        halt.listen(told)

    def _stop_all(self) -> None:
        rig, owner = self._rig, self._rig.owner
        self._verdict.events["emergency stops"] += 1
        self._stopped_at.update(dict.fromkeys(self._stopped_at, rig.now))
        self._judge.stop_all(rig.now)
        self._halts += 1
        asked_at = owner.now = rig.now

        def reported(report: EmergencyReport) -> None:
            self._halts -= 1
            owner.gate.latched = self._judge.is_latched = False
            for address in self._drives:
                owner.units[address].locked = ""  # as enabling it does
            turning = [address for address, drive in self._drives.items() if drive.moving(rig.now)]
            if report.all_standing and turning:
                self._verdict.wrong.append(f"an emergency stop says that all stand, and {turning} turn")
            if rig.now > asked_at + 10:
                self._verdict.wrong.append(f"an emergency stop was reported after {rig.now - asked_at:.1f} s")

        owner.start(emergency_stop(owner), reported)

    def _moves(self) -> list[Fate]:
        return [fate for same in self._by_frame.values() for fate in same if fate.job.moves]

    def _unplug(self) -> None:
        rig = self._rig
        self._verdict.events["unpluggings"] += 1
        self._unplugged_at = rig.now
        self._judge.is_away = True
        rig.unplug()
        rig.at(rig.now + self._rng.uniform(0.05, 2), self._plug)

    def _plug(self) -> None:
        self._judge.port_is_back(self._rig.now)
        self._rig.plug()


def kinds_of(seed: int) -> dict[str, object]:
    """The line that a seed's campaign runs on, where many are run: plain, with an echo, behind a gateway in turn."""
    return {"noise": ECHOING if seed % 3 == 1 else HOSTILE, "gateway": seed % 3 == 2}


def _one(requests: int, units: int, seed: int) -> Verdict:
    kind = kinds_of(seed)
    return Campaign(requests, units, seed, **kind).run()  # type: ignore[arg-type]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--requests", type=int, default=100_000)
    parser.add_argument("--units", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=0, help="run so many, from --seed on, on lines of all kinds")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--echo", action="store_true", help="the adapter returns what is sent")
    parser.add_argument("--gateway", action="store_true", help="the pair is behind a TCP gateway")
    options = parser.parse_args()
    begun = time.perf_counter()
    if not options.seeds:
        noise = ECHOING if options.echo else HOSTILE
        verdict = Campaign(options.requests, options.units, options.seed, noise, gateway=options.gateway).run()
    else:
        verdict = Verdict(0)
        with ProcessPoolExecutor(options.processes) as pool:
            runs = {
                seed: pool.submit(_one, options.requests, options.units, seed)
                for seed in range(options.seed, options.seed + options.seeds)
            }
            for seed, run in runs.items():
                one = run.result()
                if not one.is_good:
                    print(f"seed {seed}:\n{one}")
                verdict.add(one)
    print(verdict)
    print(f"{time.perf_counter() - begun:.0f} s")
    for fault in verdict.wrong[:20]:
        print("wrong:", fault)
    return 0 if verdict.is_good else 1


if __name__ == "__main__":
    sys.exit(main())
