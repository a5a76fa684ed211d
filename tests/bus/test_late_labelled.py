"""Frames that are labelled with the request they answer: nobody is ever given another one's, whatever comes late.

A line that is made of plain calls: for every frame that the owner sends, a plan says what comes back and when. So it is
known of each frame whose it is, also where its bytes do not tell.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rs485bus.bus.config import BusConfig
from rs485bus.bus.owner import Owner
from rs485bus.bus.schedule.job import Job, Outcome
from rs485bus.wire.crc import crc
from rs485bus.wire.frames import Request, read_holding, read_input, registers, write_multiple, write_single
from rs485bus.wire.registers import Repeat
from rs485bus.wire.timing import LineSettings

FAST = LineSettings(baudrate=115200)


@dataclass(frozen=True)
class Reply:
    """One reply to a frame."""

    after: float = 0.002
    """Seconds from the end of the frame."""
    code: int = 0
    """An exception; 0 for a normal reply, -1 for a refusal inside one."""
    again: float | None = None
    """Seconds after which it comes once more."""


class LabelledLine:
    """An owner, and replies by plan.

    Args:
        plans: what comes back for each frame in turn; then each is answered at once.
        gateway: replies may overtake each other. Where there is none, the device answers in order.
        tells: whether the reads answered differ.
    """

    def __init__(
        self, plans: Sequence[Reply | None], *, gateway: bool = False, tells: bool = False, **config: object
    ) -> None:
        self.now = 100.0
        settings = BusConfig(echo=False, reply_timeout=0.03, offline_after=100, **config)  # type: ignore[arg-type]
        self.owner = Owner(FAST, settings, self.now - 1, gateway=gateway)
        self.in_order = not gateway
        self.tells = tells
        self.sent: list[tuple[float, bytes]] = []
        self.wrong: list[str] = []
        self.jobs: list[Job] = []
        self._plans: Iterator[Reply | None] = iter(plans)
        self._calls: list[tuple[float, int, Callable[[], object]]] = []
        self._number = itertools.count()
        self._label: Job | None = None
        self._free_at = 0.0
        self._serial = 0

    def at(self, when: float, call: Callable[[], object]) -> None:
        heapq.heappush(self._calls, (when, next(self._number), call))

    def submit(self, request: Request, **options: object) -> Job:
        job = Job(request, on_end=self._ended, **options)  # type: ignore[arg-type]
        self.jobs.append(job)
        self.owner.submit(job, self.now)
        return job

    def run(self, seconds: float = 60.0) -> None:
        end = self.now + seconds
        self._tick()
        while (following := min(self.owner.wake, self._calls[0][0] if self._calls else end)) < end:
            self.now = max(self.now, following)
            while self._calls and self._calls[0][0] <= self.now:
                heapq.heappop(self._calls)[2]()
            self._tick()
        self.now = end

    def _tick(self) -> None:
        frame = self.owner.tick(self.now)
        if frame is None:
            return
        self.sent.append((self.now, frame))
        job = self.owner.pair.job
        plan = next(self._plans, Reply())
        if plan is None or job is None:
            return
        reply = self._reply(job.request, plan.code)
        at = self.owner.send_at + FAST.airtime(len(frame)) + plan.after
        if self.in_order:
            at = self._free_at = max(at, self._free_at + 0.002)
        self.at(at, lambda: self._arrive(reply, job, plan.again))

    def _reply(self, request: Request, code: int) -> bytes:
        self._serial += 1
        if code > 0:
            body = bytes((request.address, request.function | 0x80, code))
        elif code < 0 and request.refusal is not None:
            body = request.refusal
        elif request.writes:
            body = request.prefix
        else:
            told = self._serial if self.tells else 7
            body = request.prefix + told.to_bytes(request.length - 5, "big")
        return body + crc(body)

    def _arrive(self, reply: bytes, job: Job, again: float | None) -> None:
        if again is not None:
            until, sent = self._owed_until(job.request, None), len(self.sent)
            self.at(self.now + again, lambda: self._copy(reply, job, until, sent))
        self._deliver(reply, job)

    def _copy(self, reply: bytes, job: Job, until: float, sent: int) -> None:
        # Once a frame was sent, only what was owed before lets anybody know that there is a copy still to come.
        known = self.now < until and self._owed_until(job.request, self.owner.pair.job)
        if len(self.sent) == sent or known:
            self._deliver(reply, job)

    def _owed_until(self, request: Request, but: Job | None) -> float:
        late = self.owner.units[request.address].late
        late.expire(self.now)
        return late.must_wait(request, but)

    def _deliver(self, reply: bytes, job: Job) -> None:
        self._label = job
        self.owner.feed(reply, self.now)
        self._label = None

    def _ended(self, job: Job) -> None:
        if job.outcome in (Outcome.REPLY, Outcome.REFUSED) and self._label is not job:
            self.wrong.append(f"{job.request} was given another's answer at {self.now:.3f}")


ONCE = {"retries": 0}


# In order


def test_a_reply_that_comes_twice_settles_one_that_is_owed() -> None:
    """Two attempts were not answered. The first one's reply comes twice; the second one's comes later."""
    line = LabelledLine([Reply(0.2, again=0.01), Reply(0.3)], retries=1)
    line.submit(read_holding(1, 0, 1))
    line.run(0.15)
    line.submit(read_holding(1, 8, 1), repeat=Repeat.NEVER)
    line.run()
    assert line.wrong == []
    assert [job.outcome for job in line.jobs] == [Outcome.NO_REPLY, Outcome.REPLY]


def test_a_copy_that_answers_who_waits_for_nothing_leaves_all_that_is_owed_owed() -> None:
    """What looks whether an axis stands does not wait for what is owed; it asks when the answer can have been given."""
    line = LabelledLine([Reply(0.1, again=0.05), Reply(0.25), Reply(0.3)], retries=1)
    line.submit(read_holding(1, 0, 1))
    line.run(0.14)
    look = line.submit(read_holding(1, 0, 1), ignores_late_replies=True, retries=0)
    line.run(0.02)
    assert look.outcome is Outcome.REPLY
    assert look.answered_since < 100.01
    fresh = line.submit(read_holding(1, 8, 1), repeat=Repeat.NEVER)
    line.run()
    assert fresh.sent_at > 100.44


def test_an_exception_that_comes_twice_decides_nothing_the_second_time() -> None:
    line = LabelledLine([Reply(0.06, code=2, again=0.001), Reply(0.025)], **ONCE)
    line.submit(read_holding(1, 0, 3))
    line.run(0.045)
    second = line.submit(read_holding(1, 0, 2))
    line.run()
    assert line.wrong == []
    assert second.outcome is Outcome.REPLY


def test_an_exception_that_decided_nothing_ends_the_waiting_for_the_oldest_that_it_fits() -> None:
    """Either that was the oldest one's, or what is older will not come any more. So the next attempt is decided."""
    line = LabelledLine([None, Reply(code=2), Reply(code=2)], retries=1)
    line.submit(read_holding(1, 0, 3), retries=0)
    line.run(0.035)
    refused = line.submit(read_holding(1, 0, 2))
    line.run()
    assert (refused.outcome, refused.attempts) == (Outcome.REFUSED, 2)
    assert line.wrong == []


def test_a_unit_that_answers_by_exceptions_is_not_offline() -> None:
    line = LabelledLine([None, *[Reply(code=2)] * 20], retries=0)
    line.owner.config = BusConfig(echo=False, retries=0, offline_after=3)
    for count in range(1, 9):
        line.submit(read_holding(1, 0, count))
    line.run(0.6)
    assert not line.owner.units[1].reach.offline
    assert line.wrong == []


def test_a_late_refusal_of_one_value_ends_the_waiting_of_the_oldest_that_it_fits() -> None:
    """MKS drives refuse every value of a register by the same frame."""
    line = LabelledLine([None, Reply(0.2, code=-1)], **ONCE)
    line.submit(write_single(1, 5, 7, hidden_refusal=True), repeat=Repeat.NEVER)
    second = line.submit(write_single(1, 5, 8, hidden_refusal=True), repeat=Repeat.NEVER)
    line.run(0.3)
    assert [owed.job for owed in line.owner.units[1].late] == [second]
    assert line.wrong == []


# Behind a gateway


def test_reads_that_wait_together_behind_a_gateway_that_stalls_get_their_own_answers() -> None:
    """It stalls for 1.5 s and then answers everything."""
    stalled = 101.5
    line = LabelledLine([], gateway=True, retries=2)
    line._plans = iter(lambda: Reply(max(0.002, stalled - line.now)), None)
    for register in range(30, 36):
        line.submit(read_holding(1, register, 1))
    line.submit(read_holding(1, 0, 2))
    line.run()
    assert line.wrong == []
    assert line.jobs[0].outcome is Outcome.NO_REPLY
    assert [job.outcome for job in line.jobs[1:6]] == [Outcome.REPLY] * 5


def test_behind_a_gateway_a_late_exception_settles_nothing_where_two_may_have_sent_it() -> None:
    line = LabelledLine([Reply(2.0), Reply(0.1, code=2)], gateway=True, **ONCE)
    line.submit(read_holding(1, 30, 1), repeat=Repeat.NEVER)
    line.submit(read_holding(1, 32, 2), repeat=Repeat.NEVER)
    line.run(1.0)
    line.submit(read_holding(1, 40, 1), repeat=Repeat.NEVER)
    line.run()
    assert line.wrong == []
    assert line.jobs[2].sent_at > 102.0


def test_behind_a_gateway_a_late_exception_settles_the_only_one_that_may_have_sent_it() -> None:
    line = LabelledLine([Reply(0.1, code=2)], gateway=True, **ONCE)
    line.submit(read_holding(1, 30, 1))
    line.run(0.2)
    fresh = line.submit(read_holding(1, 30, 1))
    line.run(0.2)
    assert fresh.outcome is Outcome.REPLY


def test_a_gateway_that_says_that_the_unit_did_not_answer_settles_nothing() -> None:
    line = LabelledLine([Reply(2.0), None], gateway=True, **ONCE)
    line.submit(read_holding(1, 30, 1))
    line.run(0.2)
    for code in (10, 11):
        body = bytes((1, 0x83, code))
        line.owner.feed(body + crc(body), line.now)
    waiting = line.submit(read_holding(1, 32, 1))
    line.run()
    assert waiting.sent_at > 102.0


@pytest.mark.parametrize(("code", "gateway"), [(2, True), (11, False)])
def test_an_exception_that_decides_nothing_settles_nothing_where_it_may_be_the_later_ones(
    code: int, gateway: bool
) -> None:
    """Behind a gateway it may be; and where a gateway sent it, the older one's reply may still come."""
    line = LabelledLine([Reply(0.3), Reply(code=code), None], gateway=gateway, **ONCE)
    line.in_order = False
    line.submit(read_holding(1, 30, 1))
    line.run(0.05)
    line.submit(read_holding(1, 0, 2))
    line.run(0.1)
    waiting = line.submit(read_holding(1, 32, 1))
    line.run()
    assert waiting.sent_at > 100.3


def test_behind_a_gateway_a_late_refusal_settles_nothing_where_two_values_may_have_been_refused() -> None:
    line = LabelledLine([Reply(2.0), Reply(0.1, code=-1), None], gateway=True, **ONCE)
    line.submit(write_single(1, 5, 7, hidden_refusal=True), repeat=Repeat.NEVER)
    line.submit(write_single(1, 5, 8, hidden_refusal=True), repeat=Repeat.NEVER)
    line.run(1.0)
    again = line.submit(write_single(1, 5, 7, hidden_refusal=True), repeat=Repeat.NEVER)
    line.run()
    assert line.wrong == []
    assert again.sent_at > 102.0


def test_behind_a_gateway_replies_may_come_for_five_seconds_unless_the_configuration_says_otherwise() -> None:
    for config, window in (({}, 5.0), ({"late_reply_window": 0.2}, 0.2), ({"late_reply_window": 8}, 8)):
        line = LabelledLine([None], gateway=True, **ONCE, **config)
        line.submit(read_holding(1, 0, 1))
        line.run(0.05)
        waiting = line.submit(read_holding(1, 0, 1))
        line.run()
        assert waiting.sent_at == pytest.approx(line.jobs[0].ended_at + window, abs=0.01)
    assert BusConfig().late_reply_window == 0.5


# Whatever comes

requests = st.sampled_from(
    [
        read_holding(1, 30, 1),
        read_holding(1, 32, 1),
        read_holding(1, 0, 2),
        read_input(1, 0, 1),
        read_holding(2, 30, 1),
        write_single(1, 5, 7, hidden_refusal=True),
        write_single(1, 5, 8, hidden_refusal=True),
        write_single(1, 5, 0xFFFF),
        write_multiple(1, 5, [1, 2]),
    ]
)
repeats = st.sampled_from([Repeat.SAFE, Repeat.NEVER])
askings = st.lists(st.tuples(st.sampled_from([0.0, 0.01, 0.05, 0.2, 0.6]), requests, repeats), min_size=2, max_size=10)
codes = st.sampled_from([0, 0, 0, -1, 2, 3, 11])


def plans(*delays: float) -> st.SearchStrategy[list[Reply | None]]:
    reply = st.builds(
        Reply, st.sampled_from((0.002, 0.002, *delays)), codes, st.sampled_from([None, None, 0.0, 0.003, 0.03, 0.2])
    )
    return st.lists(st.one_of(st.none(), reply, reply), max_size=16)


def judge(line: LabelledLine, asked: list[tuple[float, Request, Repeat]]) -> None:
    at = line.now
    for after, request, repeat in asked:
        at += after
        line.at(at, lambda request=request, repeat=repeat: line.submit(request, repeat=repeat))  # type: ignore[misc]
    line.run(300)
    assert line.wrong == []
    assert len(line.jobs) == len(asked)
    assert all(job.outcome is not None for job in line.jobs)


@settings(max_examples=300, deadline=None)
@given(askings, plans(0.04, 0.07, 0.2, 0.4), st.booleans())
def test_in_order_nobody_is_given_another_ones_answer(
    asked: list[tuple[float, Request, Repeat]], planned: list[Reply | None], tells: bool
) -> None:
    judge(LabelledLine(planned, tells=tells), asked)


@settings(max_examples=300, deadline=None)
@given(askings, plans(0.04, 0.07, 0.2, 0.4, 1.5, 4.5), st.booleans())
def test_behind_a_gateway_nobody_is_given_another_ones_answer(
    asked: list[tuple[float, Request, Repeat]], planned: list[Reply | None], tells: bool
) -> None:
    judge(LabelledLine(planned, gateway=True, tells=tells), asked)


def test_the_line_tells_whose_answer_it_was() -> None:
    """The judge itself: an owner that forgets what is owed is found out."""
    line = LabelledLine([Reply(0.2), None], **ONCE)
    line.submit(read_holding(1, 30, 1))
    line.run(0.185)
    line.owner.units[1].late.owed.clear()
    job = line.submit(read_holding(1, 32, 1))
    line.run()
    assert len(line.wrong) == 1
    assert registers(job.reply) == [7]
