"""The MKS facade on a second virtual drive that reads the manual otherwise, with something going wrong at random.

What is judged is the true motion of the shaft and what the application was told, by the oracle of `every_fault`.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import pytest

from rs485bus import Bus, MksServo, MoveState
from rs485bus.sim.campaigns.faults.campaign import account  # and with it all scenarios
from rs485bus.sim.campaigns.faults.evidence import Evidence, Shaft
from rs485bus.sim.campaigns.faults.fault import FAULTS
from rs485bus.sim.campaigns.faults.oracle import judge
from rs485bus.sim.campaigns.faults.plant import KINDS, Drive, Option
from rs485bus.sim.campaigns.faults.scenario import SCENARIOS, Scenario
from rs485bus.sim.campaigns.faults.scenarios.mks import HOMING
from rs485bus.sim.campaigns.faults.world import World
from tests.devices.mks.other_drive import TURN, OtherMks, Reading

ALL: dict[str, tuple[Any, ...]] = {
    "starts_for": (0.6, 0.5, 1.2, 3.0),
    "on_at_start": (True, False),
    "stop_of_another_kind": ("stops", "refused"),
    "idle_stop": ("refused", "taken"),
    "move_while_moving": ("refused", "replaces"),
    "answers_after": (0.003, 0.02, 0.065),
    "status_lags": (0.0, 0.05, 0.2),
    "status_fails": (0.0, 0.1),
    "counts_every": (0.0, 0.01, 0.02),
    "settles": (0, 1, 14),
    "stop_releases": (False, True),
    "homed_late": (0.0, 0.05),
    "homing_counts_anew": ("end", "begin"),
    "homes_by_status": (True, False),
    "stall_protects_after": (None, 0.1, 1.0),
    "stall_flag_clears": (False, True),
    "start_delay": (0.001, 0.004, 0.03),
    "zero_while_moving": (True, False),
}
"""What the manual leaves open, each with its readings."""
NAMES = tuple(name for name in SCENARIOS["mks"] if not name.startswith("guarded"))


class OtherUnderTest(Drive):
    """The second drive; its origin switch closes half a turn below where it stands."""

    family = "mks"

    def _make_shafts(self) -> list[Shaft]:
        start = 0.1 * self.address
        reading: Reading = self.option.sim["reading"]
        self.restarts_for = reading.starts_for
        self._sim = OtherMks(self.address, reading, start, start - 0.5)
        return [Shaft(f"other {self.address}", self.address, home=start - 0.5)]

    @property
    def sim(self) -> OtherMks:
        return self._sim

    def facade(self, bus: Bus, **options: Any) -> MksServo:
        return MksServo(bus, self.address, **{"rpm": 600.0, "acceleration": 20_000.0, **options})

    def motors(self, now: float) -> list[tuple[float, float, int]]:
        self._sim.advance(now)
        return [(self._sim.x, 60 * self._sim.v, self._sim.moves)]

    @property
    def watchdog_ms(self) -> int:
        return self._sim.watchdog

    def _restart(self, now: float) -> None:
        self._sim.restart(now)

    def _fault(self, now: float) -> None:
        self._sim.advance(now)
        self._sim.protect()

    def _limit(self, now: float) -> bool:
        self._sim.advance(now)
        sim = self._sim
        if sim.homed == 0 or not sim.v:
            return False
        if sim.v < 0:
            sim.low = sim.x
        else:
            sim.high = sim.x
        return sim.homing[2]

    def _stall(self, now: float) -> None:
        self._sim.advance(now)
        self._sim.blocked = True


KINDS["other"] = OtherUnderTest


class Whim:
    """An application that does anything, and a drive to which anything happens, by a number."""

    def __init__(self, seed: int) -> None:
        self._rng = random.Random(f"whim {seed}")

    def reading(self) -> Reading:
        """How the drive reads the manual."""
        others = self._rng.sample(sorted(ALL), self._rng.randrange(8))
        return replace(Reading(), **{name: self._rng.choice(ALL[name]) for name in others})

    async def play(self, app: World) -> None:
        """What the application does."""
        rng = self._rng
        async with app.bus():
            x = app.axis(1)
            if rng.random() < 0.7:
                await x.enable()
            for _ in range(rng.randrange(3, 9)):
                if rng.random() < 0.3:
                    self._happen(app)
                await self._act(app, x)
                await app.sleep(rng.choice((0.0, 0.0, 0.05, 0.4)))

    def _happen(self, app: World) -> None:
        """Something happens to the drive in a moment."""
        rng, drive = self._rng, app.drives[0]
        assert isinstance(drive, OtherUnderTest)
        what = rng.choice((drive.restart, drive.restart, drive.fault, drive.limit, drive.stall, self._silent(app)))
        app.drives[0].later.append((app.now() + rng.uniform(0.0, 0.3), what))
        app.drives[0].later.sort(key=lambda happening: happening[0])
        if what == drive.stall:
            app.drives[0].later.append((app.now() + rng.uniform(0.5, 3.0), lambda now: drive.sim.free()))

    def _silent(self, app: World) -> Callable[[float], None]:
        seconds = self._rng.choice((0.2, 0.5, 1.5))
        return lambda now: app.deafen(app.drives[0], now, seconds)

    async def _act(self, app: World, x: Any) -> None:
        rng = self._rng
        place = rng.choice((0.0, 0.0, 0.5, -0.3, 1.0, 2.0))
        what = rng.randrange(14)
        if what <= 2:
            await x.move_to(place)
        elif what == 3:
            await x.move_by(rng.choice((0.3, -1.0, 0.01, 1.0)))
        elif what == 4:
            moves = [x.move_by(0.2), x.move_to(place), x.move_by(-0.2)]
            await app.sleep(rng.uniform(0.0, 0.15))
            if rng.random() < 0.5:
                rng.choice(moves).cancel()
            for move in moves:
                await move
        elif what == 5:
            await x.run(rng.choice((-1, 1)) * rng.uniform(60, 300))
            await app.sleep(rng.uniform(0.0, 0.3))
            await (x.run(0.0) if rng.random() < 0.4 else x.stop())
        elif what == 6:
            await x.run(120.0, duration=0.3)
        elif what == 7:
            x.move_to(place + 3.0)
            await app.sleep(rng.uniform(0.0, 0.2))
            await (x.stop() if rng.random() < 0.6 else x.emergency_stop())
            await x.enable()
        elif what == 8:
            await x.set_zero()
        elif what == 9:
            await x.home(HOMING, timeout=10.0)
        elif what == 10:
            async with x.stream(timeout=0.25) as setpoint:
                for _ in range(rng.randrange(1, 8)):
                    setpoint(rng.uniform(-120, 120))
                    await app.sleep(0.05)
        elif what == 11:
            move = x.move_to(place + 2.0)
            await app.until(lambda: move.done() or move.state is MoveState.MOVING)
            await x.retarget(place)
            await move
        elif what == 12:
            await rng.choice((lambda: x.move_by_pulses(1600), lambda: x.move_by_counts(-4096), x.return_to_zero))()
        else:
            await x.disable()
            await x.enable()
        if rng.random() < 0.4:
            await x.position()


def whimsical(seed: int) -> tuple[Evidence, list[tuple[str, str]]]:
    """One run of anything."""
    whim = Whim(seed)
    reading = whim.reading()
    script = Scenario("mks", "whim", "", ((("other", 1),),), whim.play, frozenset(), short=False)
    option = Option(str(reading), {"reading": reading}, slack=(reading.settles + abs(reading.clicks)) / TURN)
    evidence = World(script, {"other": option}, goes_on=True).run()
    return evidence, judge(evidence)


@lru_cache(maxsize=512)
def run(name: str, reading: Reading, goes_on: bool, faults: tuple[tuple[str, int], ...] = ()) -> Evidence:
    """One run of a scenario."""
    script = replace(SCENARIOS["mks"][name], buses=((("other", 1),),))
    slack = (reading.settles + abs(reading.clicks)) / TURN
    option = Option("", {"reading": reading}, slack=slack)
    return World(script, {"other": option}, goes_on=goes_on, faults=faults).run()


def judged(name: str, reading: Reading, goes_on: bool, fault: str, at: float) -> tuple[Evidence, list[tuple[str, str]]]:
    """One run with a fault at a part of its way, held against the one without."""
    plain = run(name, reading, goes_on)
    if not fault:
        return plain, judge(plain)
    evidence = run(name, reading, goes_on, ((fault, int(at * len(plain.frames))),))
    for call in plain.calls:
        took = min(call.ended, plain.ended) - call.begun
        evidence.usual[call.verb] = max(evidence.usual.get(call.verb, 0.0), took)
    return evidence, judge(evidence)


def draw(seed: int) -> tuple[str, Reading, bool, str, float]:
    """A scenario, a reading and what goes wrong, by a number."""
    rng = random.Random(seed)
    others = rng.sample(sorted(ALL), rng.randrange(4))
    reading = replace(Reading(), **{name: rng.choice(ALL[name]) for name in others})
    fault = rng.choice(("", *FAULTS)) if seed % 3 else rng.choice(("restarted-before", "restarted-after"))
    return rng.choice(NAMES), reading, rng.random() < 0.6, fault, rng.random()


@pytest.mark.parametrize("part", range(3))
def test_what_is_said_is_so_on_a_drive_that_reads_the_manual_otherwise(part: int) -> None:
    """A scenario, and one thing that goes wrong in it."""
    wrong = {}
    for seed in range(25 * part, 25 * (part + 1)):
        _, found = judged(*draw(seed))
        if found:
            wrong[seed] = found
    assert not wrong, "python -m tests.devices.mks.test_other_drive NUMBER shows it"


@pytest.mark.parametrize("part", range(3))
def test_what_is_said_is_so_to_an_application_that_does_anything(part: int) -> None:
    """Any verbs, with cancellations, while drives restart, stall, meet limits and fall silent."""
    wrong = {}
    for seed in (*range(25 * part, 25 * (part + 1)), *((127, 68, 314) if part == 0 else ())):
        _, found = whimsical(seed)
        if found:
            wrong[seed] = found
    assert not wrong, "python -m tests.devices.mks.test_other_drive whim NUMBER shows it"


if __name__ == "__main__":  # python -m tests.devices.mks.test_other_drive [whim] FIRST [LAST]; one alone is shown
    numbers = [int(number) for number in sys.argv[1:] if number != "whim"]
    failed = 0
    for number in range(numbers[0], numbers[-1] + 1):
        evidence, found = whimsical(number) if "whim" in sys.argv else judged(*draw(number))
        failed += bool(found)
        if len(numbers) == 1:
            print(
                account(f"{number}: {Whim(number).reading() if 'whim' in sys.argv else draw(number)}", evidence, found)
            )
        elif found:
            print(number, *found, sep="\n    ", flush=True)
    print(f"{failed} of {numbers[-1] + 1 - numbers[0]} failed")
