"""Medians, ratios within a repetition, and what is held to be kept."""

from typing import Any

import pytest

from benchmarks.promises import promises
from benchmarks.report import table, verdict
from benchmarks.summary import Runs, Spread


def share(library: str, repetition: int, share: float, cpu: float = 100.0, early: int = 0) -> dict[str, Any]:
    place = {"row": "share", "library": library, "baudrate": 115200, "units": 8, "amount": 0, "repetition": repetition}
    return {**place, "share": share, "typical": share, "cpu_us": cpu, "early": early, "frames": 100, "others": 0.0}


def of(ours: list[float], floor: list[float], early: int = 0) -> Runs:
    runs = [share("rs485bus", number, value, early=early) for number, value in enumerate(ours)]
    return Runs(runs + [share("floor", number, value) for number, value in enumerate(floor)])


def test_a_spread_is_a_median_and_what_it_lies_between() -> None:
    assert Spread.of([3.0, 1.0, 2.0]) == Spread(2.0, 1.0, 3.0)
    assert Spread.of([]) is None


def test_ratios_are_those_within_a_repetition() -> None:
    # The machine was at half its speed in the second repetition, for both.
    ratio = of([0.99, 0.495, 0.98], [1.0, 0.5, 1.0]).ratio("share", "share", "rs485bus", "floor")
    assert ratio is not None
    assert ratio.median == pytest.approx(0.99)


def test_a_library_that_was_not_measured_leaves_no_promise() -> None:
    assert not any("pymodbus" in promise.what for promise in promises(of([0.99], [1.0])))


@pytest.mark.parametrize(("ours", "kept"), [(0.986, True), (0.984, False)])
def test_less_than_the_share_of_the_floor_is_a_broken_promise(ours: float, kept: bool) -> None:
    promise = promises(of([ours], [1.0]))[0]
    assert promise.kept is kept


def test_one_early_frame_is_a_broken_promise() -> None:
    kept = {promise.what: promise.kept for promise in promises(of([0.99], [1.0], early=1))}
    assert kept["no frame before t3.5"] is False


def test_the_table_names_every_library_and_its_spread() -> None:
    runs = of([0.97, 0.96], [0.98, 0.98])
    text = table(runs)
    assert "| | rs485bus | floor |" in text
    assert "96.5 % (96.0..97.0)" in text
    assert verdict(promises(runs)).count("\n") + 1 == len(promises(runs))
