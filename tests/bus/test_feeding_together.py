"""An idle bus is woken up for nothing but its feeds, and feeds whom it would feed otherwise."""

import copy
import random

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.bus.watchdog.feeding import ArmedWatchdog, Feeding
from rs485bus.wire.frames import crc, read_holding
from rs485bus.wire.timing import LineSettings


def armed(feeding: Feeding, address: int, timeout: float, now: float) -> None:
    feeding.arm(ArmedWatchdog(address, timeout, 0.005, now, now, overhead=0.003, attempt=0.1))


def in_turn(feeding: Feeding, now: float) -> ArmedWatchdog | None:
    """Who is fed if that is always asked."""
    return feeding.due(now) or feeding.soon(now)


@pytest.mark.parametrize("seed", range(12))
def test_whoever_is_fed_without_asking_is_who_would_be_fed_anyway(seed: int) -> None:
    rng, feeding, now, unasked = random.Random(seed), Feeding(), 0.0, 0
    for address in range(1, rng.randint(3, 16)):
        armed(feeding, address, rng.choice((1.0, 1.0, 1.2, 2.0)), now)
    for _ in range(400):
        now += rng.choice((0.004, 0.006, 0.006, 0.3 if rng.random() < 0.1 else 0.005))
        anyway, first = in_turn(copy.deepcopy(feeding), now), feeding.first(now)
        unasked += first is not None
        assert first is None or (anyway is not None and anyway.due == first.due)
        if (watch := first or in_turn(feeding, now)) is None:
            continue
        address, chance = watch.address, rng.random()
        if chance < 0.93:
            feeding.heard(address, now)
            feeding.fed(address, rng.choice((0.001, 0.002, 0.0025, 0.004)))
        else:
            feeding.failed(address, now, 0.05)
        chance = rng.random()
        if chance < 0.02:
            armed(feeding, rng.randint(17, 22), rng.choice((0.1, 0.3, 1.0)), now)
        elif chance < 0.04:
            feeding.set_timeout(rng.choice(feeding.all()), rng.choice((0.2, 1.0)))
        elif chance < 0.06:
            feeding.mute(rng.choice(feeding.all()).address)
        elif chance < 0.08:
            for each in feeding.all():
                feeding.unmute(each.address)
        elif chance < 0.09 and len(feeding.all()) > 2:
            feeding.disarm(rng.choice(feeding.all()).address)
    assert unasked


def test_a_feed_that_was_not_answered_goes_again_before_those_that_were_gathered_with_it() -> None:
    feeding, now = Feeding(), 0.3334
    for address in (1, 2):
        armed(feeding, address, 1.0, 0.0)
    first = feeding.due(now)
    assert first is not None
    feeding.failed(first.address, now, 0.05)
    assert feeding.first(now) is None
    assert feeding.due(now) is first


def test_on_an_idle_bus_nobody_is_woken_to_see_that_all_were_heard() -> None:
    feeding = Feeding()
    for address in (1, 2):
        armed(feeding, address, 1.0, 0.0)
    assert not feeding.overdue(0.0)
    for address in (1, 2):
        feeding.heard(address, 0.3)
    assert feeding.due(0.31) is None
    assert feeding.over_at == pytest.approx(1.3)


def test_whoever_is_overdue_is_told_so_though_it_was_asked_before_who_is_due() -> None:
    feeding = Feeding()
    armed(feeding, 1, 1.0, 0.0)
    feeding.mute(1)
    assert feeding.due(1.5) is None
    assert [watch.address for watch in feeding.overdue(1.5)] == [1]


def test_after_an_answer_nobody_is_woken_for_the_end_of_the_time_that_the_request_had() -> None:
    owner = Owner(LineSettings(baudrate=115200), BusConfig(echo=False), 0.0)
    job, other = Job(read_holding(1, 0, 1)), Job(read_holding(2, 0, 1))
    owner.submit(job, 1.0)
    assert owner.tick(1.0) == job.request.adu
    owner.feed(bytes.fromhex("01 03 02 00 01") + crc(bytes.fromhex("01 03 02 00 01")), 1.01)
    assert job.outcome is Outcome.REPLY
    assert owner.wake == float("inf")
    owner.submit(other, 1.01)
    assert owner.wake == owner.pair.quiet_at
