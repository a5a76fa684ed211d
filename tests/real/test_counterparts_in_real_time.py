"""A short share of the trial of foreign slaves; `python -m tests.real.counterparts` is all of it."""

import asyncio
import os
from pathlib import Path

import pytest

from tests.real.counterparts.slaves import SLAVES, Missing
from tests.real.counterparts.trial import trial
from tests.real.support import posix

pytestmark = posix

REQUESTS = int(os.environ.get("COUNTERPART_REQUESTS", "150"))


@pytest.mark.parametrize("name", SLAVES)
def test_a_foreign_slave_that_is_restarted_answers_all_functions_it_has(name: str, tmp_path: Path) -> None:
    try:
        result = asyncio.run(asyncio.wait_for(trial(SLAVES[name], tmp_path, REQUESTS, restarts=1), 60 + REQUESTS / 20))
    except Missing as missing:
        pytest.skip(str(missing))
    assert result.wrong == 0, result
    assert result.restarts == 1
    assert result.answered > 0.8 * result.requests, result
    assert set(result.functions) <= set(SLAVES[name].functions)
