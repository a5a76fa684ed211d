"""A small share of what python -m benchmarks.service shows."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.service import cuts
from benchmarks.service.campaign import campaign
from tests.real.support import in_real_time


def test_moves_are_done_once_or_unknown_while_broker_service_and_connections_are_killed(tmp_path: Path) -> None:
    async def main() -> None:
        verdict = await campaign(tmp_path, 48, 1, tell=lambda _: None)
        assert verdict.holds, verdict
        assert verdict.said["done"] > 5

    in_real_time(main, 120)


@pytest.mark.skipif(not cuts.may_cut(), reason="only root may make networks that can be cut")
@pytest.mark.parametrize("kind", ["client's network cut", "service's network cut"])
def test_an_axis_stands_within_the_lease_when_the_network_is_cut(tmp_path: Path, kind: str) -> None:
    async def main() -> None:
        cut = await cuts.measure(tmp_path, kind, "run")
        assert cut.confirmed
        assert cut.seconds < cuts.LEASE + 1.0  # a busy machine is slow

    in_real_time(main, 60)
