"""A small share of `python -m benchmarks.latency`: what goes wrong is told, and the motor stopped, in time."""

import pytest

from benchmarks.latency import FAMILIES, FOREIGN, LIMIT, cases, group, latency
from benchmarks.virtual_clock import on_virtual_clock

EACH = list(cases(FAMILIES))


@pytest.mark.parametrize(("family", "motion", "event"), EACH)
def test_what_goes_wrong_is_told_and_the_motor_stopped_within_half_a_second(
    family: str, motion: str, event: str
) -> None:
    for poll in (0,) if motion in FOREIGN else (0, 20):
        took = on_virtual_clock(latency(FAMILIES[family], motion, event, poll, "clean"))
        assert max(took.told, took.stopped) <= LIMIT["clean"], (poll, took)


@pytest.mark.parametrize("line", ["5 % lost", "saturated"])
@pytest.mark.parametrize(("family", "motion", "event"), EACH[::9])
def test_so_it_is_where_frames_are_lost_and_within_a_second_where_others_saturate_the_line(
    family: str, motion: str, event: str, line: str
) -> None:
    took = on_virtual_clock(latency(FAMILIES[family], motion, event, 0, line, seed=1))
    assert max(took.told, took.stopped) <= LIMIT[line], took


@pytest.mark.parametrize(("baudrate", "most"), [(115200, 0.6), (9600, 1.5)])
def test_a_fault_of_one_of_twelve_has_all_others_stand_in_time(baudrate: int, most: float) -> None:
    assert on_virtual_clock(group(baudrate, "fault", seed=2)) <= most


@pytest.mark.parametrize(
    ("family", "motion", "event", "poll", "seed"),
    [
        # A look that had to wait for a late reply to the application kept the supervisor from any other one.
        ("MKS", "homing", "restart", 20, 0),
        # Pauses for others were long.
        ("MKS", "move", "restart", 0, 2),
    ],
)
def test_so_it_is_where_losses_were_found_to_delay_it(
    family: str, motion: str, event: str, poll: int, seed: int
) -> None:
    took = on_virtual_clock(latency(FAMILIES[family], motion, event, poll, "5 % lost", seed))
    assert max(took.told, took.stopped) <= LIMIT["5 % lost"], took
