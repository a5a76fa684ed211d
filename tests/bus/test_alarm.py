"""The precise alarm: what it costs an event loop to wait."""

import sys
import time
from collections.abc import Callable
from typing import Any

import pytest

from rs485bus.transport.alarm import TimerfdAlarm

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="timerfd is Linux'")


class Loop:
    """What an alarm needs of an event loop."""

    def __init__(self) -> None:
        self.timers: list[Timer] = []
        self.fire: Callable[[], None] = lambda: None

    def time(self) -> float:
        return time.monotonic()

    def add_reader(self, fd: int, callback: Callable[[], None]) -> None:
        self.fire = callback

    def remove_reader(self, fd: int) -> None:
        pass

    def call_at(self, when: float, callback: Callable[[], None]) -> Any:
        timer = Timer(callback)
        self.timers.append(timer)
        return timer


class Timer:
    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback = callback
        self.cancelled = False

    def cancel(self) -> None:
        self.cancelled = True


@pytest.fixture
def loop() -> Loop:
    return Loop()


@pytest.fixture
def alarm(loop: Loop) -> Any:
    alarm = TimerfdAlarm(loop, lambda: None)  # type: ignore[arg-type]
    yield alarm
    alarm.close()


def test_what_is_likely_to_come_wakes_the_loop_once_however_far_it_is(loop: Loop, alarm: TimerfdAlarm) -> None:
    alarm.set(loop.time() + 10)
    assert loop.timers == []


def test_what_is_not_is_left_to_the_loop_until_it_is_near(loop: Loop, alarm: TimerfdAlarm) -> None:
    alarm.set(loop.time() + 10, likely=False)
    assert len(loop.timers) == 1


def test_a_far_time_that_was_put_off_wakes_nobody(loop: Loop, alarm: TimerfdAlarm) -> None:
    alarm.set(loop.time() + 0.1, likely=False)
    alarm.set(loop.time() + 10)
    assert [timer.cancelled for timer in loop.timers] == [True]


def test_it_comes_back_to_a_far_time_after_a_near_one(loop: Loop, alarm: TimerfdAlarm) -> None:
    alarm.set(loop.time() + 0.001)
    alarm.set(loop.time() + 10, likely=False)
    time.sleep(0.002)
    loop.fire()
    assert len(loop.timers) == 1


@pytest.mark.parametrize("far", [1e12, 1e30, float(sys.maxsize)])
def test_a_time_that_nobody_lives_to_see_can_be_set(loop: Loop, alarm: TimerfdAlarm, far: float) -> None:
    alarm.set(loop.time() + far)
    alarm.set(loop.time() + 0.001)
    assert alarm._armed_at < loop.time() + 1.0
