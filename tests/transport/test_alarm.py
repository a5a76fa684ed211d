"""Which alarm a loop gets."""

from __future__ import annotations

import time

from rs485bus.sim import VirtualClockLoop
from rs485bus.transport.alarm import LoopAlarm, make_alarm


def test_a_virtual_clock_that_shows_what_the_real_one_shows_is_none() -> None:
    loop = VirtualClockLoop()
    loop.block(time.monotonic() - loop.time())
    try:
        assert isinstance(make_alarm(loop, lambda: None), LoopAlarm)
    finally:
        loop.close()
