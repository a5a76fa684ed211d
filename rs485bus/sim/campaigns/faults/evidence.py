"""All that is known of one run: how the shafts really moved, what was on the line, what the application was told.

Plain records. Positions are turns of a shaft, speeds rpm, times seconds on one clock.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

NEVER = float("inf")


class Sample(NamedTuple):
    """A shaft at a time."""

    at: float
    position: float
    rpm: float


class Frame(NamedTuple):
    """A frame that the master sent."""

    at: float
    """When its last character had left, and t3.5 after it."""
    data: bytes
    treated: str
    """What was done to it; empty for nothing."""

    @property
    def address(self) -> int:
        return self.data[0]


class Mishap(NamedTuple):
    """Something that happened to a drive: "restart", "fault", "limit", "stall" or "trip"."""

    at: float
    what: str
    lets_go: bool = False
    """The drive lets go of its shaft, which then rolls on."""


@dataclass(slots=True, eq=False)
class Shaft:
    """One motor, and the axis that the application calls by its name."""

    name: str
    address: int
    sign: int = 1
    """-1 where the axis counts the other way than the shaft."""
    turns_per_unit: float = 1.0
    pulses_per_turn: int = 3200
    """What the moves that are told in pulses count."""
    home: float = 0.0
    """Where the shaft stands when its axis is home: its position 0."""
    homes: list[tuple[float, float]] = field(default_factory=list)
    """When its switch was moved, and where to."""
    slack: float = 0.004
    """Turns by which the drive may stand off its target, and read positions wrongly."""
    limits: tuple[float, float] | None = None
    """Between which positions the application wants it to stay, in turns of the shaft."""
    samples: list[Sample] = field(default_factory=list)
    mishaps: list[Mishap] = field(default_factory=list)
    deaf: list[tuple[float, float]] = field(default_factory=list)
    """When its drive could not be told anything: it starts, its port is away, it is dead."""
    starts: list[float] = field(default_factory=list)
    """When a frame set it in motion."""
    trips: list[float] = field(default_factory=list)
    """When its drive's watchdog stopped it."""
    answers_at: list[tuple[float, int]] = field(default_factory=list)
    """From when on its drive answers at which address."""
    together: tuple[str, ...] = ()
    """The others that stand if it fails: the other wheel, the group."""

    def home_at(self, when: float) -> float:
        """Where it stands then when its axis is home."""
        return next((place for at, place in reversed(self.homes) if at <= when), self.home)

    def add(self, at: float, position: float, rpm: float) -> None:
        """It is there now."""
        if self.samples and self.samples[-1].at >= at:
            self.samples[-1] = Sample(at, position, rpm)
        else:
            self.samples.append(Sample(at, position, rpm))

    def at(self, when: float) -> Sample:
        """Where it was, between two samples in proportion."""
        after = bisect_left(self.samples, when, key=lambda sample: sample.at)
        if after == 0:
            return self.samples[0]
        if after == len(self.samples):
            return self.samples[-1]
        early, late = self.samples[after - 1], self.samples[after]
        part = (when - early.at) / (late.at - early.at)
        return Sample(
            when,
            early.position + part * (late.position - early.position),
            early.rpm + part * (late.rpm - early.rpm),
        )

    def between(self, begin: float, end: float) -> list[Sample]:
        """Where it was from one time to another, both ends included."""
        first = bisect_right(self.samples, begin, key=lambda sample: sample.at)
        last = bisect_left(self.samples, end, key=lambda sample: sample.at)
        return [self.at(begin), *self.samples[first:last], self.at(end)]

    def turns_at(self, when: float) -> bool:
        """Whether it turned then."""
        before = bisect_right(self.samples, when, key=lambda sample: sample.at)
        return self.samples[max(0, before - 1)].rpm != 0

    def motions(self) -> Iterator[tuple[float, float]]:
        """From when to when it turned, each time."""
        begun = None
        for before, sample in zip(self.samples, self.samples[1:], strict=False):
            turns = sample.rpm != 0 or abs(sample.position - before.position) > 1e-9
            if turns and begun is None:
                begun = before.at
            elif not turns and begun is not None:
                yield begun, before.at
                begun = None
        if begun is not None:
            yield begun, self.samples[-1].at

    def deaf_for(self, begin: float, end: float) -> float:
        """Seconds between two times in which its drive could not be told anything."""
        return sum(max(0.0, min(end, until) - max(begin, since)) for since, until in self.deaf)

    def rolls(self, begin: float, end: float) -> bool:
        """Whether its drive let go of it between two times."""
        return any(begin <= mishap.at <= end and mishap.lets_go for mishap in self.mishaps)

    def heard_mishap(self, begin: float, end: float) -> bool:
        """Whether something happened to its drive between two times."""
        return any(begin <= mishap.at <= end for mishap in self.mishaps)


@dataclass(slots=True, eq=False)
class Call:
    """Something that the application called."""

    who: str
    """The axis, "bus", or what else it called."""
    verb: str
    args: tuple[object, ...]
    options: dict[str, object]
    begun: float
    shafts: tuple[str, ...] = ()
    """The shafts that it concerns."""
    ended: float = NEVER
    result: object = None
    error: BaseException | None = None
    given_up: bool = False
    """Whoever waited for it was cancelled."""
    aside: bool = False
    """It is none of the scenario's own: somebody else stops, or asks."""

    @property
    def failed(self) -> frozenset[str]:
        """The names of its error's classes; empty if it ended well."""
        return frozenset() if self.error is None else frozenset(kind.__name__ for kind in type(self.error).__mro__)

    @property
    def end(self) -> str:
        """How it ended, in a word."""
        if self.ended == NEVER:
            return "never"
        return "done" if self.error is None else type(self.error).__name__

    def __str__(self) -> str:
        said = [f"{arg!r}" for arg in self.args] + [f"{name}={value!r}" for name, value in self.options.items()]
        told = f": {self.error}" if self.error is not None else "" if self.result is None else f" = {self.result!r}"
        return f"{self.who}.{self.verb}({', '.join(said)}) {self.end}{told}"


@dataclass(slots=True)
class Evidence:
    """One run."""

    shafts: dict[str, Shaft] = field(default_factory=dict)
    frames: list[Frame] = field(default_factory=list)
    calls: list[Call] = field(default_factory=list)
    away: list[tuple[float, float]] = field(default_factory=list)
    """When the port was away."""
    fault: str = ""
    """What went wrong; empty in the run without faults."""
    fault_at: float = NEVER
    begun: float = 0.0
    closed_at: float = NEVER
    """When the application had left the bus."""
    ended: float = 0.0
    leaving_at: float = NEVER
    """When the application began to leave the bus."""
    left_running: bool = False
    """The application wanted motors to go on when it left."""
    gave_up: bool = False
    """There was an error after which the application gave up; without one it is the same as one that goes on."""
    pauses: list[tuple[float, float]] = field(default_factory=list)
    """When the program itself did not run."""
    early_frames: int = 0
    usual: dict[str, float] = field(default_factory=dict)
    """How long each verb takes at most where nothing goes wrong."""
    expected: list[tuple[str, str, str]] | None = None
    """Who, verb and end of each call where nothing goes wrong; None where this fault may change that."""
    may_differ: frozenset[str] = frozenset()
    """Verbs of which a lost frame may leave unknown what became of them."""
    armed: dict[int, tuple[int, int]] = field(default_factory=dict)
    """What the watchdogs were set to in the beginning, and are in the end, by address, in ms."""
    logged: list[tuple[float, str, str]] = field(default_factory=list)
    """When, level and text of what was logged."""
    unhandled: list[str] = field(default_factory=list)
    """Errors that nobody was told but the event loop."""
    spun: bool = False
    """It did not end in the time of the computer that it had."""

    def blocked(self, begin: float, end: float) -> float:
        """Seconds between two times in which the program itself did not run."""
        return sum(max(0.0, min(end, until) - max(begin, since)) for since, until in self.pauses)

    @property
    def loudest(self) -> str:
        """The last critical thing that was logged."""
        return next((text for _, level, text in reversed(self.logged) if level == "CRITICAL"), "")
