"""The frames that start a group go out as one, which only a stop may interrupt; and all of them or none."""

from collections.abc import Callable

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.burst import Burst, BurstSlot
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.watchdog.guarding import admit_watchdogs, arm
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read
from rs485bus.sim import SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding
from tests.bus.support import Drive, devices_of, drives, outcomes

SLOW = BusConfig(echo=False, reply_timeout=0.05)


def is_start(frame: bytes) -> bool:
    return frame[1:4] == bytes((16, 0, r.MOVE_TO_COUNTS.address))


def begin(rig: Rig, drive: Drive, slot: BurstSlot) -> Job:
    return rig.submit(
        drive.start(), repeat=r.MOVE_TO_COUNTS.repeat, moves=True, motion=drive.attached.motion, slot=slot
    )


def burst(rig: Rig, made: list[Drive]) -> list[Job]:
    """The starts of these drives, as one, the last one first."""
    one = Burst(len(made))
    return [begin(rig, drive, BurstSlot(one, place)) for place, drive in reversed(list(enumerate(made)))][::-1]


def deafen(drive: Drive, heard: Callable[[bytes], bool]) -> None:
    """It does not hear what is not to be heard."""
    receive = drive.sim.receive
    drive.sim.receive = lambda frame, now: receive(frame, now) if heard(frame) else None  # type: ignore[method-assign]


def arm_all(rig: Rig, timeout: float) -> None:
    devices = devices_of(rig)
    admit_watchdogs(rig.owner, devices, timeout)
    failed: list[list[Job]] = []
    rig.owner.start(arm(rig.owner, devices, timeout), failed.append)
    rig.run(1.0, lambda: bool(failed))
    assert failed == [[]]
    rig.sent.clear()


def test_nothing_comes_between_the_frames_of_a_burst_and_they_go_in_their_order() -> None:
    rig = Rig()
    made = drives(rig, 4)
    waiting = [
        rig.submit(read(1 + at % 4, r.PULSES), urgency=urgency)
        for urgency in (Urgency.COMMAND, Urgency.POLL)
        for at in range(20)
    ]
    rig.run(0.02)
    rig.sent.clear()
    starts = burst(rig, made)
    rig.done(*starts, *waiting)
    sent = [frame for _, frame in rig.sent]
    first = next(at for at, frame in enumerate(sent) if is_start(frame))
    assert [frame[0] for frame in sent[first : first + 4] if is_start(frame)] == [1, 2, 3, 4]
    assert first <= 1  # it went before what waited


def test_a_burst_does_not_begin_before_all_of_it_waits_and_keeps_nobody_from_the_wire_meanwhile() -> None:
    rig = Rig()
    made = drives(rig, 2)
    one = Burst(2)
    first = begin(rig, made[0], BurstSlot(one, 0))
    asked = rig.submit(read(1, r.PULSES))
    rig.done(asked)
    rig.run(1.0)
    assert first.outcome is None
    rig.done(first, begin(rig, made[1], BurstSlot(one, 1)))
    assert first.outcome is Outcome.REPLY


def test_a_burst_waits_as_a_whole_for_a_late_reply_that_one_of_them_could_be_answered_by() -> None:
    rig = Rig(config=SLOW)
    made = drives(rig, 2)
    deafen(made[1], lambda frame: not is_start(frame))
    rig.done(made[1].move(rig))  # its reply is owed for a while now
    rig.owner.units[2].probe = False  # and it is asked nothing instead
    made[1].sim.receive = type(made[1].sim).receive.__get__(made[1].sim)  # type: ignore[method-assign]
    rig.sent.clear()
    starts = burst(rig, made)
    rig.done(*starts)
    begun = [at for at, frame in rig.sent if is_start(frame)]
    assert len(begun) == 2
    assert begun[1] - begun[0] < 0.02
    assert begun[0] > 100.6


def test_a_stop_interrupts_a_burst_and_what_was_not_sent_of_it_never_is() -> None:
    rig = Rig()
    made = drives(rig, 4)
    starts = burst(rig, made)
    rig.run(1.0, lambda: starts[0].outcome is not None)
    made[2].stop(rig)
    rig.done(*starts)
    assert outcomes(starts) == [Outcome.REPLY, Outcome.NOT_SENT, Outcome.NOT_SENT, Outcome.NOT_SENT]
    assert [job.reason for job in starts[1:]] == [Reason.BROKEN_OFF, Reason.STOPPED, Reason.BROKEN_OFF]
    rig.run(1.0)
    assert [drive.sim.moving(rig.now) for drive in made] == [True, False, False, False]


def test_a_burst_of_which_one_may_not_go_does_not_begin() -> None:
    rig = Rig()
    made = drives(rig, 3)
    rig.owner.units[3].locked = "it was stopped for safety"
    starts = burst(rig, made)
    assert outcomes(starts) == [Outcome.NOT_SENT] * 3
    assert not any(is_start(frame) for _, frame in rig.sent)


def test_a_burst_in_which_one_is_refused_ends_there() -> None:
    rig = Rig()
    made = drives(rig, 3)
    made[1].sim.motion.enabled = False
    starts = burst(rig, made)
    rig.done(*starts)
    assert outcomes(starts) == [Outcome.REPLY, Outcome.REFUSED, Outcome.NOT_SENT]


def test_a_frame_of_a_burst_that_is_not_answered_is_not_repeated_and_the_others_go_on() -> None:
    rig = Rig(config=SLOW)
    made = drives(rig, 3)
    deafen(made[0], lambda frame: not is_start(frame))
    starts = burst(rig, made)
    rig.done(*starts)
    assert outcomes(starts) == [Outcome.UNKNOWN, Outcome.REPLY, Outcome.REPLY]
    assert [frame[0] for _, frame in rig.sent if is_start(frame)] == [1, 2, 3]


def test_a_burst_longer_than_armed_watchdogs_can_wait_for_is_refused_before_anything_moves() -> None:
    rig = Rig(config=BusConfig(echo=False, reply_timeout=0.03, turnaround=0.02))
    made = drives(rig, 8)
    arm_all(rig, 0.3)
    starts = burst(rig, made)
    rig.done(*starts)
    assert [job.reason for job in starts] == [Reason.BURST_TOO_LONG] + [Reason.BROKEN_OFF] * 7
    rig.run(1.0)
    assert not any(is_start(frame) for _, frame in rig.sent)
    assert not any(drive.interruptions for drive in made)


@pytest.mark.parametrize("wait", [0.05, 0.1, 0.12, 0.14, 0.15, 0.16])
def test_a_burst_of_which_nothing_is_answered_lets_watchdogs_be_fed_in_time(wait: float) -> None:
    # Watched devices are fed together: how long they were unheard depends on when the burst comes.
    rig = Rig(config=SLOW)
    made = drives(rig, 8)
    arm_all(rig, 0.5)
    for drive in made:
        deafen(drive, lambda frame: not is_start(frame))
    rig.run(wait)
    starts = burst(rig, made)
    rig.done(*starts)
    rig.run(2.0)
    assert not any(drive.interruptions for drive in made)
    assert not any(drive.sim.trips for drive in made)


@pytest.mark.parametrize("how", ["unplugged", "closed"])
def test_a_burst_ends_with_the_port(how: str) -> None:
    rig = Rig()
    made = drives(rig, 2)
    rig.submit(read(1, r.PULSES))
    starts = burst(rig, made)
    getattr(rig.owner, "unplugged" if how == "unplugged" else "close")(rig.now)
    assert outcomes(starts) == [Outcome.NOT_SENT] * 2


def test_who_waits_for_stops_to_be_on_the_wire_is_told_when_the_last_one_is() -> None:
    rig = Rig()
    made = drives(rig, 3)
    rig.done(*(drive.move(rig) for drive in made))
    rig.submit(read(1, r.PULSES))
    rig.run(0.0)
    rig.sent.clear()
    told: list[int] = []
    for drive in made:
        drive.stop(rig)
    rig.owner.after_stops(lambda: told.append(sum(frame[1:4] == b"\x06\x00\xf7" for _, frame in rig.sent)))
    rig.run(1.0)
    assert told == [2]  # in the tick that hands out the third


def test_what_is_asked_for_as_a_start_but_alone_goes_out_as_a_command() -> None:
    rig = Rig(SimUnit(9, {0: 1}))
    job = rig.submit(read_holding(9, 0, 1), urgency=Urgency.START)
    rig.done(job)
    assert job.outcome is Outcome.REPLY
