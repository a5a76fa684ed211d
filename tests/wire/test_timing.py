"""How long bytes take."""

import pytest

from rs485bus.wire.timing import LineSettings


@pytest.mark.parametrize(
    ("baudrate", "parity", "stopbits", "bits"),
    [(9600, "N", 1, 10), (9600, "E", 1, 11), (9600, "O", 2, 12), (115200, "N", 2, 11)],
)
def test_a_character_is_its_start_data_parity_and_stop_bits(
    baudrate: int, parity: str, stopbits: int, bits: int
) -> None:
    line = LineSettings(baudrate=baudrate, parity=parity, stopbits=stopbits)  # type: ignore[arg-type] # from the table
    assert line.character == bits / baudrate
    assert line.airtime(8) == 8 * bits / baudrate


def test_up_to_19200_baud_the_silences_count_characters_of_11_bits() -> None:
    line = LineSettings(baudrate=19200)
    assert line.t35 == pytest.approx(3.5 * 11 / 19200)
    assert line.t15 == pytest.approx(1.5 * 11 / 19200)


def test_above_they_are_fixed() -> None:
    line = LineSettings(baudrate=38400)
    assert (line.t15, line.t35) == (0.00075, 0.00175)


def test_a_reply_budget_is_the_airtime_of_both_and_what_the_device_takes() -> None:
    assert LineSettings(baudrate=9600).budget(8, 0.05, 11) == pytest.approx(19 * 10 / 9600 + 0.05)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"baudrate": 299}, "299 is outside 300"),
        ({"baudrate": 9600, "parity": "X"}, "'X' is none of"),
        ({"baudrate": 9600, "stopbits": 3}, "3 is neither 1 nor 2"),
    ],
)
def test_a_setting_out_of_range_is_named(settings: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        LineSettings(**settings)  # type: ignore[arg-type] # the point of the test
