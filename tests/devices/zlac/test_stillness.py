"""Whether a wheel stands, told from what is reported of it now and then."""

import pytest

from rs485bus.devices.zlac.ability import ZlacOptions
from rs485bus.devices.zlac.drive import ZlacDrive
from rs485bus.motion.standstill import Standstill

SAYS_NOTHING = None
"""A run bit that is set: it may be the other wheel's."""


def wheel(resolution: int = 1) -> Standstill:
    drive = ZlacDrive(1, ZlacOptions(speed_resolution=resolution))
    drive.learn((4096, 4096))
    return Standstill(drive.state.axes[0].rule)


def test_a_wheel_stands_when_its_position_stays_whatever_else_is_said() -> None:
    still = wheel()
    still.see(0.00, 100, False, 0.0)
    assert still.verdict is None
    still.see(0.03, 101, False, 0.1)
    assert still.verdict is None
    still.see(0.05, 100, False, 0.0)
    assert still.verdict is True
    still.see(0.23, 110, False, 0.0)
    assert still.verdict is False
    still.see(0.30, 110, SAYS_NOTHING, 0.0)
    assert still.verdict is None
    still.see(0.34, 110, SAYS_NOTHING, 0.0)
    assert still.verdict is True
    still.see(0.40, 110, False, 5.0)
    assert still.verdict is False


@pytest.mark.parametrize("apart", [0.15, 0.7, 1.5])
def test_a_position_that_stays_shows_that_it_stands_though_a_full_line_answers_seldom(apart: float) -> None:
    still = wheel()
    still.see(10.0, 500, SAYS_NOTHING, 0.0)
    assert still.verdict is None
    still.see(10.0 + apart, 500, SAYS_NOTHING, 0.0)
    assert still.verdict is True


@pytest.mark.parametrize("apart", [0.05, 0.7, 1.5])
def test_a_position_that_changes_never_does(apart: float) -> None:
    still = wheel()
    for look in range(10):
        still.see(10.0 + look * apart, 500 + 40 * look, SAYS_NOTHING, 0.0)
        assert still.verdict is not True


@pytest.mark.parametrize("resolution", [1, 4, 10])
def test_a_wheel_at_the_slowest_speed_that_it_can_be_told_is_not_taken_for_standing(resolution: int) -> None:
    counts_per_second = 4096 / 60 / resolution
    for pause in (0.005, 0.02, 0.05, 0.2):
        still = wheel(resolution)
        for look in range(200):
            at = look * pause
            still.see(at, round(counts_per_second * at), False, 1 / resolution)
            assert still.verdict is not True
