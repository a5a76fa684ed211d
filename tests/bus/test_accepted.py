"""What a device has accepted only (exception 05) it may answer by itself later: that answers nothing else."""

from collections import deque

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Urgency
from rs485bus.sim.rig import Rig
from rs485bus.sim.treatment import PLAIN, Treatment
from rs485bus.wire.frames import Request, crc, read_holding, read_input, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from tests.bus.oracle import DEAF, FINE, LOST, Oracle, Step, does_and_says
from tests.bus.support import Drive

QUICK = BusConfig(echo=False, retries=0, reply_timeout=0.03, turnaround=0.02)
ACCEPTED = does_and_says(5)
BY_ITSELF = 0.1
"""Seconds after which the device answers what it has accepted."""

EQUAL = {
    "06": (write_single(1, 3, 7), write_single(1, 3, 7)),
    "16": (write_multiple(1, 3, [7, 8]), write_multiple(1, 3, [9, 10])),
    "03": (read_holding(1, 3, 2), read_holding(1, 5, 2)),
    "04": (read_input(1, 3, 2), read_input(1, 5, 2)),
}
"""Two requests whose answers look alike."""


def accepted(first: Request, *script: Step, gateway: bool, answers: bool = True) -> Rig:
    """A rig whose unit 1 has accepted a request, and answers it by itself some time later."""
    rig = Rig(Oracle(1, ACCEPTED, *script), Oracle(2), config=QUICK, gateway=gateway)
    job = rig.submit(first, repeat=Repeat.NEVER)
    rig.done(job)
    assert job.code == 5
    if answers:
        (asked_at, _), frame = rig.sent[0], Oracle(1).receive(first.adu, 0.0)
        assert frame is not None
        rig.at(asked_at + BY_ITSELF, lambda: rig.owner.feed(frame, rig.now))
    return rig


@pytest.mark.parametrize("gateway", [False, True])
@pytest.mark.parametrize("function", EQUAL)
def test_an_equal_request_waits_until_it_is_answered(function: str, gateway: bool) -> None:
    first, second = EQUAL[function]
    rig = accepted(first, LOST, gateway=gateway)
    job = rig.submit(second, repeat=Repeat.NEVER)
    rig.done(job)
    assert job.sent_at >= 100 + BY_ITSELF
    assert job.outcome is (Outcome.UNKNOWN if second.writes else Outcome.NO_REPLY)
    assert rig.owner.journal.unit(1).late_replies == 1


@pytest.mark.parametrize(("gateway", "window"), [(False, 0.5), (True, 5.0)])
def test_one_that_never_comes_is_waited_for_as_long_as_any_late_reply(gateway: bool, window: float) -> None:
    rig = accepted(EQUAL["06"][0], gateway=gateway, answers=False)
    job = rig.submit(EQUAL["06"][1], repeat=Repeat.NEVER)
    rig.done(job)
    assert window <= job.sent_at - 100 <= window + 0.1
    assert job.outcome is Outcome.REPLY


@pytest.mark.parametrize("gateway", [False, True])
def test_no_answer_to_anything_else_and_no_broadcast_ends_that_waiting(gateway: bool) -> None:
    """The device is at it for as long as it takes, whatever it is asked meanwhile."""
    rig = accepted(EQUAL["16"][0], FINE, FINE, DEAF, gateway=gateway)
    others = [rig.submit(read_holding(1, 0, 1)), rig.submit(write_single(0, 9, 1), repeat=Repeat.NEVER)]
    rig.done(*others)
    equal = rig.submit(EQUAL["16"][1], repeat=Repeat.NEVER)
    rig.done(equal)
    assert [job.outcome for job in others] == [Outcome.REPLY] * 2
    assert max(job.ended_at for job in others) < 100 + BY_ITSELF <= equal.sent_at
    assert equal.outcome is Outcome.UNKNOWN


def test_others_do_not_wait() -> None:
    rig = accepted(EQUAL["06"][0], gateway=True)
    others = [write_single(1, 4, 7), write_single(1, 3, 8), read_holding(1, 3, 1), write_single(2, 3, 7)]
    jobs = [rig.submit(request, repeat=Repeat.NEVER) for request in others]
    rig.done(*jobs)
    assert max(job.ended_at for job in jobs) < 100 + BY_ITSELF


@pytest.mark.parametrize("gateway", [False, True])
def test_a_stop_does_not_wait_for_it_nor_is_it_told_done_by_that_answer(gateway: bool) -> None:
    rig = accepted(EQUAL["06"][0], DEAF, gateway=gateway)
    stop: list[Job] = []
    rig.at(
        100 + BY_ITSELF - 0.005,
        lambda: stop.append(rig.submit(EQUAL["06"][1], urgency=Urgency.STOP, repeat=Repeat.NEVER)),
    )
    rig.run(1.0)
    assert stop[0].sent_at < 100 + BY_ITSELF
    assert stop[0].outcome is Outcome.UNKNOWN


def test_a_stop_of_the_bus_own_is_not_acknowledged_by_that_answer() -> None:
    """It may be that to the same frame, sent as a plain write before. The stop was lost, and is said again at once."""
    rig, drive = Rig(config=QUICK, gateway=True), Drive()
    rig.pair.devices.append(drive.sim)
    drive.attach(rig)
    [frame] = drive.attached.stops(drive.attached.motion, False)
    script = deque([PLAIN, Treatment(carried_out=False, code=5), Treatment(heard=False)])
    rig.pair.script = lambda _, now: script.popleft() if script else PLAIN
    rig.done(drive.move(rig))
    rig.done(rig.submit(frame, repeat=Repeat.NEVER))
    rig.run(0.3)
    halt, stopped_at = drive.stop(rig, emergency=False), rig.now
    rig.at(stopped_at + 0.01, lambda: rig.owner.feed(echo(frame), rig.now))
    rig.run(5.0, lambda: halt.stops == 2)
    assert rig.owner.journal.unit(1).late_replies == 0
    assert rig.now - stopped_at < 0.1


def echo(request: Request) -> bytes:
    """The reply to a write of a block."""
    return request.prefix + crc(request.prefix)
