"""How long a real port's reply is waited for beyond what its unit usually takes: this computer may be late."""

import random

import pytest

from rs485bus.bus.line.host_slack import HostSlack
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding
from tests.bus.support import Scripted

LONGEST = 0.008
QUICK = 0.007
"""What a lost transaction takes here where nothing is waited for beyond what the unit takes, in seconds."""


def rig_of(lost: float) -> tuple[Rig, Scripted]:
    """A unit on a real port, on a line that has lost a share of its replies for a while."""
    chance = random.Random(1)
    unit = Scripted(1, *(0.002 if chance.random() >= lost else "lost" for _ in range(300)))
    rig = Rig(unit)
    rig.owner.pair.host = HostSlack(LONGEST)
    while unit.script:
        rig.done(rig.submit(read_holding(1, 0, 2)))
    for _ in range(5):
        rig.done(rig.submit(read_holding(1, 0, 2)))  # what was lost last is asked for as usual again
    return rig, unit


def repeated_after(rig: Rig) -> float:
    """Seconds after which what was lost is asked again."""
    sent = len(rig.sent)
    rig.done(rig.submit(read_holding(1, 0, 2)))
    return rig.sent[sent + 1][0] - rig.sent[sent][0]


def test_on_a_line_that_loses_nothing_a_reply_that_comes_late_is_never_hit_by_the_next_frame() -> None:
    rig, unit = rig_of(0.0)
    unit.script.extend([0.002 + LONGEST, 0.002, "lost"])
    for _ in range(2):
        rig.done(rig.submit(read_holding(1, 0, 2)))
    assert all(record.outcome == "reply" for record in rig.owner.journal.flight)
    assert repeated_after(rig) > LONGEST


@pytest.mark.parametrize("lost", [0.1, 0.3])
def test_on_a_line_that_loses_much_a_lost_reply_costs_little_more_than_its_transaction(lost: float) -> None:
    rig, unit = rig_of(lost)
    unit.script.append("lost")
    assert repeated_after(rig) < QUICK + LONGEST / 3


@pytest.mark.parametrize("late", [0.005, 0.007, 0.009])
def test_a_computer_that_was_late_there_is_waited_for_longer_from_then_on(late: float) -> None:
    rig, unit = rig_of(0.3)
    unit.script.append(0.002 + late)
    assert repeated_after(rig) < QUICK + LONGEST / 3  # it was given up too soon
    rig.run(0.1)
    unit.script.append("lost")
    assert repeated_after(rig) > 0.002 + late


def test_what_was_lost_once_is_forgotten() -> None:
    slack = HostSlack(LONGEST)
    for _ in range(50):
        slack.missed()
    assert slack.seconds < LONGEST / 4
    for _ in range(500):
        slack.came_in_time()
    assert slack.seconds == LONGEST


def test_a_unit_that_was_late_itself_is_no_fault_of_the_computer() -> None:
    slack = HostSlack(LONGEST)
    for _ in range(1000):
        slack.missed()
    slack.came_late(0.08)
    assert slack.seconds < LONGEST / 4
    for _ in range(10):
        slack.came_late(0.007)
    assert slack.seconds == LONGEST
