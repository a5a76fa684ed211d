"""How long a feed may go unanswered is remembered from feed to feed, and is the same as if it were reckoned anew."""

import random

import pytest

from rs485bus.bus.watchdog import feeding as module
from rs485bus.bus.watchdog.feeding import ArmedWatchdog, Feeding

ATTEMPT = 0.2


def armed(feeding: Feeding, address: int, timeout: float, heard_at: float) -> None:
    watch = ArmedWatchdog(address, timeout, 0.005, heard_at, heard_at, overhead=0.003, attempt=ATTEMPT)
    feeding.arm(watch)


def reckoned(feeding: Feeding, watch: ArmedWatchdog, now: float) -> float:
    """The room of a feed, reckoned from nothing but the others: they are fed after it, and none of them answers."""
    room, before = float("inf"), 0.0
    for other in sorted(feeding.all(), key=lambda other: other.over):
        if other is not watch:
            before += other.least_wait
            room = min(room, other.over - before)
    return min(max(room - now, watch.least_wait), watch.attempt)


@pytest.mark.parametrize("seed", range(12))
def test_a_feed_may_take_what_the_others_leave_whatever_was_heard_armed_or_slow_since(seed: int) -> None:
    rng, feeding, now = random.Random(seed), Feeding(), 0.0
    for address in range(1, rng.randint(3, 16)):
        armed(feeding, address, rng.choice((0.6, 1.0, 2.0)), now)
    less = 0
    for _ in range(300):
        now += rng.choice((0.001, 0.01, 0.05))
        watches = feeding.all()
        watch = min(watches, key=lambda watch: watch.due) if rng.random() < 0.7 else rng.choice(watches)
        given, needed = feeding.wait(watch, now), reckoned(feeding, watch, now)
        assert given == pytest.approx(needed)
        less += given < ATTEMPT
        feeding.heard(watch.address, now)
        feeding.fed(watch.address, rng.choice((0.001, 0.002, 0.0025, 0.02, 0.04)))
        if rng.random() < 0.1:
            armed(feeding, rng.randint(17, 22), rng.choice((0.2, 0.3, 1.0)), now)
        elif rng.random() < 0.1 and len(watches) > 2:
            feeding.disarm(rng.choice(watches).address)
        elif rng.random() < 0.05:
            feeding.set_timeout(watch, rng.choice((0.3, 1.0)))
    assert less


def test_while_all_is_well_the_room_is_reckoned_once_for_many_feeds(monkeypatch: pytest.MonkeyPatch) -> None:
    feeding, now, reckonings = Feeding(), 0.0, 0
    for address in range(1, 17):
        armed(feeding, address, 2.0, now)
    real = module.latest_start

    def counted(*arguments: object) -> float:
        nonlocal reckonings
        reckonings += 1
        return real(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "latest_start", counted)
    feeds = 0
    while now < 20:
        now += 0.006
        watch = feeding.due(now) or feeding.soon(now)
        if watch is not None:
            assert feeding.wait(watch, now) == ATTEMPT
            feeding.heard(watch.address, now)
            feeding.fed(watch.address, 0.0021 if feeds % 2 else 0.0023)
            feeds += 1
    assert feeds > 450
    assert reckonings < feeds / 4


def test_feeds_that_take_a_little_longer_each_leave_less_room_at_once() -> None:
    feeding = Feeding()
    for address in range(1, 21):
        feeding.arm(ArmedWatchdog(address, 1.0, 0.01, 0.0, 0.0, overhead=0.003, attempt=ATTEMPT))
    watch = feeding.all()[-1]
    assert feeding.wait(watch, 0.43) == ATTEMPT
    for _ in range(12):
        for address in range(1, 21):
            feeding.fed(address, 0.009)  # a fifth longer: too little to add all feeds up anew
    room = feeding.wait(watch, 0.51)
    assert room == pytest.approx(reckoned(feeding, watch, 0.51))
    assert room < ATTEMPT


def test_what_a_third_slow_feed_in_a_row_shows_of_the_two_before_it_is_reckoned_with() -> None:
    feeding = Feeding()
    for address in (1, 2, 3):
        feeding.arm(ArmedWatchdog(address, 2.0, 0.0005, 0.0, 0.0, attempt=ATTEMPT))
    for address, took in ((1, 0.1), (2, 0.1), (3, 0.0011)):
        feeding.fed(address, took)
    assert feeding.reckoning is not None
    assert feeding.reckoning.feeds == pytest.approx(0.2011)
