"""What a stop waits for, what it may cut short, when it is said again and when more forcefully."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.failure import failure
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.watchdog.guarding import emergency_stop
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read, write
from rs485bus.sim import SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.wire.crc import crc
from rs485bus.wire.frames import read_holding, write_single
from rs485bus.wire.registers import Repeat
from rs485bus.wire.timing import LineSettings
from tests.bus.support import BANK, Deaf, Drive, Scripted, drives
from tests.bus.test_emergency import guard
from tests.bus.test_stops import is_stop, running

ONE = 0.0065
"""Seconds that one transaction takes at most."""


def plain_stop(rig: Rig, address: int = 1, register: int = 5, **options: object) -> Job:
    """A stop as `bus.unit(address).write_register(..., urgency=Urgency.STOP)` sends it."""
    return rig.submit(
        write_single(address, register, 0), urgency=Urgency.STOP, repeat=Repeat.NEVER, moves=True, **options
    )


def silence(drive: Drive, *, but: Callable[[bytes], bool] = lambda frame: False) -> Callable[[], None]:
    """The drive hears nothing, but for some frames. Returns what ends that."""
    receive = drive.sim.receive
    drive.sim.receive = lambda frame, now: receive(frame, now) if but(frame) else None  # type: ignore[method-assign]

    def end() -> None:
        drive.sim.receive = receive  # type: ignore[method-assign]

    return end


# What it waits for


def test_a_plain_stop_does_not_wait_for_a_late_reply() -> None:
    unit = Scripted(1, "deaf")
    rig = Rig(unit, config=BusConfig(echo=False, reply_timeout=0.02, retries=0))
    rig.done(rig.submit(write_single(1, 5, 7), repeat=Repeat.NEVER))
    begun = rig.now
    stop = plain_stop(rig)
    rig.done(stop)
    assert stop.sent_at - begun < ONE
    assert stop.outcome is Outcome.REPLY  # another value: it cannot be the late one


@pytest.mark.parametrize("turnaround", [0.06, 0.3])
def test_a_sensor_slower_than_the_stops_of_a_dead_drive_follow_upon_each_other_is_read_all_the_same(
    turnaround: float,
) -> None:
    slow = SimUnit(7, BANK)
    slow.turnaround = turnaround
    rig = Rig(slow, config=BusConfig(echo=False, reply_timeout=0.5))
    (drive,) = running(rig, 1)
    silence(drive)
    press(rig)
    rig.run(3.0)
    for register in range(10):
        job = rig.submit(read_holding(7, register, 1))
        rig.done(job)
        assert job.outcome is Outcome.REPLY
        assert job.reply[3:5] == (100 + register).to_bytes(2, "big")


@pytest.mark.parametrize("twice", [True, False])
def test_the_late_reply_of_an_equal_write_is_not_taken_for_the_answer_to_a_plain_stop(twice: bool) -> None:
    unit = Scripted(1, 0.07, 0.0 if twice else "deaf")
    rig = Rig(unit, config=BusConfig(echo=False, reply_timeout=0.05, retries=0))
    first = rig.submit(write_single(1, 5, 0), repeat=Repeat.NEVER)
    rig.done(first)
    assert first.outcome is Outcome.UNKNOWN
    stop = plain_stop(rig)
    rig.run(0.5)
    assert stop.outcome is (Outcome.REPLY if twice else Outcome.UNKNOWN)
    assert len(unit.heard) == (2 if twice else 1)


def test_a_plain_stop_waits_for_no_stop_before_it_and_is_not_dropped_by_one_after_it() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    drive.sim._commands[0xF7] = lambda value, now: None
    drive.stop(rig)
    rig.run(0.006)  # it is being looked at
    begun = rig.now
    stop = rig.submit(
        write(1, r.ENABLE, 0), urgency=Urgency.STOP, moves=True, motion=drive.attached.motion, repeat=Repeat.NEVER
    )
    drive.stop(rig)
    rig.run(0.02)
    assert stop.outcome is Outcome.REPLY
    assert stop.sent_at - begun < ONE


def test_a_plain_stop_goes_to_a_unit_that_is_offline_and_in_the_turnaround_of_a_broadcast() -> None:
    rig = Rig(Deaf(1), config=BusConfig(echo=False, reply_timeout=0.01, turnaround=1.0))
    rig.done(*(rig.submit(read_holding(1, at, 1)) for at in range(9)), within=60)
    assert rig.owner.units[1].reach.offline
    rig.submit(write_single(0, 3, 1), repeat=Repeat.NEVER)
    rig.run(0.001)
    begun = rig.now
    stop = plain_stop(rig)
    rig.done(stop)
    assert stop.sent_at - begun < ONE


def test_what_the_port_may_keep_is_waited_for_before_a_transaction_is_cut_short() -> None:
    for latency in (0.0, 0.016):
        rig = Rig(Deaf(9), config=BusConfig(echo=False, reply_timeout=1.0))
        rig.owner.pair.latency = latency
        (drive,) = running(rig, 1)
        rig.submit(read_holding(9, 0, 1))
        rig.run(0.002)
        begun = rig.now
        drive.stop(rig)
        rig.run(0.1)
        first = next(at for at, frame in rig.sent if is_stop(frame)) - begun
        assert latency + 0.008 < first < latency + 0.0102


# What it may cut short


def test_a_stop_that_cannot_go_yet_cuts_nobody_elses_transaction_short() -> None:
    """A drive that acknowledges stops and moves on is left alone until its watchdog has stopped it."""
    slow = SimUnit(7, BANK)
    slow.turnaround = 0.05
    rig = Rig(slow)
    (drive,) = running(rig, 1)
    guard(rig, drive, timeout=4.0)
    drive.sim._commands[0xF7] = lambda value, now: None
    rig.owner.now = rig.now
    rig.owner.start(emergency_stop(rig.owner), lambda _: None)
    rig.run(1.0)
    assert rig.owner.units[1].silent_until > rig.now
    drive.stop(rig)  # pressed again
    plain_stop(rig)
    for _ in range(20):
        job = rig.submit(read_holding(7, 0, 1), repeat=Repeat.NEVER, retries=0)
        rig.done(job)
        assert job.outcome is Outcome.REPLY
    assert all(record.outcome != "cut" for record in rig.owner.journal.flight)


def test_a_dead_drive_with_a_long_watchdog_that_is_told_to_stop_again_leaves_a_slow_sensor_its_answers() -> None:
    slow = SimUnit(7, BANK)
    slow.turnaround = 0.05
    rig = Rig(slow)
    (drive,) = running(rig, 1)
    guard(rig, drive, timeout=4.0)
    silence(drive)
    rig.owner.now = rig.now
    rig.owner.start(emergency_stop(rig.owner), lambda _: None)
    rig.run(1.5)
    drive.stop(rig)
    answered = 0
    for _ in range(20):
        job = rig.submit(read_holding(7, 0, 1))
        rig.done(job)
        answered += job.outcome is Outcome.REPLY
    assert answered == 20


@pytest.mark.parametrize("baudrate", [4800, 9600, 38400])
def test_the_acknowledgement_of_a_stop_that_has_begun_is_not_cut_short_by_the_next_stop(baudrate: int) -> None:
    rig = Rig(line=LineSettings(baudrate=baudrate))
    running(rig, 6)
    press(rig)
    rig.run(1.0)
    assert all(record.outcome != "cut" for record in rig.owner.journal.flight)
    assert rig.pair.collisions == 0


# A repetition is the same stop


def slowing(rig: Rig) -> tuple[Drive, bytes]:
    """A drive that turns, and the stop with the ramp that belongs to its move: 0.84 s."""
    (drive,) = running(rig, 1)
    drive.attached.axis.ramp_stop = drive.start(rpm=0, target=0, code=200)
    drive.attached.axis.ramp_takes = 300 / (20_000 / 56)
    return drive, drive.attached.axis.ramp_stop.adu


def stops_of(rig: Rig, soft: bytes) -> list[tuple[float, str]]:
    """The stops that were sent: when, and of which kind."""
    return [(at, "soft" if frame == soft else "hard") for at, frame in rig.sent if frame == soft or is_stop(frame)]


def test_a_lost_reply_hardens_no_stop() -> None:
    rig = Rig()
    drive, soft = slowing(rig)
    receive, lost = drive.sim.receive, []

    def lossy(frame: bytes, now: float) -> bytes | None:
        reply = receive(frame, now)
        if frame == soft and not lost:
            lost.append(frame)
            return None
        return reply

    drive.sim.receive = lossy  # type: ignore[method-assign]
    drive.stop(rig, emergency=False)
    rig.run(2.0)
    assert [kind for _, kind in stops_of(rig, soft)] == ["soft", "soft"]
    assert [halted.standing for halted in drive.halted] == [True]


def test_after_two_that_were_not_acknowledged_a_harder_one_follows() -> None:
    rig = Rig()
    drive, soft = slowing(rig)
    silence(drive, but=lambda frame: frame[1] == 4 or is_stop(frame))
    drive.stop(rig, emergency=False)
    rig.run(2.0)
    assert [kind for _, kind in stops_of(rig, soft)] == ["soft", "soft", "hard"]
    assert [halted.standing for halted in drive.halted] == [True]


def test_after_one_that_was_acknowledged_and_not_done_a_harder_one_follows_when_half_as_much_again_is_over() -> None:
    rig = Rig()
    drive, soft = slowing(rig)
    receive = drive.sim.receive
    ramp = drive.attached.stopping_time(False)

    def ignoring(frame: bytes, now: float) -> bytes | None:
        return frame[:6] + crc(frame[:6]) if frame == soft else receive(frame, now)

    drive.sim.receive = ignoring  # type: ignore[method-assign]
    begun = rig.now
    drive.stop(rig, emergency=False)
    rig.run(4.0)
    (_, first), (at, second) = stops_of(rig, soft)
    assert (first, second) == ("soft", "hard")
    assert 1.5 * ramp < at - begun < 1.5 * ramp + 0.1
    assert [halted.standing for halted in drive.halted] == [True]


def test_a_soft_stop_that_is_asked_for_twice_stays_soft() -> None:
    rig = Rig()
    drive, soft = slowing(rig)
    drive.stop(rig, emergency=False)
    rig.run(0.2)
    drive.stop(rig, emergency=False)
    rig.run(2.0)
    assert {kind for _, kind in stops_of(rig, soft)} == {"soft"}
    assert [halted.standing for halted in drive.halted] == [True, True]


# What waits behind a stop


BEHIND: dict[str, Callable[[Drive], tuple[object, dict[str, object]]]] = {
    "a write": lambda drive: (write(1, r.ENABLE, 1), {"moves": True, "motion": drive.attached.motion}),
    "a move": lambda drive: (drive.start(), {"moves": True, "motion": drive.attached.motion}),
    "a broadcast": lambda drive: (write(0, r.ENABLE, 1), {"moves": True, "motion": drive.attached.motion}),
}


@pytest.mark.parametrize("what", BEHIND)
@pytest.mark.parametrize("asked_later", [False, True])
def test_what_waits_behind_a_stop_that_cannot_be_confirmed_ends_and_never_goes_out(
    what: str, asked_later: bool
) -> None:
    rig = Rig(config=BusConfig(echo=False))
    drive, _ = running(rig, 2)
    heard = silence(drive)
    begun = rig.now
    drive.stop(rig)
    if asked_later:
        rig.run(3.0)
    request, options = BEHIND[what](drive)
    behind = rig.submit(request, repeat=Repeat.NEVER, **options)  # type: ignore[arg-type]
    after = rig.submit(read(1, r.VERSION))
    rig.done(behind, after, within=3.0)
    assert (behind.outcome, behind.reason) == (Outcome.NOT_SENT, Reason.UNCONFIRMED)
    assert "three times" in str(failure(behind, []))
    if not asked_later:
        stops = [at for at, frame in rig.sent if is_stop(frame) and begun <= at <= behind.ended_at]
        assert len(stops) == 3
    rig.run(600.0)
    heard()  # its power is back, ten minutes later
    rig.run(60.0)
    assert rig.owner.units[1].halt is None
    assert request.adu not in [frame for _, frame in rig.sent]  # type: ignore[attr-defined]
    again = rig.submit(write(1, r.ENABLE, 1), moves=True, motion=drive.attached.motion, repeat=Repeat.NEVER)
    rig.done(again)
    assert again.outcome is Outcome.REPLY


# Emergency stops to what is not heard


def press(rig: Rig) -> list[object]:
    reports: list[object] = []
    rig.owner.now = rig.now
    rig.owner.start(emergency_stop(rig.owner), reports.append)
    return reports


@pytest.mark.parametrize("armed", [False, True])
@pytest.mark.parametrize("reply_timeout", [0.01, 0.1, 0.5])
def test_a_drive_that_is_not_heard_is_told_to_stop_at_least_every_100_ms(armed: bool, reply_timeout: float) -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=reply_timeout))
    (drive,) = running(rig, 1)
    if armed:
        guard(rig, drive, timeout=5.0)
    heard = silence(drive)
    rig.sent.clear()
    reports = press(rig)
    begun = rig.now
    rig.run(10.0)
    assert len(reports) == 1
    stops = [at for at, frame in rig.sent if is_stop(frame) and frame[0] == 1]
    pauses = [later - earlier for earlier, later in zip([begun, *stops], [*stops, rig.now], strict=True)]
    assert max(pauses) < 0.105
    heard()
    rig.run(0.5)
    assert not drive.sim.moving(rig.now)
    assert rig.owner.units[1].halt is None


def test_a_slow_drive_that_is_told_to_stop_by_all_means_is_seen_to_stand_before_it_is_said_that_it_was_not() -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.5))
    running(rig, 1)
    rig.pair.turnaround = 0.3
    reports = press(rig)
    rig.run(4.0)
    assert [device.standing for device in reports[0].devices] == [True]  # type: ignore[attr-defined]


def test_six_drives_that_are_not_heard_leave_others_their_turns() -> None:
    rig = Rig(SimUnit(77, BANK), config=BusConfig(echo=False))
    rig.done(rig.submit(read_holding(77, 0, 1)))
    for drive in drives(rig, 6):
        silence(drive)
    press(rig)
    rig.run(3.0)
    begun = rig.now
    jobs = [rig.submit(read_holding(77, at, 1)) for at in range(40)]
    rig.done(*jobs)
    assert rig.now - begun < 2.0


def test_a_drive_that_is_offline_is_looked_at_by_its_stop_alone() -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.01))
    (drive,) = running(rig, 1)
    heard = silence(drive)
    rig.done(*(rig.submit(read(1, r.PULSES)) for _ in range(9)))
    assert rig.owner.units[1].reach.offline
    press(rig)
    rig.run(5.0)
    heard()
    begun = rig.now
    rig.run(1.0, lambda: rig.owner.units[1].halt is None)
    assert rig.now - begun < 0.2


def test_one_that_acknowledges_and_moves_on_leaves_others_their_turns_once_that_was_said() -> None:
    rig = Rig(SimUnit(77, BANK), line=LineSettings(baudrate=9600), config=BusConfig(echo=False))
    for drive in running(rig, 2):
        drive.sim._commands[0xF7] = lambda value, now: None
    reports = press(rig)
    rig.run(3.0)
    assert [device.standing for device in reports[0].devices] == [False, False]  # type: ignore[attr-defined]
    begun = rig.now
    jobs = [rig.submit(read_holding(77, at, 1), urgency=Urgency.POLL) for at in range(10)]
    rig.done(*jobs)
    assert rig.now - begun < 2.0
    stops = [at for at, frame in rig.sent if is_stop(frame) and frame[0] == 1 and at > begun - 1.0]
    assert max(later - earlier for earlier, later in itertools.pairwise(stops)) < 0.15


def test_an_exception_acknowledges_no_stop_and_a_status_that_lies_does_not_confirm_it() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    receive = drive.sim.receive
    refused: list[bytes] = []

    def lying(frame: bytes, now: float) -> bytes | None:
        if is_stop(frame) and not refused:
            refused.append(frame)
            return (body := bytes((1, 0x86, 3))) + crc(body)
        if frame[:4] == bytes((1, 4, 0, 0xF1)) and drive.sim.moving(now):
            return (body := bytes((1, 4, 2, 0, 1))) + crc(body)  # it says that it stands
        return receive(frame, now)

    drive.sim.receive = lying  # type: ignore[method-assign]
    drive.stop(rig)
    rig.run(1.0, lambda: bool(drive.halted))
    assert drive.halted[0].standing
    assert not drive.sim.moving(rig.now)


def test_who_is_told_how_a_stop_ended_and_fails_keeps_nobody_else_from_being_told(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def boom(_: object) -> None:
        raise RuntimeError("boom")

    rig = Rig()
    (drive,) = running(rig, 1)
    drive.stop(rig).listen(boom)
    drive.stop(rig)
    drive.attached.motion.commanded(rig.now)
    rig.owner.after_stops(lambda: boom(None))
    rig.owner.at(rig.now + 0.01, lambda: boom(None))
    reports: list[object] = []
    rig.owner.start(emergency_stop(rig.owner), boom)
    rig.owner.start(emergency_stop(rig.owner), reports.append)
    rig.run(1.0)
    assert [halted.standing for halted in drive.halted] == [True, True]
    assert reports
    assert rig.owner.units[1].halt is None
    assert caplog.text.count("RuntimeError: boom") == 4


def test_a_read_with_the_urgency_of_a_stop_waits_for_a_late_reply_like_any_other() -> None:
    rig = Rig(Scripted(1, 0.06), config=BusConfig(echo=False, reply_timeout=0.02, retries=0))
    rig.done(rig.submit(read_holding(1, 5, 1)))
    job = rig.submit(read_holding(1, 6, 1), urgency=Urgency.STOP)
    rig.done(job)
    assert job.reply[3:5] == (106).to_bytes(2, "big")


# A port that is away


def test_reads_without_a_time_of_their_own_wait_for_the_port_for_thirty_seconds() -> None:
    rig = Rig(SimUnit(1, BANK))
    before = rig.submit(read_holding(1, 0, 1))
    rig.owner.unplugged(rig.now)
    begun, ended = rig.now, {}
    rig.run(5.0)
    after = rig.submit(read_holding(1, 4, 1), on_end=lambda _: ended.setdefault("after", rig.now - begun))
    plain = plain_stop(rig, on_end=lambda _: ended.setdefault("plain", rig.now - begun))
    patient = rig.submit(read_holding(1, 5, 1), expires_at=rig.now + 60)
    own = rig.submit(read_holding(1, 6, 1), internal=True, on_end=lambda _: ended.setdefault("own", rig.now - begun))
    rig.run(40.0)
    assert before.outcome is not None
    assert ended == dict.fromkeys(("after", "plain", "own"), pytest.approx(35.0, abs=0.02))
    assert {job.reason for job in (after, plain, own)} == {Reason.UNPLUGGED}
    assert patient.outcome is None
    rig.owner.plugged(rig.now)
    rig.done(patient)
    assert patient.outcome is Outcome.REPLY


def test_a_port_that_comes_for_moments_without_an_answer_does_not_prolong_that() -> None:
    rig = Rig(Deaf(1))
    rig.owner.unplugged(rig.now)
    rig.run(0.1)
    job = rig.submit(read_holding(1, 0, 1))
    begun = rig.now
    while job.outcome is None and rig.now < begun + 40:
        rig.run(1.0)
        rig.owner.plugged(rig.now)
        rig.owner.unplugged(rig.now)
    assert rig.now - begun < 31.1
