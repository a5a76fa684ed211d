"""Where the wheels took the vehicle, from their counters alone."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus.devices.zlac.odometry import Odometry, Pose

WRAP = 2**32
METRES = 0.0001
"""A count."""
TRACK = 0.5

ways = st.lists(st.tuples(st.integers(-20_000, 20_000), st.integers(-20_000, 20_000)), min_size=1, max_size=20)
counters = st.integers(-(2**31), 2**31 - 1)


def wrapped(counts: int) -> int:
    return (counts + WRAP // 2) % WRAP - WRAP // 2


def drive(steps: list[tuple[int, int]], left: int = 0, right: int = 0) -> Pose:
    odometry = Odometry(TRACK, METRES, METRES)
    odometry.begin((wrapped(left), wrapped(right)))
    for by_left, by_right in steps:
        left, right = left + by_left, right + by_right
        odometry.update((wrapped(left), wrapped(right)))
    return odometry.pose


def test_both_wheels_alike_go_straight_ahead() -> None:
    assert drive([(5000, 5000)] * 4) == Pose(2.0, 0.0, 0.0)


def test_wheels_against_each_other_turn_on_the_spot() -> None:
    quarter = round(math.pi / 4 * TRACK / METRES)
    pose = drive([(-quarter, quarter)])
    assert (pose.x, pose.y) == pytest.approx((0, 0))
    assert pose.heading == pytest.approx(math.pi / 2, abs=1e-3)


def test_one_wheel_alone_turns_about_the_other() -> None:
    half = round(math.pi * TRACK / METRES)
    pose = drive([(0, half)])
    assert (pose.x, pose.y) == pytest.approx((0, TRACK), abs=1e-3)


@given(st.integers(1, 50))
def test_an_arc_is_an_arc_in_however_many_steps(steps: int) -> None:
    left, right = 9000 // steps * steps, 12000 // steps * steps
    whole, parts = drive([(left, right)]), drive([(left // steps, right // steps)] * steps)
    assert (whole.x, whole.y, whole.heading) == pytest.approx((parts.x, parts.y, parts.heading))


@given(ways, counters, counters)
def test_where_the_counters_stand_and_wrap_makes_no_difference(
    steps: list[tuple[int, int]], left: int, right: int
) -> None:
    assert drive(steps, left, right) == drive(steps)


@pytest.mark.parametrize("edge", [2**31 - 1, -(2**31)], ids=["up", "down"])
@pytest.mark.parametrize("way", [3000, -3000])
def test_the_wrap_is_crossed_either_way(edge: int, way: int) -> None:
    assert drive([(way, way)] * 5, edge - 2 * way, edge - 2 * way) == drive([(way, way)] * 5)


@given(ways)
def test_the_way_back_leads_back(steps: list[tuple[int, int]]) -> None:
    pose = drive([*steps, *((-left, -right) for left, right in reversed(steps))])
    assert (pose.x, pose.y, pose.heading) == pytest.approx((0, 0, 0), abs=1e-6)


def test_a_counter_that_began_anew_is_no_way() -> None:
    odometry = Odometry(TRACK, METRES, METRES)
    odometry.begin((50_000, 50_000))
    before = odometry.update((60_000, 60_000))
    odometry.begin((0, 0))
    assert odometry.update((0, 0)) == before
