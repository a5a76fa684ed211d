"""A look at what is being stopped whose answer is lost: it is asked again at once, and no pause follows what tells
nothing. By plain calls."""

from __future__ import annotations

import itertools

from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read
from rs485bus.sim.rig import Rig
from rs485bus.sim.treatment import Treatment
from tests.bus.test_stops import is_stop, running

STATUS, POSITION, PULSES = (read(1, what).adu for what in (r.STATUS, r.POSITION, r.PULSES))
SOON = 0.012
"""Seconds from one frame to the next in which no pause of 20 ms fits."""


def stopped(*lost: int) -> tuple[list[bytes], list[float]]:
    """Stop a drive: the frames from the stop on, and the seconds in between. Some answers are lost, by number."""
    rig = Rig()
    (drive,) = running(rig, 1)
    rig.done(rig.submit(read(1, r.STATUS)))  # it is known to answer soon
    rig.sent.clear()
    drive.stop(rig)
    rig.pair.script = lambda frame, now: Treatment(answered=len(rig.sent) - 1 not in lost)
    rig.run(until=lambda: bool(drive.halted))
    assert drive.halted[0].standing
    assert is_stop(rig.sent[0][1])
    pauses = [later - earlier for (earlier, _), (later, _) in itertools.pairwise(rig.sent)]
    return [frame for _, frame in rig.sent], pauses


def test_what_settles_the_lost_answer_is_asked_at_once_and_then_the_same_again() -> None:
    frames, pauses = stopped(3)
    assert frames[1:] == [STATUS, POSITION, POSITION, PULSES, POSITION]
    assert pauses[2] > 0.02  # two positions are to be apart
    assert max(pauses[3:]) < SOON


def test_where_two_looks_in_a_row_are_lost_others_have_their_turns() -> None:
    frames, pauses = stopped(2, 3)
    assert frames[1:4] == [STATUS, POSITION, PULSES]
    assert pauses[2] < SOON
    assert pauses[3] > 0.02
