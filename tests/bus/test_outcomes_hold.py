"""Whatever becomes of frames and answers: the outcome that is told of a write is what happened to it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.schedule.verification import holds
from rs485bus.bus.units.motion import Motion
from rs485bus.sim.rig import Rig
from rs485bus.wire.frames import read_holding, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from tests.bus.oracle import FINE, Oracle, Step
from tests.bus.support import drives

NOT_DONE = (1, 2, 3, 6)
MAYBE_DONE = (4, 5, 7, 8, 10, 11, 0x80)

FATES = [
    FINE,
    Step(heard=False),
    Step(answered=False),
    Step(done=False, answered=False),
    *(Step(after=after) for after in (0.03, 0.07, 0.2)),
    *(Step(done=False, code=code, after=after) for code in NOT_DONE for after in (None, 0.2)),
    *(Step(done=done, code=code) for code in MAYBE_DONE for done in (True, False)),
    Step(code=5, after=0.2),
    Step(code=11, after=0.07),
]
"""What may become of a frame, of a device that says 01, 02, 03 and 06 only where it did nothing."""

steps = st.sampled_from(FATES)


@dataclass(frozen=True)
class Asked:
    """One request of a scenario."""

    address: int
    size: int
    """Registers written; 0 for a read."""
    repeat: Repeat
    at: float
    urgency: Urgency
    timeout: float | None
    cancelled_after: float | None


asked = st.builds(
    Asked,
    st.sampled_from([1, 1, 1, 2]),
    st.sampled_from([0, 1, 1, 1, 2]),
    st.sampled_from(Repeat),
    st.sampled_from([0.0, 0.0, 0.01, 0.06, 0.3, 0.7]),
    st.sampled_from([Urgency.COMMAND, Urgency.POLL]),
    st.sampled_from([None, None, None, 0.02, 0.15, 0.5]),
    st.sampled_from([None, None, None, None, 0.03, 0.15]),
)


class Scenario:
    """Requests to two units that follow scripts, all with values of their own."""

    def __init__(self, requests: list[Asked], scripts: tuple[list[Step], list[Step]], gateway: bool) -> None:
        self.units = {address: Oracle(address, *script) for address, script in zip((1, 2), scripts, strict=True)}
        config = BusConfig(echo=False, reply_timeout=0.05)
        self.rig = Rig(*self.units.values(), config=config, gateway=gateway)
        self.motion = Motion()
        self.jobs: list[tuple[Job, tuple[int, ...]]] = []
        self.ended: list[Job] = []
        for number, request in enumerate(requests):
            self.rig.at(self.rig.now + request.at, lambda number=number, request=request: self._submit(number, request))  # type: ignore[misc]

    def _submit(self, number: int, asked: Asked) -> None:
        address, values = asked.address, tuple(1000 + 2 * number + at for at in range(asked.size))
        if not values:
            frame = read_holding(address, 3, 2)
        elif len(values) == 1:
            frame = write_single(address, 3, *values)
        else:
            frame = write_multiple(address, 3, values)
        job = Job(
            frame,
            urgency=asked.urgency,
            repeat=asked.repeat,
            moves=bool(values),
            motion=self.motion if values else None,
            verify=holds(address, 3, values) if values and asked.repeat is Repeat.VERIFY else None,
            expires_at=None if asked.timeout is None else self.rig.now + asked.timeout,
            on_end=self.ended.append,
        )
        self.jobs.append((job, values))
        self.rig.owner.submit(job, self.rig.now)
        if asked.cancelled_after is not None:
            self.rig.at(
                self.rig.now + asked.cancelled_after,
                lambda: self.rig.owner.cancel(job, self.rig.now) if job.outcome is None else None,
            )

    def stop(self) -> None:
        self.motion.stop()

    def unplug(self) -> None:
        self.rig.owner.unplugged(self.rig.now)
        self.rig.at(self.rig.now + 0.1, lambda: self.rig.owner.plugged(self.rig.now))

    def check(self) -> None:
        """Hold each outcome against what the units did."""
        assert sorted(map(id, self.ended)) == sorted(id(job) for job, _ in self.jobs), "each ends, once"
        for job, values in self.jobs:
            if not values:
                continue
            unit = self.units[job.address]
            done = unit.times_written(3, *values)
            said = f"{job.repeat} {job.outcome} {job.reason} code {job.code}, done {done} times"
            if job.outcome in (Outcome.REFUSED, Outcome.NOT_SENT):
                assert not done, said
            elif job.outcome is Outcome.REPLY:
                assert done == 1 if job.repeat is Repeat.NEVER else done >= 1, said
            if job.outcome is Outcome.NOT_SENT:
                assert not unit.was_sent(job.request), said
            if job.repeat is Repeat.NEVER:
                assert unit.was_sent(job.request) <= 1, said
            undisturbed = unit.is_plain and not self.rig.pair.collisions and job.reason is Reason.NONE
            assert not (job.outcome is Outcome.UNKNOWN and undisturbed), f"it could be known: {said}"


@pytest.mark.parametrize("gateway", [False, True])
@pytest.mark.parametrize("size", [1, 2])
@pytest.mark.parametrize("repeat", Repeat)
def test_no_outcome_of_one_write_is_false_whatever_becomes_of_its_first_two_frames(
    repeat: Repeat, size: int, gateway: bool
) -> None:
    for script in product(FATES, repeat=2):
        scenario = Scenario([Asked(1, size, repeat, 0.0, Urgency.COMMAND, None, None)], (list(script), []), gateway)
        scenario.rig.run(10.0)
        scenario.check()


@pytest.mark.parametrize("gateway", [False, True])
@pytest.mark.parametrize("repeat", Repeat)
@given(st.lists(steps, min_size=3, max_size=7), st.sampled_from([None, 0.02, 0.15, 0.5]))
def test_no_outcome_of_one_write_is_false(
    repeat: Repeat, gateway: bool, script: list[Step], timeout: float | None
) -> None:
    scenario = Scenario([Asked(1, 1, repeat, 0.0, Urgency.COMMAND, timeout, None)], (script, []), gateway)
    scenario.rig.run(10.0)
    scenario.check()


scenarios = st.builds(
    Scenario,
    st.lists(asked, min_size=1, max_size=6),
    st.tuples(st.lists(steps, min_size=2, max_size=12), st.lists(steps, max_size=6)),
    st.booleans(),
)


@given(scenarios, st.one_of(st.none(), st.sampled_from([0.03, 0.06, 0.12, 0.31])), st.sampled_from(["stop", "unplug"]))
def test_no_outcome_is_false(scenario: Scenario, when: float | None, what: str) -> None:
    if when is not None:
        scenario.rig.at(scenario.rig.now + when, scenario.stop if what == "stop" else scenario.unplug)
    scenario.rig.run(30.0)
    scenario.check()


@given(scenarios, st.sampled_from([0.03, 0.06, 0.12, 0.31]))
def test_nothing_that_moves_and_is_older_than_a_stop_is_sent_after_it(scenario: Scenario, when: float) -> None:
    rig = scenario.rig
    stopped: list[tuple[float, list[bytes]]] = []

    def stop() -> None:
        scenario.stop()
        stopped.append((rig.now, [job.request.adu for job, values in scenario.jobs if values]))

    rig.at(rig.now + when, stop)
    rig.run(30.0)
    ((at, older),) = stopped
    assert not [frame for sent_at, frame in rig.sent if sent_at > at and frame in older]


SILENCES = [FINE, Step(heard=False), Step(answered=False), *(Step(after=after) for after in (0.03, 0.07, 0.2))]


@pytest.mark.parametrize("gateway", [False, True])
@pytest.mark.parametrize("first", [Repeat.SAFE, Repeat.NEVER])
@pytest.mark.parametrize("second", [Repeat.SAFE, Repeat.NEVER])
def test_of_two_equal_writes_none_is_taken_for_the_other(first: Repeat, second: Repeat, gateway: bool) -> None:
    """So many were carried out as were reported, at least, each when it was; and no more than were sent."""
    for pause, script in product((0.0, 0.05, 0.1, 0.16, 0.2), product(SILENCES, repeat=3)):
        unit = Oracle(1, *script)
        rig = Rig(unit, config=BusConfig(echo=False, reply_timeout=0.05), gateway=gateway)
        jobs = [rig.submit(write_single(1, 3, 7), repeat=first)]
        rig.run(pause)
        jobs.append(rig.submit(write_single(1, 3, 7), repeat=second))
        rig.run(30.0)
        done = [at for at, _, _ in unit.writes]
        assert all(job.outcome is not None for job in jobs)
        assert sum(job.outcome is Outcome.REPLY for job in jobs) <= len(done) <= sum(job.attempts for job in jobs)
        for job in jobs:
            told = job.outcome is Outcome.REPLY
            assert not told or any(job.queued_at <= at <= job.ended_at for at in done), (pause, script)


@pytest.mark.parametrize("code", [*NOT_DONE, *MAYBE_DONE])
def test_a_drive_that_lies_about_a_refusal_may_move_until_it_is_seen_to_stand(code: int) -> None:
    rig = Rig()
    (drive,) = drives(rig, 1)
    rig.pair.devices[:] = [Oracle(1, Step(code=code))]
    rig.done(drive.move(rig))
    assert drive.attached.motion.may_move


def test_the_frames_of_a_scenario_keep_their_distance() -> None:
    """The oracle is not fooled by frames that are not understood."""
    scenario = Scenario(
        [Asked(1, 1, Repeat.SAFE, 0.01 * at, Urgency.COMMAND, None, None) for at in range(6)], ([], []), False
    )
    scenario.rig.run(5.0)
    assert scenario.rig.pair.early_frames == 0
    assert all(later - earlier > 0.001 for (earlier, _), (later, _) in pairwise(scenario.rig.sent))
