"""Watchdogs are fed when they must be, by whatever traffic there is, and no longer than they should be."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.stopping.halt import Halted
from rs485bus.bus.watchdog.feeding import SHARE, ArmedWatchdog, Feeding, admit
from rs485bus.bus.watchdog.guarding import Lease, admit_watchdogs, arm, check_watchdog, release
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read, write, write_block
from rs485bus.errors import LimitExceeded, WatchdogInfeasible
from rs485bus.sim import Noise, SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.sim.treatment import Treatment
from rs485bus.wire.frames import read_holding, write_single
from rs485bus.wire.timing import LineSettings
from tests.bus.support import BANK, Deaf, Drive, drives
from tests.bus.test_emergency import guard
from tests.bus.test_stops import running

QUICK = BusConfig(echo=False, reply_timeout=0.01)


def watch(address: int, timeout: float = 1.0, heard_at: float = 0.0, cost: float = 0.005) -> ArmedWatchdog:
    return ArmedWatchdog(address, timeout, cost, heard_at, armed_at=0.0)


def feeds(rig: Rig, address: int) -> list[float]:
    return [record.sent_at for record in rig.owner.journal.flight if record.address == address]


# The table


def test_a_device_is_due_after_a_third_of_its_time() -> None:
    feeding = Feeding()
    feeding.arm(watch(1))
    assert feeding.due(0.333) is None
    due = feeding.due(0.3334)
    assert due is not None
    assert due.address == 1


def test_hearing_it_puts_that_off_from_the_sending_of_what_it_acknowledged() -> None:
    feeding = Feeding()
    feeding.arm(watch(1))
    feeding.heard(1, 0.2)
    assert feeding.due(0.53) is None
    assert feeding.due(0.54) is not None


def test_of_several_that_are_due_the_earliest_goes_first() -> None:
    feeding = Feeding()
    for address, heard in ((1, 0.2), (2, 0.1), (3, 0.3)):
        feeding.arm(watch(address, heard_at=heard))
    order = []
    for _ in range(3):
        due = feeding.due(1.0)
        assert due is not None
        order.append(due.address)
        feeding.heard(due.address, 1.0)
    assert order == [2, 1, 3]


def test_one_that_answers_too_late_is_fed_by_that_and_goes_behind_those_that_answer_in_time() -> None:
    """Each of its feeds takes the wire for as long as one that a dead device leaves unanswered."""
    feeding = Feeding()
    feeding.arm(watch(1))
    feeding.arm(watch(2, heard_at=0.6))
    for at in (0.34, 0.46, 0.58):
        feeding.failed(1, at + 0.1, 0.1)
        feeding.heard(1, at, late=True)
    due = feeding.due(0.95)
    assert due is not None
    assert due.address == 2  # though the other one is due as well
    feeding.heard(2, 0.95)
    assert not feeding.overdue(1.5)
    assert feeding.overdue(1.6)
    for address, heard in ((1, 1.6), (2, 1.7)):
        feeding.heard(address, heard)
    due = feeding.due(2.2)
    assert due is not None
    assert due.address == 1  # it answers in time again


def test_many_that_are_due_at_once_are_begun_with_early_enough() -> None:
    feeding = Feeding()
    for address in range(1, 17):
        feeding.arm(watch(address, cost=0.01))
    begin = SHARE - 15 * 0.01
    assert feeding.due(begin - 0.001) is None
    assert feeding.due(begin + 0.001) is not None


def test_what_a_feed_really_takes_decides_how_early_that_is() -> None:
    feeding = Feeding()
    for address in range(1, 17):
        feeding.arm(watch(address, cost=0.01))
        for _ in range(30):
            feeding.fed(address, 0.004)
    begin = SHARE - 15 * 0.004
    assert feeding.due(begin - 0.001) is None
    assert feeding.due(begin + 0.001) is not None


def test_those_that_are_due_soon_are_fed_together_with_one_that_is_due() -> None:
    feeding = Feeding()
    for address, heard in ((1, 0.0), (2, 0.05), (3, 0.2)):
        feeding.arm(watch(address, heard_at=heard))
    assert feeding.soon(SHARE) is None
    fed = []
    while (due := feeding.due(SHARE) or feeding.soon(SHARE)) is not None:
        fed.append(due.address)
        feeding.heard(due.address, SHARE)
    assert fed == [1, 2]


def test_a_failed_feed_is_repeated_once_at_once_and_then_leaves_the_others_room() -> None:
    feeding = Feeding()
    feeding.arm(watch(1))
    feeding.failed(1, 0.4, cost=0.1)
    assert feeding.due(0.4) is not None
    feeding.failed(1, 0.5, cost=0.1)
    assert feeding.due(0.55) is None
    assert feeding.due(0.6) is not None


def test_one_that_is_not_answered_does_not_hold_up_the_others() -> None:
    feeding = Feeding()
    feeding.arm(watch(1))
    feeding.arm(watch(2, heard_at=0.1))
    feeding.failed(1, 0.4, cost=0.1)
    feeding.failed(1, 0.5, cost=0.1)
    due = feeding.due(0.55)
    assert due is not None
    assert due.address == 2


def test_a_muted_device_is_not_fed() -> None:
    feeding = Feeding()
    feeding.arm(watch(1))
    feeding.mute(1)
    feeding.heard(1, 0.1)
    assert feeding.due(0.9) is None
    feeding.unmute(1)
    assert feeding.due(0.9) is not None


def test_time_that_is_over_is_told_once_it_is() -> None:
    feeding = Feeding()
    feeding.arm(watch(1))
    feeding.heard(1, 0.5)
    assert feeding.overdue(1.2) == []
    assert [late.address for late in feeding.overdue(1.5)] == [1]


@given(
    st.lists(st.tuples(st.floats(0.05, 5.0), st.floats(0.0, 1.0)), min_size=1, max_size=20),
    st.floats(0.001, 0.002),
)
def test_served_one_by_one_none_is_fed_later_than_a_third_plus_one_transaction(
    watches: list[tuple[float, float]], cost: float
) -> None:
    """Any set that the pair can carry, each asked for in turn on a busy wire: cost is one transaction."""
    if sum(cost / (SHARE * timeout) for timeout, _ in watches) > 0.8:
        return
    feeding = Feeding()
    for address, (timeout, heard) in enumerate(watches):
        feeding.arm(watch(address, timeout, heard_at=1.0 + heard * SHARE * timeout / 20, cost=cost))
    now = 1.0
    while now < 4.0:
        due = feeding.due(now)
        if due is not None:
            assert now <= due.due + 2 * cost
            feeding.heard(due.address, now)
        now += cost  # a feed, or somebody else's transaction


# Admission


def test_what_cannot_be_fed_in_time_is_refused_with_the_numbers() -> None:
    with pytest.raises(WatchdogInfeasible, match="cannot be fed in time") as refused:
        admit([watch(address, timeout=0.1, cost=0.01) for address in range(31)], [0.02, 0.03, 0.01], 0.1)
    assert refused.value.numbers["feeds"] == pytest.approx(0.31)
    assert refused.value.numbers["failed"] == pytest.approx(0.05)
    assert refused.value.numbers["available"] == pytest.approx(0.1 * 2 / 3)


def test_one_watchdog_that_cannot_be_fed_is_one() -> None:
    with pytest.raises(WatchdogInfeasible, match=r"^1 watchdog cannot be fed in time: one feed each takes 10 ms"):
        admit([watch(1, timeout=0.1, cost=0.01)], [0.02], 0.1)


def test_31_devices_of_100_ms_at_9600_baud_are_refused_before_anything_is_armed() -> None:
    rig = Rig(line=LineSettings(baudrate=9600), config=QUICK)
    made = drives(rig, 31)
    with pytest.raises(WatchdogInfeasible):
        admit_watchdogs(rig.owner, [drive.attached for drive in made], 0.1)
    rig.run(1.0)
    assert rig.sent == []


def test_31_devices_of_a_second_at_115200_baud_are_admitted() -> None:
    rig = Rig(config=QUICK)
    admit_watchdogs(rig.owner, [drive.attached for drive in drives(rig, 31)], 1.0)
    assert rig.owner.feeding.slack > 0.1


@pytest.mark.parametrize("timeout", [0.0, -1.0, 4_294_967.296])
def test_a_time_that_the_register_cannot_hold_is_refused(timeout: float) -> None:
    with pytest.raises(LimitExceeded, match=r"outside 0\.001\.\.4294967\.2\d* s"):
        check_watchdog(Drive().attached, timeout)


def test_while_armed_nothing_goes_out_that_could_keep_the_wire_too_long() -> None:
    rig = Rig(SimUnit(9, BANK), config=QUICK)
    (drive,) = drives(rig, 1)
    admit_watchdogs(rig.owner, [drive.attached], 0.5)
    guard(rig, drive)
    slow = rig.submit(read_holding(9, 0, 1), reply_timeout=2.5)
    assert (slow.outcome, slow.reason) == (Outcome.NOT_SENT, Reason.TOO_LONG)
    away = rig.submit(write_block(1, r.SINGLE_TURN, 0, 2, 2, 0))
    assert (away.outcome, away.reason) == (Outcome.NOT_SENT, Reason.DISRUPTIVE)
    assert rig.submit(read_holding(9, 0, 1)).outcome is None


# On the wire


def test_a_device_that_nobody_talks_to_is_fed_every_third_of_its_time() -> None:
    rig = Rig(config=QUICK)
    (drive,) = drives(rig, 1)
    guard(rig, drive, timeout=0.6)
    rig.run(10.0)
    gaps = [later - earlier for earlier, later in zip(feeds(rig, 1), feeds(rig, 1)[1:], strict=False)]
    assert gaps == [pytest.approx(0.2, abs=0.006)] * len(gaps)
    assert len(gaps) > 40
    assert drive.sim.trips == []


def test_on_an_idle_bus_one_waking_up_feeds_all() -> None:
    rig = Rig(config=QUICK)
    made = drives(rig, 16)
    guard(rig, *made, timeout=1.0)
    rig.run(5.0)
    begin, sent = rig.now, len(rig.sent)
    rig.run(10.0)
    times = [at for at, _ in rig.sent[sent:]]
    pauses = [later - earlier for earlier, later in itertools.pairwise(times) if later - earlier > 0.05]
    assert len(pauses) == pytest.approx(30, abs=1)
    assert len(times) <= 1.02 * 16 * 3 * (rig.now - begin)


def test_what_somebody_asks_for_goes_before_those_that_are_fed_early() -> None:
    rig = Rig(SimUnit(99, BANK), config=QUICK)
    guard(rig, *drives(rig, 16), timeout=1.0)
    rig.run(5.0)
    sent = len(rig.sent)
    rig.run(until=lambda: len(rig.sent) == sent + 3)
    asked = rig.submit(read_holding(99, 0, 1), urgency=Urgency.POLL)
    rig.done(asked)
    assert asked.sent_at - asked.queued_at < 0.01
    assert rig.owner.feeding.soon(rig.now) is not None


def test_a_device_that_is_polled_needs_no_feed() -> None:
    rig = Rig(config=QUICK)
    (drive,) = drives(rig, 1)
    guard(rig, drive)

    def poll() -> None:
        rig.submit(read(1, r.POSITION), urgency=Urgency.POLL)
        rig.at(rig.now + 0.1, poll)

    poll()
    rig.run(10.0)
    armed = rig.owner.feeding.get(1)
    assert armed is not None
    assert armed.feeds == 0
    assert armed.longest < 0.12


def test_broadcasts_frames_to_others_and_unanswered_frames_never_count() -> None:
    rig = Rig(SimUnit(2, BANK), Deaf(3), config=BusConfig(echo=False, reply_timeout=0.005, turnaround=0.01))
    (drive,) = drives(rig, 1)
    guard(rig, drive, timeout=0.6)
    start = len(feeds(rig, 1))

    def noise() -> None:
        rig.submit(write_single(0, 0x4000, 1), moves=False)
        rig.submit(read_holding(2, 0, 1))
        rig.submit(read_holding(3, 0, 1))
        rig.at(rig.now + 0.05, noise)

    noise()
    rig.run(4.0)
    assert len(feeds(rig, 1)) - start >= 4.0 / 0.21 - 3


def test_an_exception_does_not_count_as_fed() -> None:
    feeding_rig = Rig(SimUnit(1, BANK), config=QUICK)
    feeding_rig.owner.feeding.arm(watch(1, heard_at=100.0))
    feeding_rig.run(0.1)
    feeding_rig.done(feeding_rig.submit(read_holding(1, 900, 1)))
    armed = feeding_rig.owner.feeding.get(1)
    assert armed is not None
    assert armed.heard_at == 100.0


def test_a_late_reply_counts_from_when_it_was_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.01, retries=0))
    (drive,) = drives(rig, 1)
    guard(rig, drive, timeout=5.0)
    drive.sim.turnaround = 0.2
    answer = drive.sim.answer

    def late(pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        reply = answer(pdu, now, broadcast=broadcast)
        drive.sim.turnaround = 0.2
        return reply

    drive.sim.answer = late  # type: ignore[method-assign]
    job = rig.submit(read(1, r.POSITION))
    rig.done(job)
    asked = rig.sent[-1][0]
    heard, late_ones = Feeding.heard, []

    def listen(
        feeding: Feeding, address: int, since: float, at_most: float | None = None, *, late: bool = False
    ) -> None:
        late_ones.append(late)
        heard(feeding, address, since, at_most, late=late)

    monkeypatch.setattr(Feeding, "heard", listen)
    rig.run(0.3)
    assert late_ones[0] is True  # it feeds, and its drive goes behind those that answer in time
    armed = rig.owner.feeding.get(1)
    assert armed is not None
    assert armed.heard_at == asked


def test_sixteen_watched_devices_on_a_saturated_bus_stay_within_a_third_plus_one_transaction() -> None:
    rig = Rig(*(SimUnit(100 + at, BANK) for at in range(4)), config=QUICK, keep_frames=False)
    made = drives(rig, 16)
    guard(rig, *made, timeout=1.0)

    def saturate(job: Job) -> None:
        again = Job(job.request, urgency=job.urgency, on_end=saturate)
        rig.owner.submit(again, rig.now)

    for at in range(4):
        for urgency in (Urgency.COMMAND, Urgency.POLL):
            saturate(Job(read_holding(100 + at, 0, 20), urgency=urgency))
    rig.run(60.0)
    transaction = 0.0105
    assert max(armed.longest for armed in rig.owner.feeding.all()) <= 1 / 3 + transaction
    assert all(not drive.sim.trips for drive in made)


def test_feeding_goes_on_through_lost_replies() -> None:
    rig = Rig(config=QUICK, seed=5, noise=Noise(lost_reply=0.05))
    made = drives(rig, 8)
    guard(rig, *made, timeout=1.0)
    rig.run(300.0)
    assert len(rig.owner.feeding.all()) == 8
    assert all(not drive.interruptions for drive in made)


@pytest.mark.parametrize("noise", [Noise(lost_reply=0.1), Noise(lost_reply=0.05, lost_request=0.05)])
def test_behind_a_gateway_too_though_equal_answers_do_not_tell_whose_they_are(noise: Noise) -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.05), seed=5, noise=noise, gateway=True, keep_frames=False)
    made = drives(rig, 8)
    guard(rig, *made, timeout=1.0)
    rig.run(100.0)
    assert len(rig.owner.feeding.all()) == 8
    assert all(not (drive.interruptions or drive.sim.trips) for drive in made)


def test_behind_a_gateway_a_dead_device_is_told_in_its_time_whatever_it_owed() -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.05), noise=Noise(lost_reply=0.1), seed=5, gateway=True)
    made = drives(rig, 2)
    guard(rig, *made, timeout=1.0)
    rig.run(20.0)
    assert rig.owner.units[1].late
    rig.pair.script = lambda frame, now: Treatment(heard=frame[0] != 1)
    died_at = rig.now
    rig.run(5.0, lambda: bool(made[0].interruptions))
    assert 0.6 < rig.now - died_at <= 1.0
    rig.run(20.0)
    assert not made[1].interruptions


# Trips


def test_a_device_unheard_for_longer_than_its_time_is_stopped_and_moves_only_after_it_was_armed_again() -> None:
    rig = Rig(config=QUICK)
    (drive,) = running(rig, 1)
    guard(rig, drive)
    queued = drive.move(rig)
    rig.now += 3.0  # the event loop was blocked
    rig.step()
    rig.run(0.3)
    assert len(drive.sim.trips) == 1
    assert "unheard for 3" in drive.interruptions[0]
    assert queued.outcome is not Outcome.REPLY
    assert rig.owner.feeding.get(1) is None
    assert drive.move(rig).reason is Reason.LOCKED
    mark = len(rig.sent)
    rig.run(10.0)
    assert len(rig.sent) == mark  # nothing resumes by itself
    assert not drive.sim.moving(rig.now)


def test_a_dead_device_is_fed_until_its_time_is_over_and_then_left() -> None:
    rig = Rig(config=QUICK)
    (drive,) = drives(rig, 1)
    guard(rig, drive)
    drive.sim.receive = lambda frame, now: None  # type: ignore[method-assign]
    rig.run(0.4)
    assert len(feeds(rig, 1)) > 6
    rig.run(0.3)
    assert drive.interruptions
    mark = len(rig.sent)
    rig.run(5.0)
    assert len(rig.sent) == mark


# Release


def test_a_release_stops_confirms_and_turns_the_watchdog_off() -> None:
    rig = Rig(config=QUICK)
    made = running(rig, 3)
    guard(rig, *made)
    ended: list[list[Halted]] = []
    mark = len(rig.sent)
    rig.owner.start(release(rig.owner, [drive.attached for drive in made]), ended.append)
    rig.run(1.0)
    assert all(halted.standing for halted in ended[0])
    assert [drive.sim.watchdog_ms for drive in made] == [0, 0, 0]
    assert rig.owner.feeding.all() == []
    # All are stopped before the first is confirmed.
    frames = [frame for _, frame in rig.sent[mark:]]
    last_stop = max(at for at, frame in enumerate(frames[:8]) if frame[1] == 6)
    first_look = min(at for at, frame in enumerate(frames) if frame[1] == 4)
    assert last_stop < first_look


def test_what_is_not_seen_standing_stays_armed_and_is_not_fed() -> None:
    rig = Rig(config=QUICK)
    (drive,) = running(rig, 1)
    guard(rig, drive)
    drive.sim._commands[0xF7] = lambda value, now: None
    ended: list[list[Halted]] = []
    rig.owner.start(release(rig.owner, [drive.attached]), ended.append)
    rig.run(1.0, lambda: bool(ended))
    assert not ended[0][0].standing
    assert drive.sim.watchdog_ms == 500
    rig.run(1.5)
    assert drive.sim.trips
    assert not drive.sim.moving(rig.now)


def test_a_tripped_device_is_restored_and_what_was_never_armed_is_not_written() -> None:
    rig = Rig(config=QUICK)
    tripped, never = running(rig, 2)
    guard(rig, tripped)
    rig.now += 3.0
    rig.run(0.5)
    assert rig.owner.feeding.get(1) is None
    assert tripped.sim.watchdog_ms == 500
    mark = len(rig.sent)
    rig.owner.start(release(rig.owner, [tripped.attached, never.attached]), lambda _: None)
    rig.run(1.0)
    assert tripped.sim.watchdog_ms == 0
    writes = [frame for _, frame in rig.sent[mark:] if frame[0] == 2 and frame[3] == r.WATCHDOG.address]
    assert writes == []


def test_what_may_be_armed_though_it_did_not_say_so_is_restored() -> None:
    rig = Rig(config=QUICK)
    (drive,) = drives(rig, 1)
    hear = drive.sim.receive

    def hear_only(frame: bytes, now: float) -> None:
        hear(frame, now)

    drive.sim.receive = hear_only  # type: ignore[method-assign]
    failed: list[list[Job]] = []
    rig.owner.start(arm(rig.owner, [drive.attached], 0.5), failed.append)
    rig.run(1.0, lambda: bool(failed))
    assert drive.sim.watchdog_ms == 500
    drive.sim.receive = hear  # type: ignore[method-assign]
    rig.owner.start(release(rig.owner, [drive.attached]), lambda _: None)
    rig.run(1.0)
    assert drive.sim.watchdog_ms == 0


# Lease


def test_a_lease_that_is_not_renewed_stops_the_drive() -> None:
    rig = Rig(config=QUICK)
    (drive,) = running(rig, 1)
    guard(rig, drive)
    lease = Lease(rig.owner, [drive.attached], 2.0)
    lease.renew(rig.now)
    rig.run(1.5)
    lease.renew(rig.now)
    rig.run(1.9)
    assert drive.sim.moving(rig.now)
    rig.run(0.5)
    assert not drive.sim.moving(rig.now)
    assert drive.interruptions == ["its lease of 2 s was not renewed"]
    assert drive.move(rig).reason is Reason.LOCKED


def test_after_a_lease_has_lapsed_the_device_gets_nothing_but_stops_until_it_stands() -> None:
    rig = Rig(config=QUICK)
    (drive,) = running(rig, 1)
    guard(rig, drive)
    drive.attached.axis.ramp_stop = drive.start(rpm=0, target=0, code=1)  # a ramp of some seconds
    drive.attached.axis.ramp_takes = 4.0
    lease = Lease(rig.owner, [drive.attached], 0.3)
    lease.renew(rig.now)
    rig.run(0.35)
    poll = rig.submit(read(1, r.VERSION), urgency=Urgency.POLL)
    assert (poll.outcome, poll.reason) == (Outcome.NOT_SENT, Reason.STOPPED)
    mark = len(rig.sent)
    rig.run(0.2)
    looks = {read(1, r.STATUS).adu, read(1, r.POSITION).adu, read(1, r.PULSES).adu}
    stops = {write(1, r.EMERGENCY_STOP, 1).adu, drive.attached.axis.ramp_stop.adu}
    assert {frame for _, frame in rig.sent[mark:]} <= looks | stops


def test_a_lease_that_has_ended_stops_nothing() -> None:
    rig = Rig(config=QUICK)
    (drive,) = running(rig, 1)
    lease = Lease(rig.owner, [drive.attached], 0.3)
    lease.renew(rig.now)
    lease.end()
    rig.run(1.0)
    assert drive.sim.moving(rig.now)


def test_arming_says_what_failed() -> None:
    rig = Rig(config=QUICK)
    good, bad = drives(rig, 2)
    bad.sim.receive = lambda frame, now: None  # type: ignore[method-assign]
    failed: list[list[Job]] = []
    rig.owner.start(arm(rig.owner, [good.attached, bad.attached], 1.0), failed.append)
    rig.run(1.0)
    assert [job.address for job in failed[0]] == [2]
    assert [armed.address for armed in rig.owner.feeding.all()] == [1]


def test_what_could_not_be_armed_limits_nothing_any_more() -> None:
    rig = Rig(SimUnit(9, BANK), config=QUICK)
    (drive,) = drives(rig, 1)
    drive.sim.receive = lambda frame, now: None  # type: ignore[method-assign]
    admit_watchdogs(rig.owner, [drive.attached], 0.5)
    slow = rig.submit(read_holding(9, 0, 1), reply_timeout=2.5)
    assert slow.reason is Reason.TOO_LONG
    failed: list[list[Job]] = []
    rig.owner.start(arm(rig.owner, [drive.attached], 0.5), failed.append)
    rig.run(1.0, lambda: bool(failed))
    assert rig.submit(read_holding(9, 0, 1), reply_timeout=2.5).outcome is None


def test_what_is_about_to_be_armed_counts() -> None:
    rig = Rig(line=LineSettings(baudrate=9600))
    made = drives(rig, 31)
    admit_watchdogs(rig.owner, [drive.attached for drive in made[:30]], 2.0)
    with pytest.raises(WatchdogInfeasible, match="31 watchdogs"):
        admit_watchdogs(rig.owner, [made[30].attached], 0.6)
