"""Guarded drives on a line that is never idle, for a short while. The hour is a command in the README."""

import pytest

from rs485bus.sim.endurance import Endurance, Verdict


@pytest.mark.parametrize(("loss", "seconds"), [(0.0, 10.0), (0.05, 10.0)])
def test_31_drives_of_two_families_never_trip_and_are_fed_by_what_they_are_asked(loss: float, seconds: float) -> None:
    verdict = Endurance(seconds, loss=loss).run()
    assert verdict.faults == []
    assert verdict.longest_unheard < 0.6
    assert verdict.moves > 40
    assert verdict.retries > 20 if loss else verdict.retries == 0


def test_devices_that_answer_seconds_late_now_and_then_trip_nobody_and_are_never_misunderstood() -> None:
    verdict = Endurance(10.0, loss=0.05, sluggish=2).run()
    assert verdict.faults == []
    assert verdict.questions > 300
    assert verdict.moves > 40


@pytest.mark.parametrize("sluggish", [0, 2])
def test_only_a_device_that_answers_seconds_late_may_be_taken_for_offline(sluggish: int) -> None:
    verdict = Verdict(1, 0.05, sluggish, moves=1, saved=1)
    verdict.errors["a question raised DeviceOffline: Not sent"] = 1
    assert [fault.startswith("unexpected") for fault in verdict.faults] == [True] * (not sluggish)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"trips": 1}, "1 drives tripped"),
        ({"misplaced": ["MKS 1 at 1.0000, sent to 2.0000"]}, "MKS 1 at 1.0000"),
        ({"saved": 80, "feeds": 20}, "only 80.0%"),
        ({"wrong": ["unit 32 was asked for 1"]}, "1 wrong answers: ['unit 32"),
        ({"idle": 0.01}, "idle for 10.0 ms"),
        ({"memory": [20_000, 30_000]}, "grew by 10000 kB"),
        ({"moves": 0}, "nothing moved"),
        ({"loss": 0.0}, "raised NoReply"),
    ],
)
def test_what_is_wrong_is_named(wrong: dict[str, object], said: str) -> None:
    fine = {"devices": 31, "loss": 0.05, "saved": 100, "moves": 1, "silence": 0.00175, "memory": [20_000, 20_100]}
    verdict = Verdict(**fine)  # type: ignore[arg-type]
    verdict.errors["a question raised NoReply"] = 1
    assert verdict.faults == []
    for name, value in wrong.items():
        setattr(verdict, name, value)
    (fault,) = verdict.faults
    assert said in fault
