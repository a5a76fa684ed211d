from collections.abc import Iterator

import pytest

from tests.blocking.support import virtual_time


@pytest.fixture(autouse=True)
def _virtual_time() -> Iterator[None]:
    with virtual_time():
        yield
