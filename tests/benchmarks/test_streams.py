"""How old set-points are on the wire, as the benchmark measures it."""

import pytest

from benchmarks.streams import FAMILIES, stream
from benchmarks.virtual_clock import on_virtual_clock


@pytest.mark.parametrize("case", ["alone", "with 3 polled"])
@pytest.mark.parametrize(("baudrate", "rate"), [(38400, 20), (38400, 47), (115200, 50), (115200, 100)])
def test_no_set_point_is_older_than_three_transactions_where_it_takes_three_frames(
    baudrate: int, rate: int, case: str
) -> None:
    """Neither where others are polled at the same time, nor where set-points come faster than they can be told."""
    result = on_virtual_clock(stream(FAMILIES["TL-R"], baudrate, rate, case, seconds=3.0))
    median, _, oldest = result.wire
    assert oldest <= 3.0
    assert case != "alone" or rate != 50 or median <= 1.5
    assert result.rate >= min(rate, 20) - 1
