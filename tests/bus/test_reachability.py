"""A unit is taken for dead by evidence, is looked for by what it answers, and never for ever."""

import itertools
import random
from collections.abc import Callable

import pytest

from rs485bus.bus.config import BusConfig
from rs485bus.bus.schedule.job import Job, Outcome, Reason, Urgency
from rs485bus.bus.units.probing import AnsweredRequests, listening_time
from rs485bus.bus.units.reachability import LEAST, Loss, Reachability, longest_silence, share_lost
from rs485bus.sim import SimDevice, SimUnit
from rs485bus.sim.noise import Noise
from rs485bus.sim.rig import Rig
from rs485bus.wire.diagnostics import Diagnostic, diagnostic
from rs485bus.wire.frames import Request, crc, read_holding, read_input, write_single
from rs485bus.wire.functions import read_fifo
from tests.bus.support import BANK, drives
from tests.bus.test_offline import Switched, poll, throughput

SOME = read_holding(1, 0, 2)
FIRM = BusConfig(echo=False, reply_timeout=0.05)


class Odd(SimUnit):
    """A unit that answers as a function makes it: from the frame, and from the right reply."""

    def __init__(self, address: int, answers: Callable[[bytes, bytes | None], bytes | None]) -> None:
        super().__init__(address, BANK)
        self.answers = answers

    def receive(self, frame: bytes, now: float) -> bytes | None:
        reply = super().receive(frame, now)
        return self.answers(frame, reply) if frame[0] == self.address else None


def keep_asking(rig: Rig, *requests: Request, every: float = 0.0, log: list[Job] | None = None) -> list[Job]:
    """Ask these again and again, one after the other. The list of those that have ended grows."""
    ended: list[Job] = [] if log is None else log
    turn = itertools.cycle(requests)

    def ask() -> None:
        rig.owner.submit(Job(next(turn), on_end=again), rig.now)

    def again(job: Job) -> None:
        ended.append(job)
        rig.at(rig.now + max(every, 0.01 if job.outcome is Outcome.NOT_SENT else 0.0), ask)

    ask()
    return ended


def refused(frame: bytes, code: int = 2) -> bytes:
    body = bytes((frame[0], frame[1] | 0x80, code))
    return body + crc(body)


def lose(rig: Rig, *units: Switched) -> None:
    """Switch them off, and read them until they are offline."""
    for unit in units:
        unit.on = False
    for _ in range(30):
        rig.done(*(rig.submit(read_holding(unit.address, 0, 2)) for unit in units))
        rig.run(0.05)
    assert all(rig.owner.units[unit.address].reach.offline for unit in units)


# What is a sign of life


@pytest.mark.parametrize("every", [0.0, 0.3])
@pytest.mark.parametrize("retries", [0, 2])
def test_a_unit_that_answers_everything_by_an_exception_is_there_though_replies_are_lost(
    every: float, retries: int
) -> None:
    """While one is owed it is not known which request an exception is for; but it is known who sent it."""
    chance = random.Random(1)
    unit = Odd(1, lambda frame, reply: None if chance.random() < 0.05 else refused(frame))
    rig = Rig(unit, config=BusConfig(echo=False, retries=retries), keep_frames=False)
    ended = keep_asking(rig, *(read_holding(1, 0, count) for count in range(1, 9)), every=every)
    for _ in range(600):
        rig.run(0.1)
        assert not rig.owner.units[1].reach.offline
    assert not any(job.reason is Reason.OFFLINE for job in ended)


def test_exceptions_that_come_late_are_signs_of_life() -> None:
    unit = Odd(1, lambda frame, reply: refused(frame))
    unit.turnaround = 0.08
    rig = Rig(unit, config=FIRM, keep_frames=False)
    ended = keep_asking(rig, SOME, every=0.7)
    rig.run(60.0)
    assert not any(job.reason is Reason.OFFLINE for job in ended)


def test_answers_that_come_late_are_signs_of_life() -> None:
    unit = SimUnit(1, BANK)
    unit.turnaround = 0.08
    rig = Rig(unit, config=BusConfig(echo=False, reply_timeout=0.05, retries=0), keep_frames=False)
    ended = keep_asking(rig, SOME, every=0.7)
    rig.run(60.0)
    assert not any(job.reason is Reason.OFFLINE for job in ended)


@pytest.mark.parametrize(
    "said", ["01 03 06 00 01 00 02 00 03", "01 03 00", "01 04 04 00 01 00 02", "01 10 00 00 00 02", "01 83", "01 84 02"]
)
def test_what_only_the_unit_itself_can_have_said_is_one_though_it_answers_nothing(said: str) -> None:
    body = bytes.fromhex(said)
    unit = Odd(1, lambda frame, reply: body + crc(body))
    rig = Rig(unit, config=FIRM)
    ended = keep_asking(rig, SOME)
    rig.run(10.0)
    assert {job.outcome for job in ended} == {Outcome.NO_REPLY}
    assert len(ended) > 10


@pytest.mark.parametrize("said", ["02 03 06 00 01 00 02 00 03", "01 03 00 07 00 01", "01 06 00 07 00 01", "01 84 0B"])
def test_what_another_may_have_said_is_none(said: str) -> None:
    body = bytes.fromhex(said)
    unit = Odd(1, lambda frame, reply: body + crc(body))
    rig = Rig(unit, config=FIRM)
    ended = keep_asking(rig, SOME)
    rig.run(10.0)
    assert Reason.OFFLINE in {job.reason for job in ended}


def test_what_a_gateway_says_of_a_unit_is_none() -> None:
    rig = Rig(Odd(1, lambda frame, reply: refused(frame, 11)))
    ended = keep_asking(rig, SOME)
    rig.run(5.0)
    assert rig.owner.units[1].reach.offline
    assert ended[-1].reason is Reason.OFFLINE


class Gateway(SimDevice):
    """Says 0B for a dead unit after 80 ms."""

    turnaround = 0.08

    def answer(self, pdu: bytes, now: float, *, broadcast: bool) -> bytes | None:
        return bytes((pdu[0] | 0x80, 11))


def answered_by_seven(*last: SimDevice) -> int:
    """Requests that seven units answer in 40 s, beside another one."""
    rig = Rig(*(Switched(address) for address in range(1, 8)), *last, keep_frames=False)
    done: dict[int, int] = {}
    poll(rig, range(1, 8 + len(last)), done)
    rig.run(40.0)
    return sum(count for address, count in done.items() if address <= 7)


def test_a_dead_unit_behind_a_gateway_that_says_so_leaves_the_others_95_percent() -> None:
    assert answered_by_seven(Gateway(8)) >= 0.95 * answered_by_seven()


# What is asked


def silent_for(*registers: int) -> Callable[[bytes, bytes | None], bytes | None]:
    return lambda frame, reply: None if int.from_bytes(frame[2:4], "big") in registers else reply


def longer(frame: bytes, reply: bytes | None) -> bytes | None:
    """Register 0 is answered by a register more than was asked for."""
    if reply is None or frame[2:4] != b"\0\0":
        return reply
    body = reply[:2] + bytes((reply[2] + 2,)) + reply[3:-2] + b"\0\0"
    return body + crc(body)


@pytest.mark.parametrize("odd", [silent_for(0), longer])
@pytest.mark.parametrize("asked", [(0,), (0, 7), (0, 0, 0, 0, 0, 7), (7, *20 * (0,))])
@pytest.mark.parametrize("every", [0.0, 0.2])
def test_a_unit_that_leaves_one_register_unanswered_is_there_for_all_others(
    odd: Callable[[bytes, bytes | None], bytes | None], asked: tuple[int, ...], every: float
) -> None:
    """It is never said to be offline, not even to whoever asks for that register, once it has answered anything."""
    rig = Rig(Odd(1, odd), config=FIRM, keep_frames=False)
    rig.done(rig.submit(read_holding(1, 3, 1)))
    ended = keep_asking(rig, *(read_holding(1, register, 1) for register in asked), every=every)
    rig.run(30.0)
    assert {job.outcome for job in ended if job.request.register == 0} == {Outcome.NO_REPLY}
    assert {job.outcome for job in ended if job.request.register == 7} <= {Outcome.REPLY}


@pytest.mark.parametrize("odd", [silent_for(0), longer, silent_for(0, 1, 2, 3)])
@pytest.mark.parametrize("function", [read_holding, read_input])
def test_a_unit_of_which_only_that_is_ever_asked_is_found(
    odd: Callable[[bytes, bytes | None], bytes | None], function: Callable[[int, int, int], Request]
) -> None:
    def only(frame: bytes, reply: bytes | None) -> bytes | None:
        return odd(frame, reply) if frame[1] == function(1, 0, 1).function else reply

    rig = Rig(Odd(1, only), config=FIRM, keep_frames=False)
    keep_asking(rig, function(1, 0, 1), every=0.2)
    rig.run(10.0)
    job = rig.submit(read_holding(1, 7, 1))
    rig.done(job)
    assert job.outcome is Outcome.REPLY


def test_a_unit_that_dies_while_only_unknown_registers_are_asked_is_noticed() -> None:
    unit = Switched(1)
    rig = Rig(unit, config=FIRM, keep_frames=False)
    rig.done(rig.submit(read_holding(1, 40, 2)))
    unit.on = False
    keep_asking(rig, SOME)
    rig.run(10.0)
    assert rig.owner.units[1].reach.offline


def test_a_lost_unit_is_asked_every_other_time_for_what_it_answered_last() -> None:
    unit = Switched(1)
    rig = Rig(unit)
    rig.done(rig.submit(read_holding(1, 40, 3)))
    unit.on = False
    keep_asking(rig, read_holding(1, 40, 3))
    rig.run(30.0)
    rig.sent.clear()
    rig.run(30.0)
    asked = [frame for _, frame in rig.sent]
    assert len(asked) > 10
    assert set(asked[::2]) == {read_holding(1, 40, 3).adu} or set(asked[1::2]) == {read_holding(1, 40, 3).adu}
    assert len(set(asked)) > 2


def test_a_drive_is_asked_for_its_own_reads_only() -> None:
    rig = Rig()
    (drive,) = drives(rig, 1)
    own = {read.adu for read in drive.attached.reads()}
    drive.sim.receive = lambda frame, now: None  # type: ignore[method-assign]
    for _ in range(3):
        rig.done(rig.submit(drive.attached.reads()[1]))
    rig.run(20.0)
    assert rig.owner.units[1].reach.offline
    assert {frame for _, frame in rig.sent} <= own
    assert {frame for _, frame in rig.sent[6:]} == own


def test_a_unit_is_asked_for_what_its_user_has_named_and_where_reading_changes_something_for_nothing() -> None:
    named = read_input(1, 30, 1)
    for probe, asked in ((named, named.adu), (False, diagnostic(1, Diagnostic.QUERY_DATA).adu)):
        unit = Switched(1)
        rig = Rig(unit)
        rig.owner.units[1].probe = probe  # type: ignore[assignment]
        rig.done(rig.submit(SOME))
        unit.on = False
        rig.done(*(rig.submit(SOME) for _ in range(5)))
        rig.sent.clear()
        rig.run(20.0)
        assert {frame for _, frame in rig.sent} == {asked}
        unit.on = True
        rig.run(4.0)
        assert not rig.owner.units[1].reach.offline


@pytest.mark.parametrize("probe", [None, False])
def test_a_lost_unit_at_a_reserved_address_is_looked_for_too(probe: bool | None) -> None:
    request = read_holding(250, 0, 2, 255)
    rig = Rig()
    rig.owner.units[250].probe = probe  # type: ignore[assignment]
    rig.done(*(rig.submit(request) for _ in range(5)))
    assert rig.owner.units[250].reach.offline
    rig.sent.clear()
    rig.run(10.0)
    assert {frame[0] for _, frame in rig.sent} == {250}


def test_what_may_change_by_being_read_is_not_asked_to_look_for_a_unit() -> None:
    fifo = read_fifo(1, 0)
    rig = Rig(keep_frames=True)
    rig.done(*(rig.submit(fifo) for _ in range(5)))
    assert rig.owner.units[1].reach.offline
    rig.sent.clear()
    rig.run(10.0)
    assert len(rig.sent) > 2
    assert fifo.adu not in {frame for _, frame in rig.sent}


def test_what_a_unit_has_answered_is_remembered_in_bounds() -> None:
    answers = AnsweredRequests()
    for register in range(1000):
        answers.add(read_holding(1, register, 2))
    assert read_holding(1, 999, 2) in answers
    assert read_holding(1, 980, 2) in answers
    assert read_holding(1, 10, 2) not in answers
    assert read_holding(1, 999, 3) not in answers
    answers.add(write_single(1, 5, 7))
    assert write_single(1, 5, 8) in answers
    assert answers.latest == read_holding(1, 999, 2)


def test_other_registers_do_not_keep_a_unit_from_being_probed_by_what_it_answers() -> None:
    answers = AnsweredRequests()
    answers.missed(read_holding(1, 0, 1))
    assert {answers.next_probe(1, ()) for _ in range(6)} >= {read_holding(1, 0, 1), read_input(1, 0, 1)}
    own = [read_input(1, 9, 1), read_input(1, 8, 2)]
    assert {answers.next_probe(1, own) for _ in range(6)} == set(own)


def test_a_sign_of_life_in_the_middle_of_an_attempt_makes_that_no_miss() -> None:
    reach = Reachability()
    for at in range(100):
        reach.heard(at + 0.05)
        reach.unanswered(at + 0.1, 0.1, 0)
        assert not reach.missed(at + 0.1, 1)
    assert not reach.silent
    assert share_lost(*reach.loss.counts) == LEAST


# By evidence


def test_a_silence_counts_that_is_less_likely_than_one_in_a_billion() -> None:
    for loss in (LEAST, 0.02, 0.05, 0.1, 0.3, 0.5, 0.9):
        longest = longest_silence(loss)
        assert loss ** (longest + 1) < 1e-9 <= loss**longest


def test_loss_is_what_was_missed_between_two_answers_and_at_least_1_percent() -> None:
    loss = Loss()
    assert share_lost(*loss.counts) == pytest.approx(0.05)  # nothing is known
    loss.answers += 1000
    assert share_lost(*loss.counts) == LEAST
    for _ in range(100):
        loss.answers += 7
        loss.between_answers(3)
    assert share_lost(*loss.counts) == pytest.approx(0.3, abs=0.02)


@pytest.mark.parametrize("loss", [0.05, 0.1, 0.3])
@pytest.mark.parametrize("units", [1, 8])
def test_a_line_that_loses_makes_no_unit_offline(loss: float, units: int) -> None:
    chance = random.Random(1)
    all_of_them = [Reachability() for _ in range(units)]
    for unit in all_of_them:
        unit.answered()
    for at, unit in zip(range(100_000), itertools.cycle(all_of_them), strict=False):
        if chance.random() < loss:
            counts = [other.loss.counts for other in all_of_them]
            line = share_lost(sum(lost for lost, _ in counts), sum(answered for _, answered in counts))
            unit.unanswered(0.01 * at, 0.005, 0, line)
            assert not unit.missed(0.01 * at, 1)
        else:
            unit.answered()


def test_eight_units_on_a_line_that_loses_30_percent_are_never_offline() -> None:
    units = [Switched(address) for address in range(1, 9)]
    rig = Rig(*units, noise=Noise(lost_reply=0.3), config=FIRM, keep_frames=False)
    poll(rig, range(1, 9), {})
    for _ in range(240):
        rig.run(0.5)
        assert not any(unit.reach.offline for unit in rig.owner.units)


def test_a_unit_that_is_new_on_a_bad_line_is_given_the_benefit_of_what_the_others_lose() -> None:
    chance = random.Random(2)
    others = [Odd(address, lambda frame, reply: reply if chance.random() < 0.7 else None) for address in range(2, 9)]
    fresh = Switched(1)
    fresh.on = False
    rig = Rig(*others, fresh, config=FIRM, keep_frames=False)
    for other in others:
        keep_asking(rig, read_holding(other.address, 0, 2))
    rig.run(10.0)
    keep_asking(rig, SOME)
    rig.run(until=lambda: rig.owner.journal.unit(1).timeouts == 11)
    assert not rig.owner.units[1].reach.offline
    rig.run(60.0)
    assert rig.owner.units[1].reach.offline


def test_one_bad_cable_among_good_ones_is_no_dead_unit() -> None:
    chance = random.Random(3)
    bad = Odd(8, lambda frame, reply: reply if chance.random() < 0.3 else None)
    rig = Rig(*(SimUnit(address, BANK) for address in range(1, 8)), bad, config=FIRM, keep_frames=False)
    for address in range(1, 8):
        keep_asking(rig, read_holding(address, 0, 2))
    log: list[Job] = []
    for _ in range(20):
        rig.done(rig.submit(read_holding(8, 0, 2)))  # the bus gets to know it
    keep_asking(rig, read_holding(8, 0, 2), log=log)
    rig.run(120.0)
    assert not any(job.reason is Reason.OFFLINE for job in log)


def test_a_dead_unit_on_a_good_line_is_noticed_when_five_attempts_had_all_the_time_that_it_may_take() -> None:
    unit = Switched(1)
    rig = Rig(unit, keep_frames=False)
    keep_asking(rig, SOME)
    rig.run(2.0)
    unit.on = False
    before, died_at = rig.owner.journal.unit(1).timeouts, rig.now
    rig.run(until=lambda: rig.owner.units[1].reach.offline)
    assert rig.owner.journal.unit(1).timeouts - before >= 5
    assert 4 * 0.1 < rig.now - died_at < 2.0


def test_offline_after_is_how_many_requests_must_have_failed_at_least() -> None:
    for least in (1, 3, 8):
        unit = Switched(1)
        config = BusConfig(echo=False, retries=0, offline_after=least)
        rig = Rig(unit, config=config, keep_frames=False)
        ended = keep_asking(rig, SOME)
        rig.run(2.0)
        unit.on = False
        answered = len(ended)
        rig.run(until=lambda rig=rig: rig.owner.units[1].reach.offline)  # type: ignore[misc]
        assert len(ended) - answered >= least


def test_repetitions_go_on_while_the_silence_may_be_the_lines_doing() -> None:
    """Four in a row are lost now and then on a line that loses a third."""
    reach = Reachability()
    for _ in range(50):
        for _ in range(2):
            reach.answered()
        reach.unanswered(0.0, 0.05, 0)
    reach.answered()
    for _ in range(4):
        reach.unanswered(1.0, 0.05, 0)
    assert not reach.silent


# Looking for it


@pytest.mark.parametrize("dead", [1, 4])
@pytest.mark.parametrize("known", [True, False])
def test_on_an_idle_bus_a_unit_that_is_back_is_found_within_two_seconds(dead: int, known: bool) -> None:
    """One that is not known, and of which it is not known how long it takes, as long as it is the only one."""
    if dead > 1 and not known:
        return
    units = [Switched(address) for address in range(1, dead + 1)]
    rig = Rig(*units, keep_frames=False)
    if known:
        rig.done(*(rig.submit(read_holding(unit.address, 0, 2)) for unit in units for _ in range(3)))
    spent: list[float] = []
    rig.owner.journal.subscribe(lambda record: spent.append(record.latency))
    lose(rig, *units)
    for after in (10.0, 3.3, 20.1, 7.77, 100.4):
        assert all(unit.reach.offline for unit in rig.owner.units)
        spent.clear()
        rig.run(after)
        if after > 5:
            assert sum(spent) < 0.05 * after + 0.1
        units[0].on = True
        rig.run(2.0)
        job = rig.submit(read_holding(1, 0, 2))
        rig.done(job)
        assert job.outcome is Outcome.REPLY
        lose(rig, units[0])


def test_what_was_spent_on_it_on_an_idle_bus_is_not_missing_when_others_use_the_bus() -> None:
    units = [Switched(address) for address in range(1, 9)]
    units[7].on = False
    rig = Rig(*units, keep_frames=False)
    rig.done(*(rig.submit(read_holding(8, 0, 2)) for _ in range(5)))
    rig.run(100.0)
    poll(rig, range(1, 8), {})
    rig.run(5.0)
    units[7].on = True
    rig.run(6.0)
    assert not rig.owner.units[8].reach.offline


def test_while_others_use_the_bus_it_is_found_too() -> None:
    units = [Switched(address) for address in range(1, 9)]
    rig = Rig(*units, config=FIRM, keep_frames=False)
    poll(rig, range(1, 9), {})
    rig.run(5.0)
    units[7].on = False
    rig.run(10.0)
    assert rig.owner.units[8].reach.offline
    units[7].on = True
    rig.run(6.0)
    assert not rig.owner.units[8].reach.offline


def test_a_slow_unit_is_found_by_its_late_answer() -> None:
    unit = Switched(1)
    rig = Rig(unit, keep_frames=False)
    rig.done(*(rig.submit(read_holding(1, 0, 2)) for _ in range(3)))
    lose(rig, unit)
    unit.turnaround = 0.09
    unit.on = True
    rig.run(2.0)
    assert not rig.owner.units[1].reach.offline


def test_a_lost_unit_is_listened_to_for_a_few_times_what_it_took_before() -> None:
    assert listening_time(0.1, 0.005) == pytest.approx(0.02)
    assert listening_time(0.1, 0.001) == pytest.approx(0.01)
    assert listening_time(0.1, 0.09) == listening_time(0.1, 0.0) == pytest.approx(0.075)


def test_one_that_comes_and_goes_is_found_again_at_once_on_an_idle_bus() -> None:
    unit = Switched(1)
    rig = Rig(unit, keep_frames=False)
    for _ in range(5):
        rig.done(*(rig.submit(read_holding(1, 0, 2)) for _ in range(3)))
        lose(rig, unit)
        unit.on = True
        rig.run(2.0)
        assert not rig.owner.units[1].reach.offline


def test_while_it_is_offline_stops_feeds_and_looks_go_on() -> None:
    rig = Rig()
    (drive,) = drives(rig, 1)
    rig.done(drive.move(rig))
    receive = drive.sim.receive
    drive.sim.receive = lambda frame, now: None  # type: ignore[method-assign]
    rig.done(*(rig.submit(drive.attached.reads()[0], urgency=Urgency.POLL) for _ in range(5)))
    assert rig.owner.units[1].reach.offline
    drive.sim.receive = receive  # type: ignore[method-assign]
    drive.stop(rig)
    rig.run(1.0)
    assert drive.halted[0].standing


def test_one_dead_unit_costs_the_others_less_than_5_percent_whatever_is_asked_of_it() -> None:
    assert throughput(8, dead=1) >= 0.95 * throughput(7)
