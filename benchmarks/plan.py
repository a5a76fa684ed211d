"""What is measured: which task, on which line, how often. Everything is measured in an order that drift hits alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from benchmarks.clients.registry import BRIEF, FLOOR, LIBRARIES, OURS, SERIALX
from benchmarks.lossy_cases import DEAD, LOSSY, Case
from benchmarks.setting import Setting
from benchmarks.tasks.task import Task


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
    """How much is measured. All times are seconds."""

    repeats: int = 5
    seconds: float = 1.5
    baudrates: tuple[int, ...] = (9600, 38400, 115200, 256000)
    units: tuple[int, ...] = (1, 8, 31)
    queued: tuple[int, ...] = (0, 30, 1000)
    stops: int = 10
    """How many stops a repetition, of this library; peers get fewer, since they take so long."""
    waiting: tuple[int, ...] = (1, 100, 10_000)
    waited: float = 2.0
    faulty: float = 15.0
    lossy: float = 10.0
    idle: float = 5.0
    watched: float = 60.0
    memory: float = 3600.0
    libraries: tuple[str, ...] = field(default=tuple(name for name in LIBRARIES if name not in (BRIEF, SERIALX)))


QUICK = Scale(
    repeats=1,
    seconds=0.3,
    baudrates=(115200,),
    units=(8,),
    queued=(0, 30),
    stops=2,
    waiting=(1, 100),
    waited=0.3,
    faulty=1.0,
    lossy=0.5,
    idle=1.0,
    watched=5.0,
    memory=120.0,
)

PACED, NOISY, LOSES, SERVOS, NONE = "paced", "noisy", "loses", "servos", ""


@dataclass(frozen=True, slots=True)
class Measurement:
    """One run of one library."""

    row: str
    task: Task
    line: str
    repetition: int


def _share(scale: Scale) -> Iterator[Measurement]:
    for repetition in range(scale.repeats):
        for baudrate in scale.baudrates:
            for units in scale.units:
                setting = Setting(baudrate=baudrate, units=units)
                # Slow lines need their time for a fair number of requests.
                seconds = max(scale.seconds, 16 * max(units, 4) / setting.limit * min(1.0, scale.seconds))
                for library in scale.libraries:
                    task = Task(library=library, name="share", setting=setting, seconds=seconds)
                    yield Measurement("share", task, PACED, repetition)


def _stop(scale: Scale) -> Iterator[Measurement]:
    for repetition in range(scale.repeats):
        for queued in scale.queued:
            for library in _concurrent(scale):
                stops = scale.stops if library == OURS else max(1, min(scale.stops, 60 // (queued + 1)))
                task = Task(library=library, name="stop", seconds=stops, amount=queued, seed=repetition)
                yield Measurement("stop", task, PACED, repetition)


def _waiting(scale: Scale) -> Iterator[Measurement]:
    for repetition in range(scale.repeats):
        for waiting in scale.waiting:
            for library in _concurrent(scale):
                task = Task(library=library, name="waiting", seconds=scale.waited, amount=waiting)
                yield Measurement("waiting", task, PACED, repetition)


def _faulty(scale: Scale) -> Iterator[Measurement]:
    for repetition in range(scale.repeats):
        for library in scale.libraries:
            if library != FLOOR:  # it believes everything
                task = Task(library=library, name="faulty", seconds=scale.faulty, seed=repetition + 1)
                yield Measurement("faulty", task, NOISY, repetition)


def _lossy(scale: Scale) -> Iterator[Measurement]:
    return _cases(scale, "lossy", LOSSY)


def _dead(scale: Scale) -> Iterator[Measurement]:
    return _cases(scale, "dead", DEAD)


def _cases(scale: Scale, row: str, cases: dict[str, Case]) -> Iterator[Measurement]:
    libraries = [library for library in scale.libraries if library != FLOOR]  # it waits for ever
    breaks_silence = any(not LIBRARIES[library].keeps_silence for library in libraries)
    if OURS in libraries and breaks_silence and BRIEF not in libraries:
        libraries.append(BRIEF)
    for repetition in range(scale.repeats):
        for name, case in cases.items():
            for library in libraries:
                task = Task(
                    library=library,
                    name="lossy",
                    setting=Setting(units=case.units),
                    seconds=scale.lossy,
                    amount=int(case.together),
                    case=name,
                    seed=repetition + 1,
                )
                yield Measurement(row, task, LOSES, repetition)


def _watched(scale: Scale) -> Iterator[Measurement]:
    for baudrate in (38400, 115200):
        setting = Setting(baudrate=baudrate)
        yield Measurement(
            "watched", Task(library=OURS, name="watched", setting=setting, seconds=scale.watched, amount=16), NONE, 0
        )


def _idle(scale: Scale) -> Iterator[Measurement]:
    for repetition in range(scale.repeats):
        for drives in (1, 4, 8, 16):
            for library in {OURS, FLOOR} & set(scale.libraries):
                task = Task(library=library, name="idle", seconds=scale.idle, amount=drives)
                yield Measurement("idle", task, SERVOS, repetition)


def _memory(scale: Scale) -> Iterator[Measurement]:
    yield Measurement("memory", Task(library=OURS, name="memory", seconds=scale.memory), NONE, 0)


def _concurrent(scale: Scale) -> list[str]:
    """The libraries that take a request while another is under way."""
    return [library for library in scale.libraries if not LIBRARIES[library].blocking]


ROWS: dict[str, Callable[[Scale], Iterator[Measurement]]] = {
    "share": _share,
    "stop": _stop,
    "waiting": _waiting,
    "faulty": _faulty,
    "lossy": _lossy,
    "dead": _dead,
    "watched": _watched,
    "idle": _idle,
    "memory": _memory,
}
