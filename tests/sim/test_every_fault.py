"""A share of what `python -m rs485bus.sim.every_fault` and `python -m rs485bus.sim.long_motion` run in full."""

import sys
from dataclasses import replace

import pytest

from rs485bus.sim.campaigns.faults import campaign
from rs485bus.sim.campaigns.faults.campaign import Found, Piece, try_all
from rs485bus.sim.campaigns.faults.case import Case, bases, cases_of
from rs485bus.sim.campaigns.faults.fault import FAULTS
from rs485bus.sim.campaigns.faults.long import judged

EVERY = {"mks": 61, "zlac": 331, "tlr": 97, "together": 151}
HARMLESS = {name for name, fault in FAULTS.items() if fault.harmless}


@pytest.mark.parametrize("family", list(EVERY))
def test_a_share_of_the_harmless_faults_breaks_no_invariant(family: str) -> None:
    chosen = bases(family, option="plain")
    cases = [case for base in chosen for case in cases_of(base) if case.faults[0][0] in HARMLESS][:: EVERY[family]]
    found = try_all(cases)
    assert [(str(case), name, seen) for case, name, seen in found.failed] == []
    assert found.runs > 30


def test_a_pair_that_is_never_quiet_for_a_while_breaks_no_invariant() -> None:
    cases = [case for case in cases_of(Case("mks", "run-and-stop")) if case.faults[0][0].startswith("line-babbles")]
    found = try_all(cases[::4])
    assert [(str(case), name, seen) for case, name, seen in found.failed] == []
    assert found.runs > 5


def test_some_seconds_of_a_mixed_plant_among_noise_break_no_invariant() -> None:
    _, moves, _, wrong = judged(1, 0, 5.0)
    assert wrong == []
    assert moves > 20


def test_a_run_has_a_command_that_runs_it_again() -> None:
    case = Case("mks", "home-and-move", "stuck-status", goes_on=True, faults=(("reply-lost", 3), ("dead", 5)))
    assert str(case) == (
        "python -m rs485bus.sim.every_fault --family mks --scenario home-and-move --option stuck-status --goes-on "
        "--fault reply-lost,dead --frame 3,5"
    )


def test_what_is_not_run_again_is_the_same_for_an_application_that_goes_on_after_errors() -> None:
    base = Case("mks", "move-there-and-back")
    for case in cases_of(base)[::97]:
        evidence, wrong = case.judged()
        if not evidence.gave_up:
            other, also_wrong = replace(case, goes_on=True).judged()
            assert (other.frames, also_wrong) == (evidence.frames, wrong)
            assert [str(call) for call in other.calls] == [str(call) for call in evidence.calls]
    found = try_all(cases_of(base)[::97], both=True)
    assert found.alike > found.runs / 4


@pytest.mark.parametrize("terminal", [False, True])
def test_what_fails_is_told_before_the_other_runs_have_ended(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], terminal: bool
) -> None:
    case = Case("mks", "home-and-move", faults=(("reply-lost", 3),))

    def killed_at_the_second(cases: list[Case], *, both: bool) -> Found:
        if not cases:
            raise KeyboardInterrupt
        return Found(runs=1, failed=[(case, "everything-ends", "a call [bold] has not")])

    monkeypatch.setattr(campaign, "try_all", killed_at_the_second)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    with pytest.raises(KeyboardInterrupt):
        campaign.run_all([Piece([case]), Piece([])], 1, show=True)
    told = capsys.readouterr().err
    assert str(case) in told
    assert "    everything-ends: a call [bold] has not" in told
