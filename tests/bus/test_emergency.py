"""An emergency stop latches, flushes, stops everything, and says who stands."""

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.watchdog.guarding import EmergencyReport, arm, emergency_stop
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read, write
from rs485bus.sim import Noise, SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding, write_single
from tests.bus.support import BANK, Drive, outcomes
from tests.bus.test_stops import flood, is_stop, running


def press(rig: Rig) -> list[EmergencyReport]:
    reports: list[EmergencyReport] = []
    rig.owner.now = rig.now
    rig.owner.start(emergency_stop(rig.owner), reports.append)
    return reports


def guard(rig: Rig, *drives: Drive, timeout: float = 0.5) -> None:
    failed: list[list[Job]] = []
    rig.owner.start(arm(rig.owner, [drive.attached for drive in drives], timeout), failed.append)
    rig.run(1.0, lambda: bool(failed))
    assert failed == [[]]


def test_everything_is_stopped_and_reported_standing() -> None:
    rig = Rig()
    moving = running(rig, 4)
    reports = press(rig)
    rig.run(0.3)
    assert [(device.address, device.standing) for device in reports[0].devices] == [(a, True) for a in (1, 2, 3, 4)]
    assert reports[0].all_standing
    assert not any(drive.sim.moving(rig.now) for drive in moving)


def test_the_first_frame_stops_the_whole_family_at_once() -> None:
    rig = Rig()
    moving = running(rig, 4)
    press(rig)
    rig.run(0.004)
    assert rig.sent[0][1] == write(0, r.EMERGENCY_STOP, 1).adu
    assert not any(drive.sim.moving(rig.now) for drive in moving)


def test_no_broadcast_is_sent_where_nobody_knows_what_an_unknown_device_would_make_of_it() -> None:
    rig = Rig()
    running(rig, 2)
    rig.pair.devices.append(SimUnit(77, BANK))
    rig.done(rig.submit(read_holding(77, 0, 1)))
    rig.sent.clear()
    press(rig)
    rig.run(0.3)
    assert all(frame[0] != 0 for _, frame in rig.sent)


def test_moving_axes_are_stopped_first() -> None:
    rig = Rig()
    first, _, third = running(rig, 3)
    first.stop(rig)
    third.stop(rig)
    rig.run(0.5)
    rig.sent.clear()
    press(rig)
    rig.run(0.3)
    assert [frame[0] for _, frame in rig.sent if is_stop(frame)][:2] == [0, 2]


def test_a_thousand_waiting_jobs_are_flushed_and_do_not_hold_it_up() -> None:
    rig = Rig()
    running(rig, 3)
    waiting = flood(rig, 1000, 3)
    moves = [rig.submit(write_single(1, 0x84, 16), moves=True, internal=False) for _ in range(5)]
    rig.run(0.05)
    done = sum(job.outcome is not None for job in waiting + moves)
    begun = rig.now
    press(rig)
    rig.run(0.3)
    first = next(at for at, frame in rig.sent if is_stop(frame) and at >= begun)
    assert first - begun < 0.0065
    flushed = [job for job in waiting + moves if job.outcome is Outcome.NOT_SENT]
    assert len(flushed) >= 1005 - done - 2
    assert {job.reason for job in flushed} <= {Reason.EMERGENCY, Reason.LATCHED, Reason.STOPPED}


def test_while_latched_nothing_that_could_move_is_sent() -> None:
    rig = Rig(SimUnit(77, BANK))
    (drive,) = running(rig, 1)
    reports = press(rig)
    rig.run(0.3)
    assert reports
    jobs = [
        drive.move(rig),
        rig.submit(write_single(77, 0, 1), moves=True),
        rig.submit(write_single(0, 0x91, 1), moves=True),
    ]
    assert [job.reason for job in jobs] == [Reason.LATCHED] * 3
    looks = [rig.submit(read(1, r.POSITION)), rig.submit(read_holding(77, 0, 1))]
    rig.done(*looks)
    assert outcomes(looks) == [Outcome.REPLY] * 2


def test_a_device_that_is_not_seen_standing_is_neither_polled_nor_fed() -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.01))
    moving, standing = running(rig, 2)
    guard(rig, moving, standing)
    moving.sim._commands[0xF7] = lambda value, now: None  # it does not obey
    begun = rig.now
    reports = press(rig)
    rig.run(1.0, lambda: bool(reports))
    assert [device.standing for device in reports[0].devices] == [False, True]
    refused, answered = rig.submit(read(1, r.VERSION)), rig.submit(read(2, r.VERSION))
    rig.done(refused, answered)
    assert (refused.outcome, answered.outcome) == (Outcome.NOT_SENT, Outcome.REPLY)
    stops = [at for at, frame in rig.sent if is_stop(frame) and frame[0] == 1 and at >= begun]
    assert len(stops) == 3
    # Now only its own watchdog is left: no frame at all until that has passed.
    last = max(at for at, frame in rig.sent if frame[0] == 1)
    rig.run(0.45)
    assert max(at for at, frame in rig.sent if frame[0] == 1) == last
    rig.run(0.3)
    assert moving.sim.trips
    assert not moving.sim.moving(rig.now)
    assert sum(frame[0] == 2 for at, frame in rig.sent if at > last) >= 2  # the other is fed


def test_it_is_confirmed_with_loss_as_well() -> None:
    rig = Rig(seed=3)
    running(rig, 12)
    rig.pair.noise = Noise(lost_request=0.025, lost_reply=0.025)
    reports = press(rig)
    rig.run(1.0)
    assert reports[0].all_standing


def test_pressing_twice_reports_twice() -> None:
    rig = Rig()
    running(rig, 2)
    first = press(rig)
    rig.run(0.003)
    second = press(rig)
    rig.run(0.5)
    assert first[0].all_standing
    assert second[0].all_standing


def test_nothing_resumes_when_it_is_cleared() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    press(rig)
    rig.run(0.3)
    rig.owner.gate.latched = False
    mark = len(rig.sent)
    rig.run(5.0)
    assert len(rig.sent) == mark
    blocked = drive.move(rig)
    assert blocked.reason is Reason.LOCKED
    assert rig.submit(read(1, r.STATUS), urgency=Urgency.POLL).outcome is None
