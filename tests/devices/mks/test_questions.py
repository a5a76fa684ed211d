"""Everything a drive can be asked, and what is said of it."""

import pytest

from rs485bus.devices.mks import ALARMS, Encoder, Homed, Homings, Inputs, MksStatus, Status, alarm
from rs485bus.devices.mks.alarms import HOMING, LOW_VOLTAGE, STALLED, hints
from rs485bus.sim import Machine
from tests.devices.mks.bench import FlakyMks, bench, on_virtual_clock


@on_virtual_clock
async def test_every_read_has_its_question() -> None:
    async with bench(FlakyMks(shaft=1.25, machine=Machine(following_error=2))) as on:
        axis = on.axis
        await axis.move_by(-2.0, rpm=600)
        assert await axis.encoder() == Encoder(-1, 0x1000)
        assert await axis.counts() == -2 * 0x4000 + 2
        assert await axis.position() == pytest.approx(-2, abs=1e-3)
        assert await axis.velocity() == 0
        assert await axis.pulses() == 2**32 - 6400
        assert await axis.angle_error() == pytest.approx(2 * 360 / 16384, abs=0.01)
        assert await axis.enabled() is True
        assert await axis.homed() == Homings(Homed.NOT_DONE, Homed.NOT_DONE)
        assert await axis.version() == 0x0109
        assert await axis.stalled() is False
        assert await axis.inputs() == Inputs.IN_1  # nothing closed at trigger level low
        assert await axis.motor_status() is Status.STOPPED
        assert await axis.status() == MksStatus(
            Status.STOPPED, True, Homed.NOT_DONE, Homed.NOT_DONE, False, Inputs.IN_1
        )


def test_every_alarm_of_the_screen_has_a_remedy() -> None:
    assert len(ALARMS) == 13
    assert len({each.shown for each in ALARMS}) == 13
    assert all(each.remedy and not each.remedy.endswith(".") for each in ALARMS)


@pytest.mark.parametrize("each", ALARMS, ids=lambda each: each.shown)
def test_an_alarm_is_found_by_what_is_shown(each: object) -> None:
    assert each in ALARMS
    shown = next(known.shown for known in ALARMS if known is each)
    assert alarm(shown) is each
    assert alarm(f"  {shown.upper()} ") is each


def test_an_alarm_is_found_by_the_beginning_of_what_is_shown() -> None:
    assert alarm("Wrong...") is STALLED
    assert alarm("Wrong2...") is STALLED
    assert alarm("coming back") is HOMING
    for shown in ("", "Magnet", "Fine"):
        with pytest.raises(KeyError):
            alarm(shown)


def test_hints_name_what_the_screen_shows_and_what_to_do() -> None:
    assert hints([LOW_VOLTAGE]) == (
        'Its screen may say why. "Low Voltage Error!": its supply is too low: it needs 12 to 24 V (10.1).'
    )
