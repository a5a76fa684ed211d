from __future__ import annotations

from collections.abc import Iterator

import pytest

from benchmarks.service.mosquitto import Mosquitto, running


@pytest.fixture(scope="session")
def broker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mosquitto]:
    """A mosquitto that lets everybody in. Tests that stop it start one of their own."""
    with running(tmp_path_factory.mktemp("mosquitto")) as broker:
        yield broker
