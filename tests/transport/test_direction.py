"""What the kernel is told of the direction of a transceiver."""

import array
import sys

import pytest
from serial.rs485 import RS485Settings

from rs485bus.transport.direction import switch_direction

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux switches the direction")

ENABLED, ON_SEND, AFTER_SEND = 1, 2, 4


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (RS485Settings(), [ENABLED | ON_SEND, 0, 0]),
        (
            RS485Settings(rts_level_for_tx=False, rts_level_for_rx=True, delay_before_tx=0.004, delay_before_rx=0.0016),
            [ENABLED | AFTER_SEND, 4, 2],
        ),
        (RS485Settings(loopback=True), [ENABLED | ON_SEND | 16, 0, 0]),
    ],
)
def test_polarity_and_delays_are_told_in_the_words_of_the_kernel(
    settings: RS485Settings, words: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[list[int]] = []

    def ioctl(fd: int, request: int, config: "array.array[int]") -> None:
        if request == 0x542E:
            config[0] = 0xFF  # what was set before
        else:
            told.append(list(config))

    monkeypatch.setattr("fcntl.ioctl", ioctl)
    switch_direction(7, settings)
    assert [told[0][0] & 0x17, *told[0][1:3]] == words
