"""A hostile line, a hundred thousand requests, and witnesses that know what really happened.

    python -m rs485bus.sim.campaign --requests 100000 --seed 1

No event loop: owner, pair and devices are plain objects on one clock. Every unit is a witness: it numbers what it is
asked and remembers what it did, so that each outcome can be held against the truth. Wrong is: an answer that was given
to another request, a write reported done that was not, one reported not done that was, one that must not be repeated
and was done twice.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections import Counter
from dataclasses import dataclass, field

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.sim.device import ILLEGAL_ADDRESS, Refusal, SimDevice
from rs485bus.sim.noise import Noise
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import (
    Request,
    read_holding,
    read_input,
    registers,
    write_multiple,
    write_single,
)
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
_FORBIDDEN = 0x4000
"""Registers from here on are refused."""


class Witness(SimDevice):
    """A unit that remembers what it was asked, when, and what it did."""

    def __init__(self, address: int) -> None:
        super().__init__(address)
        self.reads: dict[int, tuple[float, bytes]] = {}
        self.writes: dict[bytes, list[float]] = {}
        self.refused: dict[bytes, list[float]] = {}
        self._serial = 0

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        register = int.from_bytes(pdu[1:3], "big")
        if register >= _FORBIDDEN:
            self.refused.setdefault(pdu, []).append(now)
            raise Refusal(ILLEGAL_ADDRESS)
        if pdu[0] in (3, 4):
            self._serial = (self._serial + 1) % 0x1_0000_0000
            self.reads[self._serial] = (now, pdu)
            self.reads.pop(self._serial - 500, None)
            size = 2 * int.from_bytes(pdu[3:5], "big")
            return bytes((pdu[0], size)) + self._serial.to_bytes(4, "big") + bytes(size - 4)
        self.writes.setdefault(pdu, []).append(now)
        return pdu if pdu[0] == 6 else pdu[:5]

    def forget(self, before: float) -> None:
        """Forget what was done before a time."""
        self.writes = {pdu: times for pdu, times in self.writes.items() if times[-1] >= before}
        self.refused = {pdu: times for pdu, times in self.refused.items() if times[-1] >= before}


@dataclass
class Verdict:
    """What a campaign found. `wrong` and `stuck` must be empty."""

    requests: int
    outcomes: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)
    stuck: int = 0
    early_frames: int = 0
    late_replies: int = 0
    seconds: float = 0.0
    memory: list[int] = field(default_factory=list)
    """The most memory the process has used until each tenth, in kilobytes; empty where the system does not tell."""

    def __str__(self) -> str:
        ended = ", ".join(f"{name} {count}" for name, count in sorted(self.outcomes.items()))
        grown = f", memory {self.memory[1]} -> {self.memory[-1]} kB" if len(self.memory) > 1 else ""
        return (
            f"{self.requests} requests in {self.seconds:.0f} s of virtual time{grown}\n"
            f"{ended}\n"
            f"{len(self.wrong)} wrong answers, {self.early_frames} frames before t3.5, {self.stuck} stuck jobs, "
            f"{self.late_replies} late replies"
        )


class Campaign:
    """Random requests to witnesses over a noisy pair.

    Args:
        requests: how many.
        units: to how many units.
        seed: makes it reproducible.
        noise: what goes wrong.
        waiting: how many requests wait at once.
    """

    def __init__(
        self, requests: int, units: int = 16, seed: int = 1, noise: Noise = HOSTILE, waiting: int = 24
    ) -> None:
        self._rng = random.Random(seed)
        self._witnesses = {address: Witness(address) for address in range(1, units + 1)}
        config = BusConfig(echo="auto" if noise.echo else False, reply_timeout=0.03, max_queued=1000)
        self._rig = Rig(*self._witnesses.values(), noise=noise, seed=seed, config=config, keep_frames=False)
        self._left = requests
        self._waiting = waiting
        self._open: set[Job] = set()
        self._token = 0
        self._verdict = Verdict(requests)

    def run(self) -> Verdict:
        """Run to the end; return what was found."""
        verdict, rig = self._verdict, self._rig
        begun, tenth = rig.now, max(1, self._left // 10)
        for _ in range(self._waiting):
            self._ask()
        while self._left or self._open:
            before, goal = rig.now, max(0, self._left - tenth)
            rig.run(until=lambda goal=goal: self._left <= goal and (goal > 0 or not self._open))  # type: ignore[misc]
            if rig.now == before:
                break
            for witness in self._witnesses.values():
                witness.forget(rig.now - 30)
            if resource is not None:
                verdict.memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
        verdict.stuck = len(self._open)
        verdict.early_frames = rig.pair.early_frames
        verdict.late_replies = sum(unit.late_replies for unit in rig.owner.journal.stats.units.values())
        verdict.seconds = rig.now - begun
        return verdict

    def _ask(self) -> None:
        if self._left == 0:
            return
        self._left -= 1
        rng = self._rng
        request, repeat = self._request(rng.randrange(1, len(self._witnesses) + 1))
        job = Job(
            request,
            urgency=rng.choice((Urgency.COMMAND, Urgency.POLL)),
            repeat=repeat,
            expires_at=self._rig.now + rng.uniform(0.01, 3) if rng.random() < 0.1 else None,
            on_end=self._ended,
        )
        self._open.add(job)
        self._rig.owner.submit(job, self._rig.now)
        if rng.random() < 0.05:
            self._rig.at(self._rig.now + rng.expovariate(20), lambda: self._cancel(job))

    def _request(self, address: int) -> tuple[Request, Repeat]:
        rng = self._rng
        register = rng.randrange(0x3F00, 0x4010) if rng.random() < 0.2 else rng.randrange(4)
        kind = rng.random()
        if kind < 0.6:
            read = rng.choice((read_holding, read_input))
            return read(address, register, rng.randrange(2, 5)), Repeat.SAFE
        # Values are all different, so that the witness can tell the writes apart; there are few registers.
        self._token += 1
        repeat = rng.choice((Repeat.SAFE, Repeat.NEVER))
        high, low = divmod(self._token, 0xFFFF)
        if kind < 0.8:
            return write_multiple(address, register, (high, low)), repeat
        return write_single(address, register + 4 * (high % 1000), low), repeat

    def _cancel(self, job: Job) -> None:
        if job in self._open:
            self._rig.owner.cancel(job, self._rig.now)

    def _ended(self, job: Job) -> None:
        self._open.discard(job)
        assert job.outcome is not None
        self._verdict.outcomes[job.outcome.value] += 1
        fault = self._fault(job)
        if fault:
            self._verdict.wrong.append(f"{fault}: {job.request}, {job.outcome.value} after {job.attempts} attempts")
        # Whoever is told that a unit is offline comes back later.
        pause = self._rng.uniform(0.05, 0.5) if job.reason is Reason.OFFLINE else 0.0
        self._rig.at(self._rig.now + pause, self._ask)

    def _fault(self, job: Job) -> str:
        """What is wrong with how a job ended, held against what the witness knows; nothing if it is right."""
        witness, pdu = self._witnesses[job.address], job.request.adu[1:-2]
        if job.outcome is Outcome.REFUSED and not any(at > job.queued_at for at in witness.refused.get(pdu, ())):
            return "a refusal that the unit never gave"
        if not job.request.writes:
            if job.outcome is Outcome.REPLY:
                high, low = registers(job.reply)[:2]
                answered, asked = witness.reads.get(high << 16 | low, (0.0, b""))
                if asked != pdu or answered < job.queued_at:
                    return "the answer to another request"
            return ""
        done = sum(at > job.queued_at for at in witness.writes.get(pdu, ()))
        if job.outcome is Outcome.REPLY and not done:
            return "a write reported done that was not"
        if job.outcome in (Outcome.REFUSED, Outcome.NOT_SENT) and done:
            return "a write reported not done that was"
        if done > (1 if job.repeat is Repeat.NEVER else job.attempts):
            return "a write done too often"
        return ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--requests", type=int, default=100_000)
    parser.add_argument("--units", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--echo", action="store_true", help="the adapter returns what is sent")
    options = parser.parse_args()
    noise = Noise(**{**{name: getattr(HOSTILE, name) for name in HOSTILE.__slots__}, "echo": options.echo})
    verdict = Campaign(options.requests, options.units, options.seed, noise).run()
    print(verdict)
    for fault in verdict.wrong[:20]:
        print("wrong:", fault)
    return 1 if verdict.wrong or verdict.stuck or verdict.early_frames else 0


if __name__ == "__main__":
    sys.exit(main())
