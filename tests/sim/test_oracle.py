"""The oracle of every_fault is tried by lies: each makes one invariant fail, and no other."""

import dataclasses
from collections.abc import Callable

import pytest

from rs485bus.errors import MoveFailed, NotSent
from rs485bus.sim.campaigns.faults.case import Case
from rs485bus.sim.campaigns.faults.evidence import NEVER, Call, Evidence, Frame, Mishap, Sample, Shaft
from rs485bus.sim.campaigns.faults.oracle import INVARIANTS, judge

Lie = Callable[[Evidence], None]


def call_of(evidence: Evidence, verb: str, at: int = 0) -> Call:
    return [call for call in evidence.calls if call.verb == verb][at]


def shaft_of(evidence: Evidence) -> Shaft:
    return next(iter(evidence.shafts.values()))


def runs_on(evidence: Evidence) -> None:
    """The run has failed, it is said, and the shaft goes on for ten seconds."""
    call_of(evidence, "run").error = MoveFailed("it stands")
    last = shaft_of(evidence).samples[-1]
    shaft_of(evidence).samples.append(Sample(last.at + 10.0, last.position + 25.0, last.rpm))
    evidence.ended = last.at + 10.0


def beyond(evidence: Evidence) -> None:
    """It went through its target and back."""
    samples = shaft_of(evidence).samples
    at = next(at for at, sample in enumerate(samples) if sample.rpm)
    samples[at] = samples[at]._replace(position=3.0)


def older(evidence: Evidence) -> None:
    """What was asked for before a stop sets it in motion after it, and has not ended."""
    stop = call_of(evidence, "stop")
    call_of(evidence, "move_to").ended = stop.begun + 0.1
    shaft_of(evidence).starts.append(stop.begun + 0.05)


def unheard(evidence: Evidence) -> None:
    """Something happens to it under way, and its move ends five seconds later."""
    move = call_of(evidence, "move_to")
    at = max(sample.at for sample in shaft_of(evidence).samples if sample.rpm)
    shaft_of(evidence).mishaps.append(Mishap(at, "stall"))
    move.ended += 5.0
    evidence.ended += 5.0


def set_up(field: str, value: object) -> Lie:
    return lambda evidence: setattr(evidence, field, value)


def tell(verb: str, **fields: object) -> Lie:
    def lie(evidence: Evidence) -> None:
        for name, value in fields.items():
            setattr(call_of(evidence, verb), name, value)

    return lie


LIES: list[tuple[str, str, Lie]] = [
    ("stopped-is-still", "run-and-stop", lambda e: setattr(call_of(e, "stop"), "ended", call_of(e, "stop").begun)),
    ("done-is-there", "left-while-moving", tell("move_to", args=(0.71,))),
    ("positions-are-so", "move-there-and-back", tell("position", result=0.1)),
    ("speed-is-so", "left-running", tell("run", args=(100.0,))),
    ("provisioned-is-so", "provisioned-and-moved", lambda e: shaft_of(e).answers_at.pop(1)),
    ("refused-is-nothing", "move-there-and-back", tell("move_by", error=NotSent("the port is lost"))),
    ("nothing-older-after-a-stop", "stop-in-the-middle", older),
    ("motion-is-asked-for", "move-there-and-back", lambda e: shaft_of(e).starts.append(e.ended - 0.5)),
    ("never-further-than-asked", "move-there-and-back", beyond),
    ("failure-leaves-nothing-turning", "left-running", runs_on),
    ("closed-is-still", "left-running", set_up("left_running", False)),
    ("within-limits", "within-limits", lambda e: setattr(shaft_of(e), "limits", (-0.1, 1.0))),
    ("everything-ends", "move-there-and-back", tell("position", ended=NEVER)),
    ("mishaps-are-told", "left-while-moving", unheard),
    ("errors-are-ours", "move-there-and-back", tell("position", error=KeyError(3))),
    ("silence-is-kept", "move-there-and-back", set_up("early_frames", 1)),
    ("watchdogs-are-left-as-found", "guarded-moves", set_up("armed", {1: (0, 500)})),
    ("the-guarded-are-fed", "guarded-moves", lambda e: shaft_of(e).trips.append(e.begun + 0.1)),
    ("best-true-end", "move-twice", set_up("expected", [("mks 1", "enable", "done"), ("mks 1", "move_by", "done")])),
]


@pytest.mark.parametrize(("invariant", "scenario", "lie"), LIES, ids=[name for name, _, _ in LIES])
def test_a_lie_breaks_one_invariant_and_no_other(invariant: str, scenario: str, lie: Lie) -> None:
    evidence = Case("mks", scenario).run()
    assert judge(evidence) == []
    lie(evidence)
    assert {name for name, _ in judge(evidence)} == {invariant}


def turning(name: str, *, together: tuple[str, ...] = ()) -> Shaft:
    """A shaft that turns for six seconds."""
    ways = ((0.0, 0.0, 0.0), (0.1, 0.0, 60.0), (6.0, 5.9, 60.0), (6.1, 6.0, 0.0), (9.0, 6.0, 0.0))
    return Shaft(name, 1, samples=[Sample(*way) for way in ways], starts=[0.1], together=together)


def run_of(shaft: str, ended: float, error: Exception | None = None) -> Call:
    return Call(shaft, "run", (60.0,), {"duration": 6.0}, 0.0, (shaft,), ended, None, error)


def looks(*times: float) -> list[Frame]:
    return [Frame(at, b"\x01\x04", "") for at in times]


def test_a_motor_that_nobody_asks_about_is_found() -> None:
    evidence = Evidence({"x": turning("x")}, looks(*range(7)), [run_of("x", 6.2)], ended=9.0)
    assert judge(evidence) == []
    del evidence.frames[3]
    assert {name for name, _ in judge(evidence)} == {"turning-is-watched"}


def test_the_other_wheel_that_goes_on_is_found() -> None:
    shafts = {"l": Shaft("l", 1, samples=[Sample(0.0, 0.0, 0.0)], together=("r",)), "r": turning("r", together=("l",))}
    left, right = run_of("l", 0.5, MoveFailed("a fault")), run_of("r", 6.2)
    evidence = Evidence(shafts, looks(*range(7)), [left, dataclasses.replace(right)], ended=9.0)
    assert {name for name, _ in judge(evidence)} == {"the-others-stand"}
    left.ended = 5.0
    assert judge(evidence) == []


def test_every_invariant_is_tried_by_a_lie() -> None:
    assert {name for name, _, _ in LIES} | {"turning-is-watched", "the-others-stand"} == set(INVARIANTS)
