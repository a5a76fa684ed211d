"""A share of what `python -m rs485bus.sim.every_fault` runs in full."""

import pytest

from rs485bus.sim.campaigns.faults.campaign import try_all
from rs485bus.sim.campaigns.faults.case import Case, bases, cases_of
from rs485bus.sim.campaigns.faults.fault import FAULTS

EVERY = 37
HARMLESS = {name for name, fault in FAULTS.items() if fault.harmless}


@pytest.mark.parametrize("family", ["mks"])
def test_a_share_of_the_harmless_faults_breaks_no_invariant(family: str) -> None:
    cases = [case for base in bases(family, option="plain") for case in cases_of(base) if case.faults[0][0] in HARMLESS]
    found = try_all(cases[::EVERY])
    assert [(str(case), name, seen) for case, name, seen in found.failed] == []
    assert found.runs > 50


def test_a_run_has_a_command_that_runs_it_again() -> None:
    case = Case("mks", "home-and-move", "stuck-status", goes_on=True, faults=(("reply-lost", 3), ("dead", 5)))
    assert str(case) == (
        "python -m rs485bus.sim.every_fault --family mks --scenario home-and-move --option stuck-status --goes-on "
        "--fault reply-lost,dead --frame 3,5"
    )
