"""How long a real port's reply is waited for beyond what its unit usually takes: as long as this computer was late."""

import pytest

from rs485bus.bus.line.host_slack import HostSlack
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding
from tests.bus.support import Scripted

LONGEST = 0.008


def rig_of(*script: str | float) -> tuple[Rig, Scripted]:
    """A unit on a real port, which answered a hundred times in its time; then it does what the script says."""
    unit = Scripted(1, *[0.002] * 100, *script)
    rig = Rig(unit)
    rig.owner.pair.host = HostSlack(LONGEST)
    for _ in range(100):
        rig.done(rig.submit(read_holding(1, 0, 2)))
    return rig, unit


def repeated_after(rig: Rig) -> float:
    """Seconds after which what was lost is asked again."""
    sent = len(rig.sent)
    rig.done(rig.submit(read_holding(1, 0, 2)))
    return rig.sent[sent + 1][0] - rig.sent[sent][0]


def test_a_lost_reply_costs_no_time_for_which_this_computer_was_never_late() -> None:
    """Twice 8 bytes on the wire, 2 ms until the unit answers, and the margin."""
    rig, _ = rig_of("lost")
    assert repeated_after(rig) < 0.007


def test_until_a_hundred_answers_came_in_time_the_computer_may_be_late() -> None:
    rig = Rig(Scripted(1, *[0.002] * 3, "lost"))
    rig.owner.pair.host = HostSlack(LONGEST)
    for _ in range(3):
        rig.done(rig.submit(read_holding(1, 0, 2)))
    assert repeated_after(rig) > 0.007 + LONGEST / 2


@pytest.mark.parametrize("late", [0.004, 0.006, 0.009])
def test_a_computer_that_was_late_is_waited_for_longer_from_then_on(late: float) -> None:
    rig, unit = rig_of(0.002 + late)
    assert repeated_after(rig) < 0.007  # it was given up too soon
    rig.run(0.1)
    unit.script.extend(("lost", 0.002))
    assert repeated_after(rig) > 0.002 + late


def test_a_unit_that_was_late_itself_is_no_fault_of_the_computer() -> None:
    slack = HostSlack(LONGEST)
    for _ in range(1000):
        slack.came_in_time()
    slack.came_late(0.08)
    assert slack.seconds < 1e-6


def test_it_is_never_longer_than_a_computer_may_be_late() -> None:
    slack = HostSlack(LONGEST)
    for _ in range(10):
        slack.came_late(0.007)
    assert slack.seconds == LONGEST
