"""A hostile line: no wrong answer, no early frame, no stuck job. The long campaign is a command in the README."""

import pytest

from rs485bus.bus.line.pending import PendingReplies
from rs485bus.bus.schedule.job import Job
from rs485bus.sim import Noise
from rs485bus.sim.campaign import ECHOING, HOSTILE, Campaign, kinds_of
from rs485bus.sim.campaigns.wire_judge import WireJudge


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


def test_a_short_campaign_behind_a_gateway() -> None:
    verdict = Campaign(2_500, seed=13, gateway=True).run()
    assert verdict.is_good, verdict.wrong[:5]
    assert verdict.events["stops"] > 30
    assert verdict.events["unpluggings"] > 1


def test_lines_of_all_kinds_take_part_where_many_campaigns_are_run() -> None:
    kinds = [kinds_of(seed) for seed in range(3)]
    assert {(kind["noise"] is ECHOING, kind["gateway"]) for kind in kinds} == {
        (False, False),
        (True, False),
        (False, True),
    }


def test_what_may_not_be_on_the_wire_is_found() -> None:
    broadcast, move, stop = b"\x00\x06\x00\x01\x00\x01\xff\xff", b"\x11\x10move", b"\x11\x06stop"
    judge = WireJudge(turnaround=0.02, character=0.001, drives=[0x11])
    assert judge.sent(broadcast, 1.0, moves=False, bidden=True) == ""
    assert "turnaround" in judge.sent(move, 1.02, moves=True, bidden=True)
    assert judge.sent(stop, 1.021, moves=False, bidden=False) == ""
    assert judge.sent(move, 1.0281, moves=True, bidden=True) == ""
    judge.stop_all(2.0)
    assert "emergency stop holds" in judge.sent(move, 2.01, moves=True, bidden=True)
    assert "0.160 s after it was asked for" in judge.sent(stop, 2.16, moves=False, bidden=False)
    judge.stop(0x11, 3.0)
    judge.is_away = True
    assert "away" in judge.sent(stop, 3.0, moves=False, bidden=False)
    judge.port_is_back(4.0)
    assert judge.sent(stop, 4.1, moves=False, bidden=False) == ""


def test_the_campaign_finds_what_moves_after_a_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Job, "is_stale", property(lambda job: False))
    verdict = Campaign(3_000, units=4, seed=1).run()
    assert any("older than a stop" in fault for fault in verdict.wrong)


def test_the_campaign_finds_late_replies_that_are_taken_for_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PendingReplies, "must_wait", lambda *_: 0.0)
    verdict = Campaign(5_000, units=2, seed=1).run()
    assert any("the answer to another request" in fault for fault in verdict.wrong)
