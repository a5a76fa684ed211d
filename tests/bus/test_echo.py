"""An adapter that returns what is sent looks like a slave that agrees with everything. It is found out first."""

from typing import Literal

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.failure import failure
from rs485bus.bus.schedule.job import Outcome, Reason, Urgency
from rs485bus.sim import Noise, SimUnit
from rs485bus.sim.rig import Rig
from rs485bus.wire.crc import crc
from rs485bus.wire.frames import Request, public, read_holding, registers, write_multiple, write_single
from rs485bus.wire.functions import FileData, write_files
from rs485bus.wire.registers import Repeat
from tests.bus.support import BANK, Deaf, Scripted, outcomes

AUTO = BusConfig(retries=0)


def closed(body: bytes) -> bytes:
    return body + crc(body)


ECHO = Noise(echo=True)


def test_an_echoing_adapter_without_a_slave_never_looks_like_success() -> None:
    rig = Rig(Deaf(1), noise=ECHO, config=AUTO)
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    assert job.outcome is Outcome.UNKNOWN
    assert rig.owner.pair.exchange.echo is None  # what nobody answers is evidence of nothing
    assert rig.sent[0][1][1] == 3  # a read went first


@pytest.mark.parametrize("echo", [True, False])
def test_with_a_slave_reads_and_writes_work_echo_or_not(echo: bool) -> None:
    unit = SimUnit(1, BANK)
    rig = Rig(unit, noise=Noise(echo=echo), config=AUTO)
    jobs = [
        rig.submit(write_single(1, 3, 7)),
        rig.submit(write_multiple(1, 4, [8, 9])),
        rig.submit(read_holding(1, 3, 3)),
    ]
    rig.done(*jobs)
    assert outcomes(jobs) == [Outcome.REPLY] * 3
    assert registers(jobs[2].reply) == [7, 8, 9]
    assert rig.owner.pair.exchange.echo is echo
    assert rig.pair.early_frames == 0


def test_nothing_is_written_until_it_is_settled() -> None:
    rig = Rig(SimUnit(1, BANK), config=AUTO)
    write, read = rig.submit(write_single(1, 3, 7)), rig.submit(read_holding(2, 0, 1))
    rig.done(write, read)
    assert functions(rig) == [3, 3, 6]  # unit 2 is not there: that tells nothing
    assert write.outcome is Outcome.REPLY


def test_a_stop_goes_out_before_that_is_settled() -> None:
    rig = Rig(SimUnit(1, BANK), config=AUTO)
    stop = rig.submit(write_single(1, 3, 0), urgency=Urgency.STOP, ignores_late_replies=True)
    rig.done(stop)
    assert rig.sent[0][1] == stop.request.adu


def test_bytes_before_the_answer_leave_it_open() -> None:
    rig = Rig(SimUnit(1, BANK), noise=Noise(stray=1.0), config=AUTO)
    read = rig.submit(read_holding(1, 0, 1))
    rig.done(read)
    assert read.outcome is Outcome.REPLY
    assert rig.owner.pair.exchange.echo is None


def test_another_adapter_is_found_out_anew() -> None:
    rig = Rig(SimUnit(1, BANK), config=AUTO)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    assert rig.owner.pair.exchange.echo is False
    rig.owner.unplugged(rig.now)
    rig.owner.plugged(rig.now)
    assert rig.owner.pair.exchange.echo is None
    job = rig.submit(write_single(1, 3, 7))
    rig.done(job)
    assert job.outcome is Outcome.REPLY


def test_an_echo_that_is_seen_later_is_believed_the_second_time() -> None:
    rig = Rig(SimUnit(1, BANK), noise=ECHO, config=BusConfig(retries=0))
    rig.owner.pair.exchange.echo = False  # as if the first frame's echo had been lost in noise
    for verdict in (False, True):
        rig.done(rig.submit(read_holding(1, 4, 2)))
        assert rig.owner.pair.exchange.echo is verdict


def functions(rig: Rig) -> list[int]:
    """The functions of the frames sent."""
    return [frame[1] for _, frame in rig.sent]


class Dirty(SimUnit):
    """A unit whose replies have bytes before and behind them: a pair without bias."""

    def __init__(self, address: int, before: bytes = b"", behind: bytes = b"") -> None:
        super().__init__(address, BANK)
        self.before, self.behind = before, behind

    def receive(self, frame: bytes, now: float) -> bytes | None:
        reply = super().receive(frame, now)
        return None if reply is None else self.before + reply + self.behind


def without_its_first_byte(rig: Rig) -> Rig:
    """The adapter hears what it sends a little too late."""
    arrive = rig.pair._arrive
    rig.pair._arrive = lambda data, start, talk: arrive(data if talk else data[1:], start, talk)  # type: ignore[method-assign]
    return rig


def test_a_stray_byte_before_each_reply_leaves_the_question_open_for_two_reads_only() -> None:
    rig = Rig(Dirty(1, before=b"\0"), config=AUTO)
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    assert job.outcome is Outcome.REPLY
    assert functions(rig) == [3, 3, 6]
    assert rig.owner.pair.exchange.echo is False


@pytest.mark.parametrize("behind", [b"\0", b"\xff", b"\xff\0\xff"])
def test_bytes_behind_the_reply_say_nothing_of_what_stood_before_it(behind: bytes) -> None:
    rig = Rig(Dirty(1, behind=behind), config=AUTO)
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    assert job.outcome is Outcome.REPLY
    assert functions(rig) == [3, 6]


def test_an_echo_that_lost_its_first_byte_is_an_echo() -> None:
    rig = without_its_first_byte(Rig(SimUnit(1, BANK), noise=ECHO, config=AUTO))
    jobs = [rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER), rig.submit(write_multiple(1, 4, [8, 9]))]
    rig.done(*jobs)
    assert outcomes(jobs) == [Outcome.REPLY] * 2
    assert functions(rig) == [3, 3, 6, 16]
    assert rig.owner.pair.exchange.echo is True


def test_a_whole_echo_is_one_with_noise_behind_it() -> None:
    rig = Rig(Dirty(1, before=b"\0"), noise=ECHO, config=AUTO)
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    nobody = rig.submit(write_single(9, 3, 7), repeat=Repeat.NEVER)
    rig.done(job, nobody)
    assert outcomes([job, nobody]) == [Outcome.REPLY, Outcome.UNKNOWN]
    assert rig.owner.pair.exchange.echo is True


@pytest.mark.parametrize("verdict", [True, "auto"])
def test_an_echo_that_begins_like_the_answer_is_none(verdict: Literal["auto"] | bool) -> None:
    """Of some registers, the CRC of the answer is what stands in the write behind the same six bytes."""
    written = write_multiple(1, 4100, [0xC901, 5])
    assert closed(written.prefix) == written.adu[:8]
    rig = Rig(SimUnit(2, BANK), noise=ECHO, config=BusConfig(retries=0, echo=verdict))
    rig.done(rig.submit(read_holding(2, 0, 1)))
    job = rig.submit(written, repeat=Repeat.NEVER)
    rig.done(job)
    assert job.outcome is Outcome.UNKNOWN


@pytest.mark.parametrize("echo", [True, False])
def test_a_write_that_begins_like_its_answer_is_done_where_it_is_answered(echo: bool) -> None:
    rig = Rig(SimUnit(1, {0: 0, 4100: 0, 4101: 0}), noise=Noise(echo=echo), config=AUTO)
    job = rig.submit(write_multiple(1, 4100, [0xC901, 5]), repeat=Repeat.NEVER)
    rig.done(job)
    assert job.outcome is Outcome.REPLY


@pytest.mark.parametrize("echo", [True, False])
@pytest.mark.parametrize(
    "request_",
    [
        public(1, 8, bytes.fromhex("0000 12345678")),
        write_files(1, [FileData(4, 7, [0x06AF, 0x04BE])]),
        write_single(1, 3, 7),
    ],
)
def test_a_request_that_its_reply_repeats_is_done_and_tells_nothing(request_: Request, echo: bool) -> None:
    rig = Rig(Mirror(1), noise=Noise(echo=echo), config=AUTO)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    for _ in range(3):
        job = rig.submit(request_, repeat=Repeat.NEVER)
        rig.done(job)
        assert job.outcome is Outcome.REPLY
        assert rig.owner.pair.exchange.echo is echo


class Mirror(SimUnit):
    """A unit that repeats what it does not know."""

    def __init__(self, address: int) -> None:
        super().__init__(address, BANK)

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        return pdu if pdu[0] in (8, 21) else super().answer(pdu, now, broadcast=broadcast)


def test_a_broadcast_that_a_slave_answers_tells_nothing_and_waits_for_nothing() -> None:
    class Talkative(SimUnit):
        def receive(self, frame: bytes, now: float) -> bytes | None:
            super().receive(frame, now)
            return frame if frame[0] == 0 else None

    rig = Rig(Talkative(1, BANK), config=AUTO)
    job = rig.submit(write_single(0, 3, 7))
    rig.done(job)
    rig.run(1.0)
    assert functions(rig) == [6]
    assert rig.owner.pair.exchange.echo is None


def test_a_read_that_nobody_answers_tells_nothing_so_that_writes_to_nobody_are_not_done() -> None:
    rig = Rig(SimUnit(2, BANK), noise=ECHO, config=AUTO)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    jobs = [rig.submit(write_single(1, 3, value), repeat=Repeat.NEVER) for value in (7, 8)]
    rig.done(*jobs)
    assert outcomes(jobs) == [Outcome.UNKNOWN] * 2
    rig.done(rig.submit(read_holding(2, 0, 1)))
    assert rig.owner.pair.exchange.echo is True


def test_a_first_read_of_which_nothing_at_all_comes_back_settles_no_echo() -> None:
    """The adapter was not ready yet."""
    rig = Rig(config=AUTO)
    rig.done(rig.submit(read_holding(1, 0, 1)))
    rig.pair.noise = ECHO
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    assert job.outcome is Outcome.UNKNOWN


@pytest.mark.parametrize("noise", [ECHO, Noise()])
def test_where_nobody_is_there_a_write_goes_after_three_reads(noise: Noise) -> None:
    rig = Rig(noise=noise, config=AUTO)
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    rig.run(5.0)
    assert job.outcome is Outcome.UNKNOWN
    assert functions(rig) in ([3, 4, 3, 6], [3, 4, 3, 6, 4])
    assert job.sent_at < 100.4


class Sleeping(SimUnit):
    """A unit that answers nothing until it is told to."""

    def __init__(self, address: int) -> None:
        super().__init__(address, BANK)
        self.awake = False

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        self.awake = self.awake or pdu[0] == 6
        return super().answer(pdu, now, broadcast=broadcast) if self.awake else None


@pytest.mark.parametrize("echo", [True, False])
@pytest.mark.parametrize("repeat", [Repeat.NEVER, Repeat.SAFE])
def test_what_may_be_an_echo_is_known_once_the_unit_answers_a_read(echo: bool, repeat: Repeat) -> None:
    unit = Sleeping(1)
    rig = Rig(unit, noise=Noise(echo=echo), config=AUTO)
    job = rig.submit(write_single(1, 3, 7), repeat=repeat)
    rig.done(job)
    assert job.outcome is Outcome.REPLY
    assert len(unit.writes) == 1
    assert not rig.owner.units[1].late or echo


@pytest.mark.parametrize("end", ["closed", "lost", "cancelled", "expired"])
def test_what_may_be_an_echo_ends_whatever_comes(end: str) -> None:
    rig = Rig(noise=ECHO, config=BusConfig())
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.SAFE, expires_at=rig.now + 0.5)
    rig.run(within := 0.46)
    assert (job.attempts, job.outcome, job.read_back is not None) == (1, None, True)
    if end == "closed":
        rig.owner.close(rig.now)
    elif end == "lost":
        rig.owner.unplugged(rig.now)
    elif end == "cancelled":
        rig.owner.cancel(job, rig.now)
    rig.run(within)
    assert job.outcome in (Outcome.UNKNOWN, Outcome.NO_REPLY)
    assert len([frame for frame in functions(rig) if frame == 6]) == 1


def test_a_write_to_who_is_there_does_not_become_unknown_because_others_are_not() -> None:
    rig = Rig(SimUnit(5, BANK), config=AUTO)
    dead = [rig.submit(write_single(unit, 3, 7), repeat=Repeat.NEVER) for unit in (1, 2, 3)]
    live = rig.submit(write_single(5, 3, 7), repeat=Repeat.NEVER)
    rig.done(live, *dead)
    assert live.outcome is Outcome.REPLY
    assert outcomes(dead) == [Outcome.UNKNOWN] * 3
    assert functions(rig)[:4] == [3] * 4


def test_polls_that_nobody_answers_keep_no_write_waiting() -> None:
    rig = Rig(SimUnit(5, BANK), config=BusConfig(retries=0, offline_after=100))

    def poll(job: object = None) -> None:
        rig.submit(read_holding(1, 0, 1), on_end=poll, ignores_late_replies=True)

    poll()
    poll()
    rig.run(0.01)
    job = rig.submit(write_single(5, 3, 7), repeat=Repeat.NEVER)
    rig.done(job, within=0.5)
    assert job.outcome is Outcome.REPLY


def test_a_reply_that_comes_twice_is_no_echo() -> None:
    rig = Rig(Scripted(1, lambda reply: reply + reply), config=AUTO)
    rig.pair.devices[0].answer = lambda pdu, now, broadcast: pdu  # type: ignore[method-assign]
    rig.done(rig.submit(public(1, 8, bytes.fromhex("0000 1234"))))
    assert rig.owner.pair.exchange.echo is None


def test_an_answered_write_tells_nothing() -> None:
    rig = Rig(SimUnit(1, BANK), noise=ECHO, config=AUTO)
    rig.owner.pair.exchange.echo = False
    for _ in range(3):
        rig.done(rig.submit(write_multiple(1, 4, [8, 9])))
    assert rig.owner.pair.exchange.echo is False


def test_reads_that_are_answered_and_tell_nothing_do_not_go_out_for_ever() -> None:
    """A device that must not be read unasked is asked to repeat something."""
    rig = Rig(Mirror(1), noise=ECHO, config=AUTO)
    rig.owner.units[1].probe = False
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job, within=1.0)
    assert functions(rig) == [8, 8, 8, 6]
    assert job.outcome is Outcome.REPLY


def test_what_nobody_answers_waits_for_nothing() -> None:
    rig = Rig(SimUnit(1, BANK), config=AUTO)
    rig.done(rig.submit(public(1, 8, bytes.fromhex("0004 0000"))))
    assert functions(rig) == [8]


def test_a_device_of_input_registers_alone_answers_the_second_read() -> None:
    class Inputs(SimUnit):
        def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
            return None if pdu[0] == 3 else super().answer(pdu, now, broadcast=broadcast)

    rig = Rig(Inputs(1, BANK), config=AUTO)
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    assert functions(rig) == [3, 4, 6]
    assert job.outcome is Outcome.REPLY


def test_an_exception_answers_a_read_too() -> None:
    rig = Rig(SimUnit(1, {3: 0}), config=AUTO)
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    assert functions(rig) == [3, 6]
    assert job.outcome is Outcome.REPLY


def test_a_reply_that_may_be_an_older_ones_tells_nothing() -> None:
    """It may have come before the echo: an adapter hands on its bytes only some milliseconds later."""
    rig = Rig(noise=ECHO, config=BusConfig(retries=1, reply_timeout=0.03))
    job = rig.submit(read_holding(1, 0, 1))
    rig.run(0.034)
    assert job.attempts == 2
    rig.owner.feed(closed(b"\x01\x03\x02\x00\x07"), rig.now)
    assert job.outcome is Outcome.REPLY
    assert rig.owner.pair.exchange.echo is None


def test_a_device_that_is_left_alone_is_not_asked() -> None:
    rig = Rig(SimUnit(1, BANK), config=AUTO)
    rig.owner.units[1].silent_until = rig.now + 1.0
    job = rig.submit(write_single(1, 3, 7), repeat=Repeat.NEVER)
    rig.done(job)
    assert rig.sent[0][0] >= 101.0
    assert job.outcome is Outcome.REPLY


def test_a_write_whose_time_is_over_before_that_is_known_says_so() -> None:
    rig = Rig(config=BusConfig(retries=0, reply_timeout=2.0))
    job = rig.submit(write_single(1, 3, 7), expires_at=rig.now + 3.0)
    rig.done(job)
    assert (job.outcome, job.reason) == (Outcome.NOT_SENT, Reason.ECHO)
    assert "before it was known whether the adapter returns what is sent" in str(failure(job, []))
    assert "echo=False" in str(failure(job, []))
