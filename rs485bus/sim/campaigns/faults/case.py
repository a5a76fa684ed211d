"""One run by its name: which scenario, which drives, what goes wrong where. And the run without faults behind it."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import dataclass, replace
from functools import lru_cache

from rs485bus.sim.campaigns.faults import scenarios
from rs485bus.sim.campaigns.faults.evidence import Evidence
from rs485bus.sim.campaigns.faults.fault import FAULTS
from rs485bus.sim.campaigns.faults.options import OPTIONS, PLAIN
from rs485bus.sim.campaigns.faults.oracle import judge
from rs485bus.sim.campaigns.faults.scenario import SCENARIOS, Scenario
from rs485bus.sim.campaigns.faults.world import World

COMMAND = "python -m rs485bus.sim.every_fault"

for _module in pkgutil.iter_modules(scenarios.__path__):
    importlib.import_module(f"{scenarios.__name__}.{_module.name}")


@dataclass(frozen=True, slots=True)
class Case:
    """One run."""

    family: str
    scenario: str
    option: str = "plain"
    """What the drives of the family are like; those of others are plain."""
    goes_on: bool = False
    """The application goes on after errors; otherwise it gives up at the first one."""
    faults: tuple[tuple[str, int], ...] = ()
    """What goes wrong, and at which frame, counted from 0."""

    def __str__(self) -> str:
        """The command that runs it again."""
        option = "" if self.option == "plain" else f" --option {self.option}"
        goes_on = " --goes-on" if self.goes_on else ""
        names = ",".join(name for name, _ in self.faults)
        frames = ",".join(str(frame) for _, frame in self.faults)
        fault = f" --fault {names} --frame {frames}" if self.faults else ""
        return f"{COMMAND} --family {self.family} --scenario {self.scenario}{option}{goes_on}{fault}"

    @property
    def script(self) -> Scenario:
        """What the application does."""
        return SCENARIOS[self.family][self.scenario]

    def run(self, usual: float = 30.0) -> Evidence:
        """Run it; return what was seen."""
        options = {kind: OPTIONS[kind].get(self.option, PLAIN) for kind in OPTIONS}
        return World(self.script, options, goes_on=self.goes_on, faults=self.faults, usual=usual).run()

    def judged(self) -> tuple[Evidence, list[tuple[str, str]]]:
        """Run it, and hold it against the run without faults; return what was seen, and what of that is wrong."""
        if not self.faults:
            evidence = self.run()
            return evidence, judge(evidence)
        plain = without_faults(replace(self, faults=()))
        evidence = self.run(plain.seconds)
        evidence.usual = dict(plain.usual)
        evidence.may_differ = self.script.may_differ
        spoils = OPTIONS.get(self.family, {}).get(self.option, PLAIN).spoils
        if len(self.faults) == 1 and FAULTS[self.faults[0][0]].harmless and not spoils:
            evidence.expected = list(plain.ends)
        return evidence, judge(evidence)


@dataclass(frozen=True, slots=True)
class Plain:
    """A run without faults."""

    frames: int
    addressed: tuple[int, ...]
    """Whom each frame is for."""
    seconds: float
    usual: tuple[tuple[str, float], ...]
    """The longest time that each verb took."""
    ends: tuple[tuple[str, str, str], ...]
    """Who, verb and end of each call."""
    gave_up: bool
    """The application gave up after an error."""


@lru_cache(maxsize=64)
def without_faults(case: Case) -> Plain:
    """What happens where nothing goes wrong."""
    evidence = case.run()
    usual: dict[str, float] = {}
    for call in evidence.calls:
        took = min(call.ended, evidence.ended) - call.begun
        usual[call.verb] = max(usual.get(call.verb, 0.0), took)
    return Plain(
        len(evidence.frames),
        tuple(frame.address for frame in evidence.frames),
        evidence.ended - evidence.begun,
        tuple(usual.items()),
        tuple((call.who, call.verb, call.end) for call in evidence.calls if not call.aside),
        evidence.gave_up,
    )


def cases_of(base: Case) -> list[Case]:
    """Every fault at every frame."""
    plain = without_faults(base)
    families = {address: kind for drives in base.script.buses for kind, address in drives}
    return [
        replace(base, faults=((fault.name, frame),))
        for frame in range(plain.frames)
        for fault in FAULTS.values()
        if families.get(plain.addressed[frame], base.family) in fault.only_for
    ]


_PAIRS = (
    ("reply-lost", "reply-lost", 1_000),
    ("request-lost", "reply-lost", 1_000),
    ("restarted-after", "reply-lost", 6),
    ("restarted-before", "request-lost", 6),
)
"""Two faults of one run, and how many frames the second one may be behind the first."""


def pairs_of(base: Case) -> list[Case]:
    """Two faults at every two frames of a short scenario; none of a longer one."""
    if not base.script.short:
        return []
    frames = without_faults(base).frames
    return [
        replace(base, faults=((one, first), (other, second)))
        for one, other, within in _PAIRS
        for first in range(frames)
        for second in range(first + 1, min(frames, first + within) + 1)
    ]


def bases(family: str | None = None, scenario: str | None = None, option: str | None = None) -> list[Case]:
    """Each scenario with each option, for applications that give up and for those that go on."""
    found = []
    for kind, known in SCENARIOS.items():
        for name in known:
            for each in OPTIONS.get(kind, {"plain": PLAIN}):
                if family in (None, kind) and scenario in (None, name) and option in (None, each):
                    found += [Case(kind, name, each), Case(kind, name, each, goes_on=True)]
    return found
