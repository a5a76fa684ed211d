"""Stops wait for nothing they need not, are confirmed by reading, and nothing older follows them."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.units.motion import Motion
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read, write, write_block
from rs485bus.devices.mks.values import Status
from rs485bus.sim import Noise
from rs485bus.sim.rig import Rig
from rs485bus.sim.treatment import PLAIN, Treatment
from rs485bus.wire.frames import read_holding
from rs485bus.wire.registers import Repeat
from tests.bus.support import Deaf, Drive, Scripted, drives

STOP = 0xF7


def is_stop(frame: bytes) -> bool:
    return frame[1:4] == bytes((6, 0, STOP))


def is_move(frame: bytes) -> bool:
    return frame[1:4] == bytes((16, 0, r.MOVE_TO_COUNTS.address))


def running(rig: Rig, count: int, **options: object) -> list[Drive]:
    """Drives that are well under way."""
    made = drives(rig, count, **options)
    rig.done(*(drive.move(rig) for drive in made))
    rig.run(1.0)
    assert all(drive.sim.moving(rig.now) for drive in made)
    rig.sent.clear()
    return made


def flood(rig: Rig, count: int, addresses: int) -> list[Job]:
    return [rig.submit(read(1 + at % addresses, r.PULSES), urgency=Urgency.POLL) for at in range(count)]


def test_a_stop_is_confirmed_by_reading_that_the_axis_stands() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    drive.stop(rig)
    rig.run(1.0)
    assert [halted.standing for halted in drive.halted] == [True]
    assert not drive.sim.moving(rig.now)
    assert not drive.attached.motion.may_move
    stop, look = (frame for _, frame in rig.sent[:2])
    assert is_stop(stop)
    assert look == read(1, r.STATUS).adu


def test_what_confirms_a_stop_goes_before_a_set_point_that_waits_for_its_end() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    drive.stop(rig)
    run = write_block(1, r.RUN, 0, 250, 100)
    waits = rig.submit(run, urgency=Urgency.CONFIRM, moves=True, motion=drive.attached.motion, retries=0)
    rig.run(1.0)
    assert [halted.standing for halted in drive.halted] == [True]
    assert waits.outcome is Outcome.REPLY
    assert rig.sent[-1][1] == run.adu


def test_an_echo_alone_confirms_nothing_and_the_stop_is_repeated_until_it_stands() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    real = drive.sim._commands[STOP]
    ignored: list[float] = []
    # It echoes the first two stops, and goes on turning.
    drive.sim._commands[STOP] = lambda value, now: ignored.append(now) if len(ignored) < 2 else real(value, now)
    drive.stop(rig)
    rig.run(5.0)
    assert [halted.standing for halted in drive.halted] == [True]
    assert sum(is_stop(frame) for _, frame in rig.sent) == 3
    assert not drive.sim.moving(rig.now)


def test_a_stop_whose_frame_was_lost_is_said_again_without_waiting_for_a_ramp() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    receive, lost = drive.sim.receive, []

    def lossy(frame: bytes, now: float) -> bytes | None:
        if is_stop(frame) and not lost:
            lost.append(frame)
            return None
        return receive(frame, now)

    drive.sim.receive = lossy  # type: ignore[method-assign]
    begun = rig.now
    drive.stop(rig)
    rig.run(1.0)
    assert drive.halted[0].standing
    assert [at - begun for at, frame in rig.sent if is_stop(frame)][1] < 0.15


def test_a_motor_that_is_about_to_start_is_not_taken_for_one_that_stands() -> None:
    rig = Rig()
    (drive,) = drives(rig, 1)
    drive.sim.motion.machine.start_delay = 0.03
    real = drive.sim._commands[STOP]
    ignored: list[float] = []
    # The first stop is echoed and ignored, since there is nothing to stop yet.
    drive.sim._commands[STOP] = lambda value, now: real(value, now) if ignored else ignored.append(now)
    drive.move(rig)
    rig.run(0.008)
    drive.stop(rig)
    rig.run(2.0)
    assert drive.halted[0].standing
    assert not drive.sim.moving(rig.now)


def test_a_status_that_is_stuck_does_not_keep_a_standing_motor_from_being_seen() -> None:
    rig = Rig()
    (drive,) = running(rig, 1, stuck_status=Status.SLOWING_DOWN)
    drive.stop(rig)
    rig.run(1.0)
    assert [halted.standing for halted in drive.halted] == [True]


def test_with_twelve_moving_axes_and_a_thousand_jobs_all_stand_within_a_quarter_of_a_second() -> None:
    rig = Rig()
    moving = running(rig, 12)
    flood(rig, 1000, 12)
    rig.run(0.1)
    begun = rig.now
    rig.sent.clear()
    for drive in moving:
        drive.stop(rig)
    rig.run(0.25)
    first = next(at for at, frame in rig.sent if is_stop(frame))
    assert first - begun < 0.0065  # one transaction
    assert all(drive.halted and drive.halted[0].standing for drive in moving)
    assert not any(drive.sim.moving(rig.now) for drive in moving)


@pytest.mark.parametrize("seed", range(5))
def test_with_five_percent_loss_within_a_second(seed: int) -> None:
    rig = Rig(seed=seed)
    moving = running(rig, 12)
    flood(rig, 1000, 12)
    rig.pair.noise = Noise(lost_request=0.025, lost_reply=0.025)
    rig.run(0.1)
    for drive in moving:
        drive.stop(rig)
    rig.run(1.0)
    assert all(drive.halted and drive.halted[0].standing for drive in moving)


def test_a_dead_unit_that_is_waited_for_delays_a_stop_by_no_more_than_ten_milliseconds() -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=1.0))
    (drive,) = running(rig, 1)
    rig.pair.devices.append(Deaf(9))
    dead = rig.submit(read_holding(9, 0, 1))
    rig.run(0.002)
    begun = rig.now
    drive.stop(rig)
    rig.run(0.1)
    assert next(at for at, frame in rig.sent if is_stop(frame)) - begun < 0.0102
    assert rig.pair.early_frames == 0
    assert dead.unanswered == 1
    assert rig.owner.units[9].late.must_wait(read_holding(9, 4, 1))


def test_a_frame_that_is_being_received_is_not_cut() -> None:
    rig = Rig(Scripted(9, lambda reply: reply), config=BusConfig(echo=False))
    (drive,) = running(rig, 1)
    job = rig.submit(read_holding(9, 0, 40))
    rig.run(0.005)  # the reply is on its way
    drive.stop(rig)
    rig.done(job)
    assert job.outcome is Outcome.REPLY
    rig.run(0.2)
    assert rig.pair.early_frames == rig.pair.collisions == 0


def test_a_stop_does_not_wait_until_an_offline_device_is_found() -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.01))
    (drive,) = running(rig, 1)
    receive = drive.sim.receive
    drive.sim.receive = lambda frame, now: None  # type: ignore[method-assign]
    rig.done(*(rig.submit(read(1, r.PULSES)) for _ in range(4)))
    assert rig.owner.units[1].reach.offline
    drive.sim.receive = receive  # type: ignore[method-assign]
    begun = rig.now
    drive.stop(rig)
    rig.run(0.1)
    assert next(at for at, frame in rig.sent if is_stop(frame) and at >= begun) - begun < 0.01
    assert drive.halted[0].standing


def test_a_device_that_cannot_be_seen_standing_is_reported_after_three_stops_and_tried_again() -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.02))
    (drive,) = running(rig, 1)
    receive = drive.sim.receive
    drive.sim.receive = lambda frame, now: None  # type: ignore[method-assign]
    drive.stop(rig)
    rig.run(1.5)
    assert [(halted.standing, halted.stops) for halted in drive.halted] == [(False, 3)]
    assert drive.attached.motion.may_move
    drive.sim.receive = receive  # type: ignore[method-assign]
    rig.run(30.0)
    assert not drive.attached.motion.may_move
    assert not drive.sim.moving(rig.now)


def test_a_device_that_is_left_alone_is_stopped_at_once_if_somebody_asks_for_it() -> None:
    rig = Rig(config=BusConfig(echo=False))
    (drive,) = running(rig, 1)
    receive = drive.sim.receive
    drive.sim.receive = lambda frame, now: None  # type: ignore[method-assign]
    rig.done(*(rig.submit(read(1, r.PULSES)) for _ in range(3)))
    assert rig.owner.units[1].reach.offline
    for _ in range(2):
        drive.stop(rig)
        rig.run(2.0)
        assert not drive.halted.pop().standing
    drive.sim.receive = receive  # type: ignore[method-assign]
    rig.run(5.0)
    assert drive.attached.motion.may_move  # looking for what may be lost is rationed
    drive.stop(rig)
    rig.run(0.5)
    assert drive.halted.pop().standing
    assert not drive.sim.moving(rig.now)


def test_a_second_stop_goes_out_at_once_though_the_first_is_still_being_confirmed() -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.5))
    (drive,) = running(rig, 1)
    drive.attached.axis.ramp_stop = None
    receive = drive.sim.receive
    drive.sim.receive = lambda frame, now: receive(frame, now) if is_stop(frame) else None  # type: ignore[method-assign]
    drive.stop(rig, emergency=False)
    rig.run(0.02)  # the confirming read is not answered
    begun = rig.now
    drive.stop(rig, emergency=True)
    rig.run(0.05)
    assert next(at for at, frame in rig.sent if is_stop(frame) and at >= begun) - begun < 0.0102


def test_moves_that_waited_are_dropped_and_new_ones_wait_until_it_stands() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    drive.attached.axis.ramp_stop = drive.start(rpm=0, target=0, code=200)
    drive.attached.axis.ramp_takes = 300 / (20_000 / 56)
    busy = rig.submit(read(1, r.VERSION))
    old = drive.move(rig)
    drive.stop(rig, emergency=False)
    new = drive.move(rig, target=-10_000_000)
    rig.run(0.3)
    assert drive.sim.moving(rig.now)  # it slows down
    assert new.outcome is None
    rig.done(busy, old, new)
    assert (old.outcome, old.reason) == (Outcome.NOT_SENT, Reason.STOPPED)
    assert new.outcome is Outcome.REPLY
    assert new.sent_at - rig.sent[0][0] > drive.attached.axis.ramp_takes


def test_a_move_is_not_repeated_after_a_stop() -> None:
    rig = Rig()
    (drive,) = drives(rig, 1)
    receive = drive.sim.receive
    drive.sim.receive = lambda frame, now: None if is_move(frame) else receive(frame, now)  # type: ignore[method-assign]
    job = drive.move(rig)
    job.repeat = r.ENABLE.repeat  # SAFE: it would be repeated
    rig.run(0.02)
    drive.stop(rig)
    rig.run(1.0)
    assert sum(is_move(frame) for _, frame in rig.sent) == 1
    assert job.outcome is Outcome.UNKNOWN


def test_a_raw_write_to_the_device_is_dropped_by_a_stop_of_it_too() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    rig.submit(read(1, r.VERSION))
    raw = rig.submit(write(1, r.ENABLE, True), moves=True, motion=drive.attached.motion)
    drive.stop(rig)
    rig.done(raw)
    assert raw.reason is Reason.STOPPED


schedules = st.lists(
    st.tuples(
        st.sampled_from(["move", "safe move", "stop", "emergency", "read", "unplug", "plug", "wait"]),
        st.integers(0, 2),
        st.floats(0.0, 0.05),
    ),
    min_size=3,
    max_size=30,
)


@settings(max_examples=150, deadline=None)
@given(schedules, st.integers(0, 1000))
def test_move_stop_move_never_happens_on_the_wire(plan: list[tuple[str, int, float]], seed: int) -> None:
    """Whatever is queued, repeated, lost, unplugged: no moving frame that was asked for before a stop follows it."""
    rig = Rig(seed=seed, noise=Noise(lost_request=0.2, lost_reply=0.2, late=0.1), config=BusConfig(echo=False))
    made = drives(rig, 3)
    rng = random.Random(seed)
    asked: dict[bytes, float] = {}
    stops: dict[int, float] = {}
    for what, at, pause in plan:
        drive = made[at]
        if what in ("move", "safe move"):
            job = drive.move(rig, target=rng.randrange(1, 1_000_000_000))
            job.repeat = r.ENABLE.repeat if what == "safe move" else job.repeat
            asked[job.request.adu] = rig.now
        elif what in ("stop", "emergency"):
            drive.stop(rig, emergency=what == "emergency")
            stops[drive.address] = rig.now
            for frame, when in asked.items():
                if frame[0] == drive.address and when <= rig.now:
                    asked[frame] = float("-inf")  # from here on it must not be seen
        elif what == "read":
            rig.submit(read(drive.address, r.PULSES), urgency=Urgency.POLL)
        elif what == "unplug":
            rig.owner.unplugged(rig.now)
        elif what == "plug":
            rig.owner.plugged(rig.now)
        mark = len(rig.sent)
        rig.run(pause)
        late = [frame for _, frame in rig.sent[mark:] if asked.get(frame) == float("-inf")]
        assert not late
    rig.owner.plugged(rig.now)
    mark = len(rig.sent)
    rig.run(3.0)
    assert not [frame for _, frame in rig.sent[mark:] if asked.get(frame) == float("-inf")]


def test_a_broadcast_neither_moves_what_is_locked_nor_overtakes_a_stop() -> None:
    rig = Rig()
    first, second = running(rig, 2)
    everybody = Motion([first.attached.motion, second.attached.motion])
    stops = first.sim._commands[STOP]
    first.sim._commands[STOP] = lambda value, now: None
    first.stop(rig)
    waits = rig.submit(write(0, r.ENABLE, 1), repeat=Repeat.NEVER, moves=True, motion=everybody)
    rig.run(0.1)
    assert waits.outcome is None
    assert first.sim.moving(rig.now)
    first.sim._commands[STOP] = stops
    rig.done(waits)
    assert rig.owner.units[1].halt is None
    rig.owner.units[1].locked = "it was stopped for safety"
    refused = rig.submit(write(0, r.ENABLE, 1), repeat=Repeat.NEVER, moves=True)
    assert (refused.outcome, refused.reason) == (Outcome.NOT_SENT, Reason.LOCKED)


@pytest.mark.parametrize("again_after", [0.02, 0.15])
def test_a_stop_of_a_drive_that_stands_is_confirmed_though_its_answers_all_look_alike_and_one_was_late(
    again_after: float,
) -> None:
    """It stands, so that each of its answers could be a copy of the late one: of two equal ones, one is no copy."""
    rig = Rig()
    (drive,) = drives(rig, 1)
    for _ in range(5):
        for what in (r.STATUS, r.POSITION, r.PULSES):
            rig.done(rig.submit(read(1, what)))
    late = [Treatment(delay=0.2)]
    looks = read(1, r.POSITION).adu
    rig.pair.script = lambda frame, now: late.pop() if late and frame == looks else PLAIN
    drive.stop(rig)
    rig.run(again_after)
    drive.stop(rig)
    rig.run(1.0, lambda: len(drive.halted) > 1)
    assert [halted.standing for halted in drive.halted] == [True, True]
