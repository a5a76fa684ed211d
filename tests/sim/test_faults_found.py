"""What every_fault has found: each kind again at every frame of a scenario in which it happened."""

from dataclasses import replace

import pytest

from rs485bus.sim.campaigns.faults.campaign import try_all
from rs485bus.sim.campaigns.faults.case import Case, without_faults

Failed = list[tuple[str, str, str]]


def at_frames(base: Case, fault: str, which: slice = slice(None)) -> Failed:
    """What fails of a scenario where one fault happens at each of its frames, or at those named."""
    frames = range(without_faults(base).frames)[which]
    cases = [replace(base, faults=((fault, frame),)) for frame in frames]
    return [(str(case), name, seen) for case, name, seen in try_all(cases).failed]


@pytest.mark.parametrize("family", ["mks", "tlr"])
def test_a_stream_whose_last_frame_is_answered_late_says_it_again_and_ends(family: str) -> None:
    assert at_frames(Case(family, "stream-of-speeds"), "reply-late", slice(-20, None)) == []


def test_a_part_of_a_group_that_stands_already_as_the_port_is_lost_does_not_say_that_nothing_was_done() -> None:
    assert at_frames(Case("together", "mixed-group", goes_on=True), "port-lost", slice(60, 80, 2)) == []


def test_a_drive_without_an_encoder_is_not_blamed_for_steps_that_nobody_can_see_it_lose() -> None:
    assert at_frames(Case("tlr", "zero-and-by", option="open-loop"), "stalled", slice(30, 33)) == []


def test_a_stop_that_is_said_twice_at_once_gets_no_harder_because_an_answer_may_be_to_either() -> None:
    assert at_frames(Case("zlac", "settings-then-run"), "reply-late", slice(41, 42)) == []


@pytest.mark.parametrize("scenario", ["move-there-and-back", "zero-and-by"])
def test_a_drive_that_restarts_while_it_is_told_its_move_goes_nowhere_by_the_wrong_zero(scenario: str) -> None:
    assert at_frames(Case("tlr", scenario, option="busy"), "restarted-before") == []


@pytest.mark.parametrize("goes_on", [False, True])
def test_a_drive_that_restarts_before_it_saves_is_asked_again_how_it_counts(goes_on: bool) -> None:
    assert at_frames(Case("tlr", "settings-then-move", option="busy", goes_on=goes_on), "restarted-before") == []


@pytest.mark.parametrize("fault", ["request-lost", "reply-lost"])
def test_a_jog_whose_start_was_lost_is_started_again_and_not_told_a_speed_only(fault: str) -> None:
    assert at_frames(Case("tlr", "run-to-a-stand", option="live-jog"), fault, slice(14, 19)) == []
