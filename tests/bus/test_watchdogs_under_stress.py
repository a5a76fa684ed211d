"""Guarded drives on slow lines, dead ones beside live ones, drives that become slow: nobody trips for another.

A share of what `python -m rs485bus.sim.stress` runs in full.
"""

from __future__ import annotations

from collections import Counter

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.watchdog.feeding import ArmedWatchdog, Feeding
from rs485bus.bus.watchdog.strain import Strain
from rs485bus.errors import WatchdogInfeasible
from rs485bus.sim.campaigns.failing import die, slow_down
from rs485bus.sim.campaigns.guarded import Plant, arm
from rs485bus.sim.campaigns.tight import stress
from rs485bus.sim.device import SimUnit
from rs485bus.wire.frames import read_holding, write_single
from tests.bus.support import BANK

# Admission


@pytest.mark.parametrize(
    ("count", "turnaround", "timeout"), [(28, 0.02, 0.6), (16, 0.06, 0.6), (5, 0.09, 0.6), (31, 0.016, 1.0)]
)
def test_drives_too_slow_to_be_fed_in_time_are_refused_in_bounded_time_with_what_was_measured(
    count: int, turnaround: float, timeout: float
) -> None:
    rig, drives = Plant(count, 115200, (turnaround,)).build()
    begun = rig.now
    ended = arm(rig, drives, timeout)
    assert isinstance(ended.infeasible, WatchdogInfeasible)
    assert ended.infeasible.numbers["feeds"] == pytest.approx(count * (turnaround + 0.003), rel=0.1)
    assert rig.now - begun < 6.0
    assert rig.owner.feeding.all() == []
    assert rig.owner.feeding.slack == float("inf")
    rig.run(10.0)
    assert not any(drive.told for drive in drives)


def test_one_slow_answer_while_a_block_is_entered_refuses_nothing() -> None:
    rig, drives = Plant(2, 115200, (0.002,)).build()
    receive, slow = drives[0].sim.receive, [0.09]

    def once_slow(frame: bytes, now: float) -> bytes | None:
        reply = receive(frame, now)
        if slow and frame[0] == 1:
            drives[0].sim.turnaround = slow.pop()
        return reply

    drives[0].sim.receive = once_slow  # type: ignore[method-assign]
    ended = arm(rig, drives, 0.5)
    assert (ended.failed, ended.infeasible) == ([], None)
    assert len(rig.owner.feeding.all()) == 2


@pytest.mark.parametrize("count", [1, 2, 10])
def test_with_one_drive_too_two_failed_attempts_are_reckoned_with(count: int) -> None:
    plant = Plant(count, 115200, (0.002,))
    rig, drives = plant.build()
    assert arm(rig, drives, plant.tightest()).infeasible is None
    reckoning = rig.owner.feeding.reckoning
    assert reckoning is not None
    attempts = [watch.attempt for watch in rig.owner.feeding.all()]
    assert reckoning.failed == pytest.approx(2 * max(attempts))
    assert reckoning.failed + reckoning.feeds + reckoning.longest == pytest.approx(reckoning.available, abs=0.001)


def test_feeds_take_no_more_than_60_percent_of_the_wire() -> None:
    plant = Plant(31, 115200, (0.005,))
    rig, drives = plant.build()
    timeout = plant.tightest()
    assert arm(rig, drives, timeout).infeasible is None
    rig.run(10.0)
    stats = rig.owner.journal.stats
    begun, fed = rig.now, stats.transactions
    rig.run(20 * timeout)
    taken = (stats.transactions - fed) * (0.005 + 0.003) / (rig.now - begun)
    assert 0.5 < taken < 0.62


def test_a_longer_reply_timeout_is_refused_where_the_watchdogs_could_not_be_fed_then() -> None:
    plant = Plant(2, 115200, (0.002,))
    rig, drives = plant.build()
    assert arm(rig, drives, plant.tightest()).infeasible is None
    unit = rig.owner.units[1]
    with pytest.raises(WatchdogInfeasible):
        rig.owner.gate.check_wait(unit, unit.reply_timeout + 0.02, 0.0)
    rig.owner.gate.check_wait(unit, unit.reply_timeout / 2, 0.0)


# The tightest sets


@pytest.mark.parametrize(
    ("count", "baudrate", "turnarounds"),
    [
        (1, 9600, (0.001,)),
        (1, 115200, (0.09,)),
        (2, 38400, (0.005,)),
        (4, 115200, (0.001, 0.005, 0.02, 0.09)),
        (10, 9600, (0.02,)),
        (10, 115200, (0.001,)),
        (31, 115200, (0.001, 0.005, 0.02, 0.09)),
    ],
)
def test_the_tightest_set_stands_two_lost_replies_at_the_worst_moments_and_one_step_tighter_is_refused(
    count: int, baudrate: int, turnarounds: tuple[float, ...]
) -> None:
    verdict = stress(Plant(count, baudrate, turnarounds), 60.0)
    assert verdict.faults == []
    assert verdict.attacks > 3


def test_after_the_second_failure_a_feed_is_repeated_in_time_however_tight_that_is() -> None:
    feeding = Feeding()
    feeding.arm(ArmedWatchdog(1, 0.33, 0.005, heard_at=0.0, armed_at=0.0, attempt=0.1))
    feeding.failed(1, 0.21, cost=0.1)
    feeding.failed(1, 0.31, cost=0.1)
    assert feeding.due(0.31) is not None


# Dead drives


@pytest.mark.parametrize(("count", "dead"), [(6, 4), (12, 4), (12, 11), (31, 1), (31, 15), (31, 30), (31, 31)])
def test_dead_drives_trip_no_live_one_and_are_told_in_their_time(count: int, dead: int) -> None:
    verdict = die(Plant(count, 115200, (0.002,)), dead, 1.0)
    assert verdict.faults == []
    assert max(verdict.told) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("count", "dead"), [(2, 1), (4, 3), (10, 5), (31, 20)])
def test_dead_drives_trip_no_live_one_of_the_tightest_set_either(count: int, dead: int) -> None:
    plant = Plant(count, 115200, (0.002,))
    assert die(plant, dead, plant.tightest()).faults == []


@pytest.mark.parametrize(("count", "dead"), [(2, 1), (6, 3), (31, 16), (31, 30)])
@pytest.mark.parametrize("tight", [False, True])
def test_stop_at_20_hz_on_dead_drives_trips_no_live_one(count: int, dead: int, tight: bool) -> None:
    plant = Plant(count, 115200, (0.002,))
    assert die(plant, dead, plant.tightest() if tight else 1.0, pressed=0.05).faults == []


def test_stops_to_a_drive_that_does_not_answer_take_a_fifth_of_the_wire_while_others_are_guarded() -> None:
    rig, (guarded, dead) = Plant(2, 115200, (0.002,)).build()
    rig.pair.devices.append(SimUnit(99, BANK))
    assert arm(rig, [guarded], 1.0).infeasible is None
    dead.adapter.motion.commanded(rig.now)
    dead.dead = True
    spent: Counter[int] = Counter()

    def ask() -> None:
        rig.owner.submit(Job(read_holding(99, 0, 1), on_end=lambda _: rig.at(rig.now, ask)), rig.now)

    def press() -> None:
        rig.owner.now = rig.now
        rig.owner.stops.halt(rig.owner.units[2], dead.adapter.motion, emergency=True)
        rig.at(rig.now + 0.05, press)

    ask()
    press()
    rig.run(1.0)
    begun, forget = (
        rig.now,
        rig.owner.journal.subscribe(lambda record: spent.update({record.address: round(1e6 * record.latency)})),
    )
    rig.run(20.0)
    forget()
    assert 0.1 < spent[2] / 1e6 / (rig.now - begun) < 0.21
    assert spent[99] > 2 * spent[2]
    assert not guarded.told
    # What waits does not grow with every press.
    assert rig.owner.queue.size < 5


def test_a_drive_that_answers_is_stopped_at_once_beside_a_dead_one_that_is_stopped_all_the_time() -> None:
    rig, drives = Plant(3, 115200, (0.002,)).build()
    assert arm(rig, drives, 1.0).infeasible is None
    dead, live = drives[0], drives[2]
    dead.adapter.motion.commanded(rig.now)
    dead.dead = True

    def press() -> None:
        rig.owner.now = rig.now
        rig.owner.stops.halt(rig.owner.units[1], dead.adapter.motion, emergency=True)
        rig.at(rig.now + 0.05, press)

    press()
    rig.run(0.7)
    for _ in range(20):
        rig.run(0.137)
        rig.owner.now = begun = rig.now
        live.adapter.motion.commanded(rig.now)
        halted: list[object] = []
        rig.owner.stops.halt(rig.owner.units[3], live.adapter.motion, emergency=True).listen(halted.append)
        rig.run(1.0, lambda: bool(halted))  # noqa: B023 - called at once
        stops = [record for record in rig.owner.journal.flight if record.address == 3 and record.sent_at >= begun]
        stop = next(record for record in stops if record.urgency is Urgency.STOP)
        assert stop.sent_at - begun < 0.025


# Slow drives


@pytest.mark.parametrize(
    ("count", "slow", "timeout", "stopped"),
    [(1, 1, 0.5, 0), (2, 1, 0.6, 0), (6, 1, 0.6, 0), (12, 12, 1.0, 0), (31, 31, 1.0, 0), (31, 31, 0.8, 5)],
)
def test_drives_that_become_ten_times_as_slow_are_told_and_nobody_trips_that_can_be_fed(
    count: int, slow: int, timeout: float, stopped: int
) -> None:
    verdict = slow_down(Plant(count, 115200, (0.005 if count == 12 else 0.002,)), slow, timeout)
    assert verdict.faults == []
    assert len(verdict.stopped) <= stopped
    assert verdict.done > 30


def test_where_not_all_can_be_fed_the_slowest_is_given_up_told_and_the_others_go_on() -> None:
    plant = Plant(6, 115200, (0.009,))
    verdict = slow_down(plant, 6, plant.tightest())
    assert verdict.faults == []
    assert verdict.warned == 1
    assert 1 <= len(verdict.stopped) <= 2
    assert verdict.waited < plant.tightest() + 1.0


def test_one_slow_answer_is_no_slow_drive() -> None:
    feeding = Feeding()
    watch = ArmedWatchdog(1, 1.0, 0.005, heard_at=0.0, armed_at=0.0)
    feeding.arm(watch)
    feeding.fed(1, 0.09)
    assert watch.takes == pytest.approx(0.005)
    feeding.fed(1, 0.09)
    assert watch.takes == pytest.approx(0.09)


def test_where_several_devices_in_a_row_are_slow_the_others_are_suspected() -> None:
    feeding = Feeding()
    watches = [ArmedWatchdog(address, 1.0, 0.005, heard_at=0.0, armed_at=0.0) for address in range(6)]
    for watch in watches:
        feeding.arm(watch)
    for address in range(3):
        assert watches[5].takes == 0.005
        feeding.fed(address, 0.05)
    assert [watch.takes for watch in watches] == [pytest.approx(0.05)] * 6
    feeding.fed(5, 0.005)
    assert watches[5].takes == pytest.approx(0.005)


# What else goes


def test_what_a_tight_set_was_admitted_with_is_never_refused_though_drives_become_slower() -> None:
    plant = Plant(2, 115200, (0.002,))
    rig, drives = plant.build()
    rig.pair.devices.append(SimUnit(99, BANK))
    assert arm(rig, drives, plant.tightest()).infeasible is None
    for drive in drives:
        drive.turnaround = 0.03
    rig.run(5.0)
    assert rig.owner.feeding.strain.holds
    asked = rig.submit(read_holding(99, 0, 8))
    rig.done(asked)
    assert asked.outcome is Outcome.REPLY


def test_room_is_reckoned_anew_when_a_device_is_released() -> None:
    rig, drives = Plant(2, 115200, (0.002,)).build()
    rig.pair.devices.append(SimUnit(99, BANK))
    assert arm(rig, drives[:1], 10.0).infeasible is None
    slow = Job(read_holding(99, 0, 1), reply_timeout=2.0)
    assert arm(rig, drives[1:], 1.0).infeasible is None
    rig.owner.submit(slow, rig.now)
    assert slow.reason is Reason.TOO_LONG
    rig.owner.feeding.disarm(2)
    again = rig.submit(read_holding(99, 0, 1), reply_timeout=2.0)
    rig.done(again)
    assert again.outcome is Outcome.REPLY


def test_a_broadcast_longer_than_was_admitted_is_refused() -> None:
    plant = Plant(1, 9600, (0.001,))
    rig, drives = plant.build()
    assert arm(rig, drives, plant.tightest()).infeasible is None
    assert rig.submit(write_single(0, 0x4000, 1)).outcome is None
    from rs485bus.wire.frames import write_multiple

    long = rig.submit(write_multiple(0, 0x4000, [0] * 120))
    assert (long.outcome, long.reason) == (Outcome.NOT_SENT, Reason.TOO_LONG)


def test_a_stop_cuts_no_feed_short_that_somebody_would_trip_for() -> None:
    plant = Plant(2, 115200, (0.09,), BusConfig(echo=False, reply_timeout=0.12))
    rig, drives = plant.build()
    assert arm(rig, drives, plant.tightest()).infeasible is None

    def press() -> None:
        rig.owner.now = rig.now
        rig.owner.stops.halt(rig.owner.units[1], drives[0].adapter.motion, emergency=True)
        rig.at(rig.now + 0.05, press)

    press()
    rig.run(20.0)
    assert not any(drive.told for drive in drives)


def test_two_feeds_in_vain_are_reckoned_with_and_give_nobody_else_a_turn_yet() -> None:
    strain = Strain()
    for _ in range(2):
        strain.sent(feeds=True)
        strain.failed()
    assert not strain.yields  # the next one must go at once
    for _ in range(2):
        strain.sent(feeds=True)
        strain.failed()
    assert strain.yields
