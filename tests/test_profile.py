"""Moves take as long as their ramps say."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus.motion.profile import Profile, ramp_for, rpm_for, seconds_to
from rs485bus.sim.motor import Motor

turns = st.floats(0.001, 10_000)
rpms = st.floats(1, 3000)
ramps = st.floats(50, 20_000) | st.just(math.inf)


def test_a_long_move_is_two_ramps_and_a_cruise() -> None:
    # 600 rpm at 600 rpm/s: a second and 5 turns each way, the other 10 turns in a second.
    assert Profile(20, 600, 600).duration == pytest.approx(3.0)


def test_a_short_move_never_reaches_its_speed() -> None:
    short = Profile(2.5, 600, 600)
    assert short.peak == pytest.approx(300)
    assert short.duration == pytest.approx(1.0)


def test_without_a_ramp_only_the_speed_counts() -> None:
    assert Profile(10, 600).duration == pytest.approx(1.0)


def test_a_move_of_nothing_takes_no_time() -> None:
    assert Profile(0, 600, 100).duration == 0
    assert Profile(5e-324, 78, 50).duration == 0
    assert Profile(5e-324, 78, math.inf).duration == pytest.approx(0)


@given(turns, rpms, ramps)
def test_the_simulated_shaft_takes_as_long_as_the_profile_says(way: float, rpm: float, ramp: float) -> None:
    motor = Motor()
    motor.go_to(-way, rpm, ramp, now=10.0)
    assert motor.arrives_at - 10 == pytest.approx(Profile(way, rpm, ramp).duration, rel=1e-6, abs=1e-6)
    assert motor.position(motor.arrives_at) == -way
    assert not motor.moving(motor.arrives_at)


@given(turns, rpms, ramps)
def test_the_speed_for_a_duration_is_found_again(way: float, rpm: float, ramp: float) -> None:
    profile = Profile(way, rpm, ramp)
    found = rpm_for(way, profile.duration, ramp)
    assert found is not None or profile.peak < rpm
    if found is not None:
        assert Profile(way, found, ramp).duration == pytest.approx(profile.duration, rel=1e-4)


def test_a_duration_that_the_ramps_cannot_keep_is_none() -> None:
    assert rpm_for(100, 0.5, 100) is None


@given(st.lists(st.tuples(st.floats(-50, 50), rpms, ramps, st.floats(0, 5)), min_size=1, max_size=6))
def test_a_target_changed_on_the_way_is_reached_without_a_jump(orders: list[tuple[float, float, float, float]]) -> None:
    motor, now = Motor(), 0.0
    for target, rpm, ramp, wait in orders:
        before = motor.position(now)
        motor.go_to(target, rpm, ramp, now)
        assert motor.position(now) == pytest.approx(before, abs=1e-9)
        now += wait
    assert motor.position(motor.arrives_at + 1) == orders[-1][0]
    assert not motor.moving(motor.arrives_at + 1)


@given(st.floats(-5000, 5000), rpms, ramps, st.floats(-3000, 3000))
def test_a_turning_shaft_takes_as_long_to_another_target_as_the_profile_says(
    way: float, rpm: float, ramp: float, speed: float
) -> None:
    motor = Motor()
    motor.run(speed, math.inf, now=0.0)
    motor.go_to(motor.position(1.0) + way, rpm, ramp, now=1.0)
    assert motor.arrives_at - 1 == pytest.approx(seconds_to(way, rpm, ramp, speed), rel=1e-6, abs=1e-6)


@given(turns, rpms, ramps, st.floats(0, 1))
def test_on_its_way_a_move_is_where_the_simulated_shaft_is(way: float, rpm: float, ramp: float, part: float) -> None:
    motor, profile = Motor(), Profile(way, rpm, ramp)
    motor.go_to(way, rpm, ramp, now=10.0)
    seconds = part * profile.duration
    assert profile.turns_after(seconds) == pytest.approx(motor.position(10 + seconds), rel=1e-6, abs=1e-6)
    assert profile.turns_after(-1.0) == 0
    assert profile.turns_after(profile.duration + 1) == way


@given(turns, rpms, ramps)
def test_the_ramp_for_a_duration_is_found_again(way: float, rpm: float, ramp: float) -> None:
    duration = Profile(way, rpm, ramp).duration
    found = ramp_for(way, duration, rpm)
    if found is not None:
        assert Profile(way, rpm, found).duration == pytest.approx(duration, rel=1e-4)
    else:
        assert duration == pytest.approx(Profile(way, rpm).duration)


def test_a_duration_that_a_speed_cannot_keep_is_none() -> None:
    assert ramp_for(100, 0.5, 100) is None
