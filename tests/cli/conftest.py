"""A command that runs within a test leaves the log and the settings of the process as they were."""

import logging
from collections.abc import Iterator

import pytest

from rs485bus.cli.settings import settings


@pytest.fixture(autouse=True)
def _as_it_was() -> Iterator[None]:
    root = logging.getLogger()
    handlers, level = root.handlers[:], root.level
    yield
    root.handlers[:] = handlers
    root.setLevel(level)
    settings.verbose, settings.debug = 0, False
