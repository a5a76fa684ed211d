"""On a line that is never quiet stops go out all the same, and everything else ends and says why."""

import itertools
import random
from collections.abc import Callable, Iterator

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.failure import failure
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.watchdog.guarding import emergency_stop
from rs485bus.devices.mks import registers as r
from rs485bus.devices.mks.frames import read, write
from rs485bus.errors import LineBusy, NotSent
from rs485bus.sim import SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import Request, read_holding, write_single
from rs485bus.wire.registers import Repeat
from rs485bus.wire.timing import LineSettings
from tests.bus.support import BANK, Deaf, Drive, Scripted
from tests.bus.test_stops import is_stop, running


def bytes_without_end(seed: int, gaps_every: float = float("inf")) -> Iterator[float]:
    """A byte every 0.5 to 1.6 ms; and now and then a gap of 3 to 6 ms."""
    rng = random.Random(seed)
    since = 0.0
    while True:
        gap = since > gaps_every * rng.uniform(0.5, 1.5)
        interval = rng.uniform(0.003, 0.006) if gap else rng.uniform(0.0005, 0.0016)
        since = 0.0 if gap else since + interval
        yield interval


def noisy(rig: Rig, *, seed: int = 0, gaps_every: float = float("inf"), for_: float = float("inf")) -> None:
    """There is noise from now on, for so many seconds."""
    end = rig.now + for_
    intervals = bytes_without_end(seed, gaps_every)
    rig.pair.babble(itertools.takewhile(lambda _: rig.now < end, intervals), rig.now)
    rig.run(min(0.25, for_ / 2))
    rig.sent.clear()


def stopped(rig: Rig, drive: Drive, emergency: bool = False) -> list[float]:
    """Stop a drive; the times after which the outcome was told."""
    begun, told = rig.now, []
    drive.stop(rig, emergency=emergency).listen(lambda _: told.append(rig.now - begun))
    return told


REQUESTS: dict[str, Callable[[], tuple[Request, dict[str, object]]]] = {
    "a read": lambda: (read(1, r.VERSION), {}),
    "a poll": lambda: (read(1, r.VERSION), {"urgency": Urgency.POLL}),
    "a write": lambda: (write_single(1, 5, 7), {"repeat": Repeat.NEVER, "moves": True}),
    "a broadcast": lambda: (write_single(0, 5, 7), {"repeat": Repeat.NEVER, "moves": True}),
    "the bus' own": lambda: (read(1, r.VERSION), {"internal": True}),
}


@pytest.mark.parametrize("what", REQUESTS)
@pytest.mark.parametrize("timeout", [None, 0.3])
def test_what_is_no_stop_ends_within_its_time_or_a_second_and_says_what_to_look_for(
    what: str, timeout: float | None
) -> None:
    rig = Rig(SimUnit(1, BANK))
    noisy(rig)
    begun, ended = rig.now, []
    request, options = REQUESTS[what]()
    expires_at = None if timeout is None else begun + timeout
    job = rig.submit(request, **options, expires_at=expires_at, on_end=lambda _: ended.append(rig.now - begun))
    rig.run(2.0)
    assert (job.outcome, job.reason) == (Outcome.NOT_SENT, Reason.LINE_BUSY)
    assert rig.sent == []
    assert ended == [pytest.approx(timeout, abs=1e-6)] if timeout else 1.0 <= ended[0] < 1.02
    error = failure(job, [])
    assert isinstance(error, LineBusy)
    assert isinstance(error, NotSent)
    assert "never quiet" in str(error)
    assert "second master" in str(error)
    assert "another baud rate" in str(error)


def test_the_log_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    rig = Rig(SimUnit(1, BANK))
    noisy(rig)
    for _ in range(3):
        rig.done(*(rig.submit(read_holding(1, at, 1)) for at in range(50)))
    assert caplog.text.count("has not been quiet") == 1


def test_a_read_whose_repetition_waits_for_silence_ends_a_second_after_the_noise_began() -> None:
    rig = Rig(Deaf(1))
    begun = rig.now
    job = rig.submit(read_holding(1, 0, 1))
    noisy(rig)
    rig.done(job, within=2.0)
    assert rig.now - begun < 1.1
    assert (job.outcome, job.reason) == (Outcome.NO_REPLY, Reason.LINE_BUSY)
    assert "It was not sent again, the line was never quiet" in str(failure(job, []))


def test_noise_that_ends_in_time_ends_nothing() -> None:
    rig = Rig(SimUnit(1, BANK))
    noisy(rig, for_=0.9)
    jobs = [rig.submit(read_holding(1, at, 1)) for at in range(3)]
    rig.done(*jobs)
    assert [job.outcome for job in jobs] == [Outcome.REPLY] * 3
    assert rig.pair.early_frames == 0


def test_a_long_answer_on_a_slow_line_is_no_noise() -> None:
    rig = Rig(SimUnit(1, dict.fromkeys(range(125), 0)), line=LineSettings(baudrate=1200))
    jobs = [rig.submit(read_holding(1, 0, 125)) for _ in range(3)]
    stop = rig.submit(write_single(1, 5, 7), urgency=Urgency.STOP)
    rig.done(*jobs, stop)
    assert [job.outcome for job in jobs] == [Outcome.REPLY] * 3
    assert rig.pair.early_frames == rig.pair.collisions == 0


def test_an_answer_torn_on_a_slow_line_does_not_end_what_waits_behind_it() -> None:
    line = LineSettings(baudrate=1200)
    rig = Rig(Scripted(1, lambda reply: reply[:-3]), line=line, config=BusConfig(echo=False, retries=0))
    torn, job = rig.submit(read_holding(1, 0, 60)), rig.submit(read_holding(1, 0, 1))
    rig.done(torn, job)
    assert torn.outcome is Outcome.NO_REPLY
    assert job.reason is not Reason.LINE_BUSY


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("emergency", [False, True])
@pytest.mark.parametrize("gateway", [False, True])
def test_a_stop_is_on_the_wire_within_25_ms_and_said_to_be_unconfirmed_where_it_is_not_heard(
    seed: int, emergency: bool, gateway: bool
) -> None:
    rig = Rig(gateway=gateway)
    (drive,) = running(rig, 1)
    noisy(rig, seed=seed)
    begun = rig.now
    told = stopped(rig, drive, emergency)
    rig.run(1.5)
    stops = [at - begun for at, frame in rig.sent if is_stop(frame)]
    assert stops[0] < 0.025
    assert [halted.standing for halted in drive.halted] == [False]
    assert 1.0 <= told[0] < 1.3
    # Again and again, at changing moments; and even so our own frames do not follow upon each other too closely.
    assert len(stops) > 10
    pauses = {round(later - earlier, 3) for earlier, later in itertools.pairwise(stops)}
    assert len(pauses) > 3
    assert min(pauses) > rig.owner.pair.line.t35


@pytest.mark.parametrize("seed", range(5))
def test_a_drive_that_hunts_for_frames_hears_the_first_stop_over_noise_and_is_seen_to_stand(seed: int) -> None:
    rig = Rig(seed=seed)
    (drive,) = running(rig, 1)
    rig.pair.lenient = True
    noisy(rig, seed=seed)
    told = stopped(rig, drive)
    rig.run(1.0)
    assert [halted.standing for halted in drive.halted] == [True]
    assert told[0] < 0.4
    assert not drive.sim.moving(rig.now)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("emergency", [False, True])
def test_a_drive_that_frames_by_silence_is_stopped_in_the_gaps_and_seen_to_stand_within_a_second(
    seed: int, emergency: bool
) -> None:
    rig = Rig(seed=seed)
    (drive,) = running(rig, 1)
    noisy(rig, seed=seed, gaps_every=0.025)
    polls = [rig.submit(read(1, r.VERSION), urgency=Urgency.POLL) for _ in range(20)]
    begun = rig.now
    told = stopped(rig, drive, emergency)
    rig.run(1.0)
    assert next(at for at, frame in rig.sent if is_stop(frame)) - begun < 0.025
    assert [halted.standing for halted in drive.halted] == [True]
    assert told[0] < 1.0
    assert not drive.sim.moving(rig.now)
    rig.done(*polls)


def test_with_twelve_drives_each_is_told_to_stop_and_none_of_them_holds_up_another() -> None:
    rig = Rig()
    moving = running(rig, 12)
    rig.pair.lenient = True
    noisy(rig)
    reports: list[object] = []
    rig.owner.now = rig.now
    rig.owner.start(emergency_stop(rig.owner), reports.append)
    begun = rig.now
    rig.run(1.0)
    first = {frame[0]: at - begun for at, frame in reversed(rig.sent) if is_stop(frame)}
    assert first[0] < 0.025  # the broadcast
    assert max(first.values()) < 0.02 + 13 * 0.0125
    assert reports
    assert not any(drive.sim.moving(rig.now) for drive in moving)


def test_a_plain_stop_goes_out_over_noise_too_and_what_nobody_answers_is_said_to_be_unknown() -> None:
    unit = Scripted(1)
    rig = Rig(unit)
    noisy(rig)
    begun = rig.now
    job = rig.submit(write_single(1, 5, 7), urgency=Urgency.STOP, repeat=Repeat.NEVER)
    rig.done(job, within=0.3)
    assert rig.sent[0][0] - begun < 0.025
    assert job.outcome is Outcome.UNKNOWN


@pytest.mark.parametrize("baudrate", [9600, 115200])
def test_a_stop_does_not_wait_for_an_answer_that_noise_keeps_from_being_heard(baudrate: int) -> None:
    rig = Rig(Deaf(9), line=LineSettings(baudrate=baudrate), config=BusConfig(echo=False, reply_timeout=5.0))
    (drive,) = running(rig, 1)
    dead = rig.submit(read_holding(9, 0, 10))
    rig.run(0.009)
    begun = rig.now
    rig.pair.babble(bytes_without_end(1), rig.now)
    rig.run(0.005)
    stopped(rig, drive)
    rig.run(0.1)
    assert next(at for at, frame in rig.sent if is_stop(frame) and at > begun) - begun < 0.03
    assert dead.unanswered == 1


def test_an_answer_that_has_begun_is_awaited_by_a_stop_among_noise() -> None:
    rig = Rig(SimUnit(9, dict.fromkeys(range(125), 0)), line=LineSettings(baudrate=9600))
    (drive,) = running(rig, 1)
    rig.pair.babble(iter([0.0121, 0.0008]), rig.now)  # a byte or two before the answer
    job = rig.submit(read_holding(9, 0, 60))
    rig.run(0.04)
    stopped(rig, drive)
    rig.done(job)
    assert job.outcome is Outcome.REPLY


def test_reads_are_answered_again_as_soon_as_the_noise_is_over() -> None:
    rig = Rig(SimUnit(1, BANK))
    noisy(rig, for_=3.0)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    rig.run(3.0)
    job = rig.submit(read_holding(1, 0, 1))
    rig.done(job, within=0.02)
    assert job.outcome is Outcome.REPLY


def test_a_drive_that_is_silent_after_the_noise_is_over_is_not_asked_without_a_pause() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    noisy(rig, for_=0.5)
    drive.sim.receive = lambda frame, now: None  # type: ignore[method-assign]
    stopped(rig, drive)
    rig.run(3.0)
    rig.sent.clear()
    rig.run(5.0)
    assert sum(is_stop(frame) for _, frame in rig.sent) < 12


def test_a_broadcast_stop_of_the_family_goes_out_over_noise() -> None:
    rig = Rig()
    (drive,) = running(rig, 1)
    rig.pair.lenient = True
    noisy(rig)
    job = Job(write(0, r.EMERGENCY_STOP, 1), urgency=Urgency.STOP, internal=True, retries=0)
    begun = rig.now
    rig.owner.submit(job, rig.now)
    rig.done(job, within=0.05)
    assert rig.sent[0][0] - begun < 0.025
    rig.run(0.05)
    assert not drive.sim.moving(rig.now)
