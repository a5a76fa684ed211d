"""What every_fault has found: each kind again at every frame of a scenario in which it happened."""

import pytest

from rs485bus.sim.campaigns.faults.campaign import try_all
from rs485bus.sim.campaigns.faults.case import Case, without_faults

Failed = list[tuple[str, str, str]]


def at_every_frame(base: Case, fault: str) -> Failed:
    """What fails of a scenario where one fault happens at each of its frames."""
    cases = [
        Case(base.family, base.scenario, base.option, base.goes_on, ((fault, frame),))
        for frame in range(without_faults(base).frames)
    ]
    return [(str(case), name, seen) for case, name, seen in try_all(cases).failed]


@pytest.mark.parametrize("family", ["mks", "tlr"])
def test_a_stream_whose_last_frame_is_answered_late_says_it_again_and_ends(family: str) -> None:
    assert at_every_frame(Case(family, "stream-of-speeds"), "reply-late") == []
