"""Whether a wheel stands, told from what is reported of it now and then."""

import pytest

from rs485bus.devices.zlac.telemetry import Stillness, WheelMotion


def wheel(position: int, rpm: float = 0.0) -> WheelMotion:
    return WheelMotion(position, rpm, 0)


@pytest.mark.parametrize("apart", [0.15, 0.7, 1.5])
def test_a_position_that_stays_shows_that_it_stands_though_a_full_line_answers_seldom(apart: float) -> None:
    still = Stillness(0.0, 0.1)
    assert still.see(10.0, wheel(500), running=True) is None
    assert still.see(10.0 + apart, wheel(500), running=True) is True


@pytest.mark.parametrize("apart", [0.05, 0.7, 1.5])
def test_a_position_that_changes_never_does(apart: float) -> None:
    still = Stillness(0.0, 0.1)
    for look in range(10):
        assert still.see(10.0 + look * apart, wheel(500 + 40 * look), running=True) is not True


def test_what_was_seen_long_ago_shows_nothing() -> None:
    still = Stillness(0.0, 0.1)
    still.see(10.0, wheel(500), running=True)
    assert still.see(20.0, wheel(500), running=True) is None
