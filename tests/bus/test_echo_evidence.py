"""What answered reads tell of the adapter, and what comes of that, whatever stands around the answers."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rs485bus.bus.config import BusConfig
from rs485bus.bus.line.echo import EchoQuestion
from rs485bus.bus.schedule.job import Outcome
from rs485bus.sim import Noise
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding, read_input, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from tests.bus.test_echo import Dirty, without_its_first_byte


def verdicts(*pieces: tuple[bool, bool], first: bool | None = None) -> list[bool | None]:
    """What is found after each piece of evidence: whether it echoed, and whether that was clean."""
    question = EchoQuestion(None)
    question.verdict = first
    found = []
    for echoed, clean in pieces:
        question.judge(echoed, clean)
        found.append(question.verdict)
    return found


def test_one_clean_piece_decides_and_two_where_there_was_noise() -> None:
    assert verdicts((True, True)) == [True]
    assert verdicts((False, False), (False, False)) == [None, False]
    assert verdicts((True, False), (False, False), (True, False)) == [None, None, True]
    assert verdicts((True, False), (False, True)) == [None, False]


def test_two_pieces_in_a_row_change_the_verdict() -> None:
    assert verdicts((True, True), (True, True), first=False) == [False, True]
    assert verdicts((False, True), (True, True), (False, True), (False, False), first=True) == [True, True, True, False]


@pytest.mark.parametrize("told", [True, False])
def test_what_the_configuration_says_is_not_questioned(told: bool) -> None:
    question = EchoQuestion(told)
    for _ in range(3):
        question.judge(not told, True)
    question.reopen()
    assert question.verdict is told
    assert not question.keeps_waiting(1)


# Whatever adapter, pair and units there are

noises = st.sampled_from([b"", b"\0", b"\xff", b"\0\xff\0", b"\x01", b"\x01\x03"])
asked = st.lists(
    st.tuples(st.integers(1, 4), st.sampled_from([3, 4, 6, 16]), st.sampled_from([0.0, 0.05, 0.5])),
    min_size=1,
    max_size=8,
)


@settings(max_examples=150)
@given(st.sampled_from(["none", "whole", "torn"]), noises, noises, st.sets(st.integers(1, 4)), asked)
def test_what_is_there_is_answered_and_what_is_not_never_looks_as_if_it_were(
    echo: str, before: bytes, behind: bytes, there: set[int], jobs: list[tuple[int, int, float]]
) -> None:
    units = [Dirty(unit, before, behind) for unit in there]
    rig = Rig(*units, noise=Noise(echo=echo != "none"), config=BusConfig(offline_after=100))
    if echo == "torn":
        without_its_first_byte(rig)
    made = []
    for value, (unit, function, pause) in enumerate(jobs):
        if function == 6:
            request = write_single(unit, 3, value)
        elif function == 16:
            request = write_multiple(unit, 4, [value, value])
        else:
            request = (read_holding if function == 3 else read_input)(unit, 5, 1 + value % 3)
        made.append(rig.submit(request, repeat=Repeat.NEVER))
        rig.run(pause)
    rig.done(*made, within=30)
    for job in made:
        if job.address in there:
            assert job.outcome is Outcome.REPLY
        else:
            assert job.outcome in (Outcome.NO_REPLY, Outcome.UNKNOWN, Outcome.NOT_SENT)
    rig.run(60)
    sent = len(rig.sent)
    rig.run(60)
    assert len(rig.sent) - sent <= 60 * len({job.address for job in made} - there)
