"""A hostile line: no wrong answer, no early frame, no stuck job. The long campaign is a command in the README."""

import pytest

from rs485bus.sim import Noise
from rs485bus.sim.campaign import HOSTILE, Campaign

ECHOING = Noise(**{**{name: getattr(HOSTILE, name) for name in HOSTILE.__slots__}, "echo": True})


@pytest.mark.parametrize(("seed", "noise"), [(1, HOSTILE), (2, HOSTILE), (3, ECHOING)])
def test_a_short_campaign(seed: int, noise: Noise) -> None:
    verdict = Campaign(5_000, units=16, seed=seed, noise=noise).run()
    assert verdict.wrong == []
    assert verdict.stuck == 0
    assert verdict.early_frames == 0
    assert verdict.outcomes["reply"] > 3_000
    assert sum(verdict.outcomes.values()) == 5_000
    assert verdict.late_replies > 50
    assert max(map(len, str(verdict).splitlines())) < 80
